"""Tuning of the gains of cascade, recovery and observer over randomised runs.

`study`      configuration, `run_tuning`, result
`draws`      random truth of the runs, the same for all candidates
`trial`      one draw driven with one candidate, and its metrics
`batch`      candidates over draws, each trial stored and run only once
`cost`       cost terms and hard limits
`margins`    phase margins and overshoot of the loops in closed form
`search`     search space and CMA-ES
`landscape`  cost around the result
`reporting`  gains file and rows of tables
"""
