"""The published method: chapters 5 and 6 of the text, on the test rig and on the robot.

A model driven by the measured currents runs beside the machine, open loop. How far the wheels are from it
says that something has happened; whether two ways to compute the traction force agree says whether it is the
floor or a motor. Its weaknesses are kept: it is what other methods are compared with. `variant` says whether
the equations are used as printed or with their signs repaired; each place that differs names its erratum:

- T_nl without a sign, friction that does not know rest (Eqs. 3.80-3.85, 5.14-5.15);
- thresholds on r instead of |r| (Eq. 5.13), and Table 5.2 without a row for both axes at once;
- weights from residuals of mixed sign (Eq. 6.4), a torque constant that turns negative (Eq. 6.2);
- inverse kinematics at half the linear and a quarter of the angular speed (Eqs. 3.5-3.15).

What no sign repairs stays in both: thresholds that are the largest of a few runs, RMS since the start, the
first to cross, an observer that never learns.
"""
