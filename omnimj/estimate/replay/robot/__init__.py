"""Replay of a robot's missions.

- `replay`: `RobotReplay`, the planar equations with effects along the measured wheel speeds
- `runs`: missions on a common clock, their regimes, and candidate experiments
- `kernel_parameters`: the robot with its effects in the form of the kernels; geometry of the rollers
- `kernels`: the compiled replay
"""
