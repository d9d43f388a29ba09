"""Runs as files of other tools.

- `source`: a run from its folder, trace or dataset, with units of all columns and names for other tools
- `files`: CSV and MATLAB files
- `messages`: MCAP files of ROS 2 messages
"""
