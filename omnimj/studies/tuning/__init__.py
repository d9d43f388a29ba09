"""Tuning of the gains of cascade, recovery and observer over randomised runs.

`study`      configuration, `run_tuning`, result
`draws`      random truth of the runs, the same for all candidates
`trial`      one draw driven with one candidate, its metrics, and candidates over draws, each trial stored
`cost`       cost terms and hard limits, and the cost around the result
`margins`    phase margins and overshoot of the loops in closed form
`search`     search space and CMA-ES
`reporting`  gains file and rows of tables
"""
