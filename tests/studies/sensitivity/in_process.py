"""What the tests of sensitivity share: work done at once, and a short study of the rig."""

from __future__ import annotations

from pathlib import Path

from omnimj.studies.sensitivity.study import SensitivityConfig
from omnimj.studies.sensitivity.trial import TrialConfig

SHORT_RIG = TrialConfig("rig_constant_current", ("duration=0.1", "checks={}"), method="off")
SHORT_ROBOT = TrialConfig("nylon_patch", ("duration=0.7", "checks={}"), method="off")


def order_of(out: Path, config: TrialConfig = SHORT_RIG, trajectories: int = 2, **more) -> SensitivityConfig:
    return SensitivityConfig(out, config, trajectories, **more)
