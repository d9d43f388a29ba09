"""Plausibility of recorded channels, judged before any model of friction is fitted.

- `dataset`: the check of a whole dataset, and the correction of gross errors
- `suspicions`: the records of a check, and the channels to blame when related channels disagree
- `columns`: defects visible in a single column, and sensor biases at rest
- `compare`: scale, delay and drift between two related channels, and the order of first motions
- `rig`, `robot`, `axis`: relations between the channels of each plant
"""
