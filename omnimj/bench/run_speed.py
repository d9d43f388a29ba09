"""How fast a scenario is driven with everything that belongs to it, and what its recording costs."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from omnimj.bench.twin_speed import seconds


def measure_run(duration: float) -> dict[str, float]:
    """Real-time factor of a scenario with control, sensors and recording; share and size of the recording.

    Args:
      duration: Of the scenario [s].
    """
    from omnimj.recording.traces import write_trace
    from omnimj.scenario.running import run_scenario
    from omnimj.scenario.scenario import read_scenario
    from omnimj.view.recording_of_run import write_recording_of

    scenario = read_scenario("circle_8m", (f"duration={duration}", "drive.speed=0.3"))
    run_scenario(scenario)
    walls, shares, size = [], [], 0
    for _ in range(3):
        begin = time.perf_counter()
        run = run_scenario(scenario)
        driven = time.perf_counter() - begin
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder)
            stored = seconds(lambda to=path, what=run: write_trace(to / "trace.parquet", what.trace))
            shown = seconds(lambda to=path, what=run: write_recording_of(to / "run.rrd", what))
            size = (path / "run.rrd").stat().st_size
        walls.append(driven + stored)
        shares.append(shown / (driven + stored))
    return {
        "scenario_realtime_factor": scenario.duration / min(walls),
        "rerun_share": min(shares),
        "rerun_megabytes_10_s": size / 1e6,
    }
