"""Host side of the link.

- `state_machine`: session, arming, time limits and faults, without clock and wire.
- `link`: a host on a transport; `open_link` makes one from an address.
- `plant`: the robot behind a link as a plant, in lock-step or real time.
- `frame_log`: log of all frames and its reader.
- `dataset`: such a log as a dataset.
"""
