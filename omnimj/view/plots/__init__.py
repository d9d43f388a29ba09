"""Plots for reports and documentation; each function returns one `Drawing`.

- `panels`, `over_time`, `thinning`: shared parts of all plots.
- `document`: the plots of a page as one document with a common time axis and cursor.
- `static`, `outlines`: still pictures of the same plots, for paper and without JavaScript.
- `runs`: signals and path of a robot or a rig. `comparison`: methods overlaid.
- `diagnosis`: residuals, diagnoses, modes, floors under the wheels.
- `mismatch`, `candidates`: gap between twin and recordings, and the candidate effects.
- `identification`: friction curves, identified numbers, validation overlays.
- `evaluation`, `tuning`, `sensitivity`: studies. `matrix`: shaded matrices with numbers.
"""
