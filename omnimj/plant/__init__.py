"""Plants: the interface, sensors, faults, floors by place, and the simulated plants.

`interface` is all that a controller knows of a plant. `faults` turns faults and effects into conditions,
`sensors` and `sensor_chain` turn quantities into readings, `ground` gives the floor at a place. `planar`
holds robot and rig without MuJoCo, `axis` the linear axis, the package `mujoco` the twins.
"""
