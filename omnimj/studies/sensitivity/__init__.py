"""Sensitivity of a scenario's results to model parameters, by elementary effects (Morris 1991).

`study`               configuration, `run_sensitivity`, result
`factors`             parameters that are varied, with their ranges
`trial`               one run on a plant with changed parameters
`elementary_effects`  trajectories, μ, μ* and σ with intervals, noise floor, ranks of the parameters
`tables`              tables and sentences for Markdown, command line and report
"""
