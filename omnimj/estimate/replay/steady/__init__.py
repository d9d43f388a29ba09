"""Replay of a robot's steady driving with a measured pose: wheel speeds in, body velocity and currents out.

- `runs`: logs as blocks of steady driving, in sectors of directions
- `replay`: the blocks by the balance of forces
- `traction`: traction over slip, by the currents and by the models
"""
