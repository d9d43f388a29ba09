"""Estimation from recorded runs.

- `least_squares`: the bounded, damped Gauss-Newton solver
- `intervals`: noise of recorded channels and intervals of fitted parameters
- `replay`: recorded inputs drive the equations of rig, robot or axis; the replay as a least-squares problem
- `identification`: traction parameters of floors from rig runs, and validation of a model
- `gap`: the mismatch between model and measurement, the missing effect, and the new model
"""
