"""The whole loop as one compiled function, without the interpreter and without its lock.

- `run`: runs of robots and rigs, which return to Python for progress, decisions and changes of the plant
- `row`: one control period or one of wheels that follow given speeds, and its row, common to all plants
- `planar`, `twin`: the loops without and with MuJoCo, each for robot and rig
"""
