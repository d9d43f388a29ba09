"""Blind benchmark of the gap workflow on datasets with hidden effects.

`study`      configuration, `run_benchmark`, result
`plants`     the machines: the rig, and any machine with an MJCF file
`cases`      hidden effects of the rig in three sizes, alone and together
`unmodelled` effects outside the library, and deviations of a machine from its equations
`datasets`   recordings of the true rig
`machine_cases`  hidden effects of any other machine, and its datasets
`hand_equations` recordings of it by equations written by hand and scipy, beside those of `simulate.machine`
`seal`       the truth under seal until scoring
`trial`      blind search of a dataset, baselines on the same data, and the fit of the true model
`scoring`    score of one case
`summary`    numbers over all cases, and their tables
"""
