"""Replay of recorded runs: measured inputs drive a plant's equations; its sensors are compared with the log.

- `interface`: the `Replay` of a plant and its records; candidate effects from the catalogue
- `base_parameters`: uncertain parameters of a machine
- `problem`: a replay as a least-squares problem, and its fit
- `rig`, `robot`, `axis`: the replays of the three plants
- `steady`: that of a robot with a measured pose, which compares steady driving
"""
