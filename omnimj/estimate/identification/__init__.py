"""Identification of a floor's traction parameters from rig runs, and validation of a model against them.

- `identify`: LuGre parameters of every floor of a dataset, with intervals
- `runs`: measured runs on an even grid, and prepared for the fit
- `floor_fit`: the least-squares problem of one floor and its solutions
- `curve`: the steady traction curve, and the slip covered by the runs
- `uncertainty`: covariance, confidence intervals, and parameters that the runs leave open
- `validation`: tables of RMS speed errors, compared with those of the dissertation
- `records`, `files`: results as records and as files
"""
