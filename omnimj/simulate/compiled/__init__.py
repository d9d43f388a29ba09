"""The whole loop as one compiled function, without the interpreter and without its lock.

- `run`: `CompiledRun`, a run that returns to Python for progress, decisions and changes of the plant
- `row`: one control period and its row, common to all plants
- `planar`, `twin`: the loops of the two plants
"""
