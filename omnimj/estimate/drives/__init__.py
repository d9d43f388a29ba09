"""Measured drives of a robot beside its model, whose wheels turn as the measured ones did.

- `replay`: one run on twin, equations, or rolling without slip
- `compare`: numbers of a run, groups of runs by floor and speed, angle of the marker
- `validate`: all runs, and the content of `validation.json`; `records`: what they return
"""
