"""Fault detection and isolation beside the cascade.

- `detector`: interface of a detector, its options and the fault estimate
- `published/`: the method of chapters 5 and 6, weaknesses included, on rig and robot
- `robust/`: force balance without a friction law, and slip against an inertial velocity
"""
