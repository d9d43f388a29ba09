"""Plausibility of recorded channels, judged before any model of friction is fitted.

- `acceptance`: the check of a whole dataset, what holds it back, and the correction of gross errors
- `suspicions`: the records of a check, and the channels to blame when related channels disagree
- `columns`: defects visible in a single column, and sensor biases at rest
- `compare`: scale, delay and drift between two related channels, and the order of first motions
- `time_base`: unit and scale of time, by the change of positions and angles
- `magnitudes`: values beyond what the machine can do
- `rig`, `robot`, `machine`: relations between the channels of each plant, `slide` those of a single slide
"""
