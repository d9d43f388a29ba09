"""What the tests of tuning share."""

from __future__ import annotations

import pytest
from short_push import scenario_file

from omnimj.studies.tuning.cost import Limits
from omnimj.studies.tuning.study import TuningConfig

CASCADE = ("control.speed_proportional", "control.yaw_rate_proportional")


@pytest.fixture
def order(tmp_path) -> TuningConfig:
    text = scenario_file(tmp_path)
    limits = Limits(overshoot=1.0)  # so that candidates near the gains before are driven
    return TuningConfig(
        tmp_path / "gains.toml",
        (text,),
        CASCADE,
        trials=2,
        judging=1,
        generations=2,
        landscape=2,
        limits=limits,
    )
