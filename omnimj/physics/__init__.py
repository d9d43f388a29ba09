"""Equations as numba kernels, shared by the planar plants, the MuJoCo twin, observers and replay.

From the floor up: `traction` (LuGre, Magic Formula), `wheel` (rollers, bearings), `motor` (amplifier, gear),
`effect_terms` (added physics), then whole machines: `planar` and `planar_wheel` (robot with n wheels), `rig`,
`carriage` (the rig without its drive). `equilibrium` balances the forces of steady driving,
`kinematics` is the law of rigid rolling. Kernels take NamedTuples; several of a kind, or those in MuJoCo's
memory, travel as packed rows that `*_at` reads. `native` compiles kernels and keeps them on disk;
`machine_code` translates only those that Python or MuJoCo call.
"""
