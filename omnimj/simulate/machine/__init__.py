"""Simulated machines with an MJCF file, for datasets with hidden effects.

- `truth`: the laws of the true machine, written apart from those of the replay.
- `drive`: its joints follow planned motions in a closed loop, by MuJoCo in fine steps; logs with noise.
- `linear_axis`: the axis of an `axis.toml` as such a machine.
"""
