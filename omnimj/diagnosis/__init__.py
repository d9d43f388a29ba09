"""Diagnosis of recorded runs, and calibration of thresholds on runs without a fault.

`logs`                  machines, their channels, and runs sampled at the controller's rate
`replay`                a recorded run through a fault detector, and `diagnose` over a dataset
`calibration`           thresholds of the robust method at a stated rate of false alarms
`floor_labels`          which wheel stands on which floor, from currents and wheel speeds
`files`                 `diagnoses.json`, `thresholds.toml`, and their sentences
`published_thresholds`  thresholds of the published method from twin runs
"""
