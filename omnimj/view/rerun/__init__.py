"""Rerun recordings of runs and of the gap workflow, and the live view.

- `recording`: `run.rrd`, as a file or as a stream. `live`: a run or a drive by hand while it goes on.
- `blueprint`: layout of the viewer. `viewer`: the viewer's process.
- `scene`, `meshes`: recording files with machine, floor and paths. `signals`: time series, fault states.
- `before_after`, `dead_reckoning`: measured and simulated motion side by side.
"""
