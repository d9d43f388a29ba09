"""Plants: the interface, sensors, faults, floors by place, and the simulated plants.

`interface` is the only part that a controller depends on. `faults` turns faults and effects into conditions,
`sensors` and `sensor_chain` turn quantities into readings, `ground` finds the floor at a place. `planar`
contains robot and rig without MuJoCo, the package `mujoco` the twins.
"""
