"""The MuJoCo twins of robot and rig, with their own wheel contact in native code.

`twin` contains the plants, `mjcf` and `assembly` build their compiled models, `conditions` writes faults and
effects into them. Inside a step `callback` calls `contact` (wheel on floor) and `forces` (motors, rail,
effects), which find their parameters by `slots` in MuJoCo's memory (`memory`).
"""
