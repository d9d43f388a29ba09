"""Replay of rig runs.

- `replay`: `RigReplay`, the equations with effects driven by measured currents; the twin as reference
- `runs`: runs on a common clock, their regimes, and candidate experiments
- `kernels`: the compiled replay
"""
