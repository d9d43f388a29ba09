"""A tuning of two gains by trials of half a second."""

from __future__ import annotations

from pathlib import Path

from short_push import scenario_file

from omnimj.studies.tuning.cost import Limits
from omnimj.studies.tuning.study import TuningConfig

CASCADE = ("control.speed_proportional", "control.yaw_rate_proportional")


def small_tuning(folder: Path) -> TuningConfig:
    """Its settings; the scenario and the results lie in the folder."""
    return TuningConfig(
        folder / "gains.toml",
        (scenario_file(folder),),
        CASCADE,
        trials=2,
        judging=1,
        generations=2,
        landscape=2,
        limits=Limits(overshoot=1.0),  # so that candidates near the gains before are driven
    )
