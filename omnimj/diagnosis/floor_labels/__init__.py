"""Which wheel stands on which floor, from currents and wheel speeds of steady driving.

`currents`     currents that every assignment of floors to wheels needs, and windows of their means
`labelling`    most probable assignment over time, and probability of each floor under each wheel
`calibration`  noise and threshold from runs on one floor
`runs`         labelled runs, and `label_runs` over a dataset
`edge`         where a camera sees the contacts, and the line between two floors
`files`        `floor_labels.json` and the labels of each run
`scores`       crossings found, accuracy and delays, beside the same rules on truth shifted in time
"""
