"""Views of runs, gaps and studies: plots, Rerun recordings, HTML reports.

- `plots/`: plots drawn by the browser, with `palette` for colours and `residuals` for families of residuals.
- `rerun/`: recordings `run.rrd` and `before_after.rrd`, and the live view of a run or a drive by hand.
- `report/`: `report.html` of every command, made from templates.
- `wording`, `comparison`: runs and comparisons of methods in words, for reports and the terminal.
- `poses`, `picture`: poses of the displayed machine, and its picture rendered by MuJoCo.
- `readme_pictures`: the pictures of README and docs.

Only the command line imports this package.
"""
