"""Evaluation of a diagnosis method over randomised cases.

`study`    configuration, `run_evaluation`, result
`cases`    suites of cases, each drawn from suite, seed and number
`trial`    one case driven with the method, without it and without faults
`scoring`  score of one case
`summary`  numbers over all cases
`goals`    comparison of the measured figures with the goals
`tables`   tables and sentences for Markdown, command line and report
"""
