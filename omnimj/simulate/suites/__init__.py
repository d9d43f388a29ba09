"""Test plans that are recorded as datasets.

- `suite`: what a test plan consists of; `catalogue`: all of them by name.
- `recording`: drives a suite run by run and writes the dataset.
- `rig`, `missions`, `axis`: test plans of the rig, the robot and the linear axis.
"""
