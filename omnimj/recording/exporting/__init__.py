"""Runs as files of other tools.

- `source`: a run from its folder, trace or dataset
- `units`: units of all columns, and names that other tools accept
- `csv_file`, `mat_file`, `mcap_file`: the formats
- `messages`: a run as ROS 2 messages
"""
