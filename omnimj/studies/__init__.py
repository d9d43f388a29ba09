"""Studies: many trials by one plan, resumed after an interruption and evaluated together.

`runner`         the steps of every study: claim a folder, run missing trials, evaluate the results
`workers`        own processes or a Dask cluster
`statistics`     rates with confidence bounds, quantiles, tables
`random_truth`   random faults and parameter errors, and the drive of a nominal scenario on the true plant
`part_use`       when a faulty part is in use, and excursions from the plan

Clients of the runner:
`evaluation`     `omnimj evaluate`: how well a method diagnoses, and what its recovery gains
`tuning`         `omnimj tune`: gains of cascade, recovery and observer by CMA-ES
`sensitivity`    `omnimj sensitivity`: the effect of model parameters on the results
`gap_benchmark`  `omnimj gap --benchmark`: the gap workflow on datasets with hidden effects
"""
