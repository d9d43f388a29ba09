"""Blind benchmark of the gap workflow on datasets with hidden effects.

`study`      configuration, `run_benchmark`, result
`cases`      hidden effects in three sizes, alone and together
`unmodelled` effects outside the library, and deviations of a machine from its equations
`datasets`   recordings of the true rig
`seal`       the truth under seal until scoring
`trial`      blind search of a dataset, baselines on the same data, and the fit of the true model
`scoring`    score of one case
`summary`    numbers over all cases, and their tables
"""
