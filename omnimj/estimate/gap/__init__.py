"""Gap between simulation and measurement: its location, the missing effects by name, and the new model.

- `find`: the workflow from a dataset's folder to a `Finding`
- `plants`: model file, data check and replay of each plant
- `check`: plausibility of the recorded channels
- `search`: stepwise selection of effects on held-out runs
- `verdict`: what the outcome of a search supports, and the run that would separate rivals
- `locate`: regimes in which the mismatch concentrates
- `records`, `sentences`, `files`: the finding as records, as text and as files
"""
