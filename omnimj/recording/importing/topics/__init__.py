"""Recorded messages (MCAP files, ROS 2 bags) as one table of a log.

- `files`: messages of a file or folder, one after the other, in bounded memory
- `cdr`, `json_numbers`: numbers of one message
- `quantities`: units and meaning of the fields of well-known messages
- `series`: numbers of a topic over time
- `join`: topics of different rates on one time base
- `read`: all of it as a `SourceTable`
"""
