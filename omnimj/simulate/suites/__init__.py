"""Test plans that are recorded as datasets.

- `suite`: the parts of a test plan; `catalogue`: all test plans by name.
- `recording`: drives a suite run by run and writes the dataset.
- `rig`, `missions`, `machine`: test plans of the rig, the robot, and any machine with an MJCF file.
"""
