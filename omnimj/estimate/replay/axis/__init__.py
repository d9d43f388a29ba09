"""Replay of a linear axis' logs.

- `replay`: `AxisReplay`, the axis with effects as a `Replay` for the search
- `log`: runs on a common clock, cut into stretches, windows and blocks
- `settings`: base parameters and candidate effects as rows of the kernels
- `experiments`: candidate experiments and their simulation
- `kernels`: the compiled replay
"""
