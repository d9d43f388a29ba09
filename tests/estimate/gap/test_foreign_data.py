"""Data of a simulator that shares no code with the package: quiet on nothing, right on something hidden.

The rig's equations integrated afresh (`rig_reference`), with noise as white as no sensor of ours makes it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from rig_reference import integrate

from omnimj.estimate.gap.find import find_gap
from omnimj.estimate.gap.records import Finding
from omnimj.parameters import Rig, read_floors, read_rig
from omnimj.recording.dataset import Run
from omnimj.recording.write_dataset import DatasetWriter

RIG = read_rig()
FLOORS = ("natural_stone", "pvc", "paperboard")
CONDITIONS = (  # current [A], mass [kg], lateral speed [m/s]
    (0.45, 3.9593, 0.0),
    (0.75, 2.9593, 0.0),
    (1.05, 1.9593, 0.0),
    (1.5, 3.9593, 0.0),
    (0.9, 3.9593, 0.4),
    (0.9, 3.9593, -0.4),
)
SUPPLY, RESISTANCE = 24.0, 5.0
WHITE = {  # standard deviations
    "current": 0.01,
    "wheel_speed": 0.05,
    "carriage_speed": 0.002,
    "carriage_acceleration": 0.1,
    "lateral_speed": 0.002,
}


def recorded(folder: Path, rig: Rig, torque_constant: float, heavier: float = 0.0) -> Path:
    """A dataset of the rig as it is; the current is what supply and back-EMF of `torque_constant` leave."""
    noise = np.random.default_rng(7)
    writer = DatasetWriter(folder, "quarter_rig", {})
    for floor in FLOORS:
        for k, (current, mass, lateral) in enumerate(CONDITIONS):
            time, speed, wheel = integrate(rig, read_floors()[floor], mass + heavier, current, 1.0, lateral)
            left = (SUPPLY - torque_constant * rig.motor.gear_ratio * wheel) / RESISTANCE
            exact = {
                "current": np.minimum(current, left),
                "wheel_speed": wheel,
                "carriage_speed": speed,
                "carriage_acceleration": np.gradient(speed, time),
                "lateral_speed": np.full(len(time), lateral),
            }
            columns = {
                name: values + WHITE[name] * noise.standard_normal(len(time))
                for name, values in exact.items()
            }
            conditions = MappingProxyType({"floor": floor, "mass": mass})
            writer.add(Run(f"{floor}_{k}", {"time": time, **columns}, MappingProxyType({}), conditions))
    return folder


def searched(folder: Path, rig: Rig, torque_constant: float | None = None, heavier: float = 0.0) -> Finding:
    own = rig.motor.torque_constant if torque_constant is None else torque_constant
    return find_gap(recorded(folder / "data", rig, own, heavier))


@pytest.mark.slow
def test_nothing_hidden_is_no_gap(tmp_path):
    finding = searched(tmp_path, RIG)
    assert (finding.verdict, finding.effects) == ("no_gap", ())


@pytest.mark.slow
def test_rolling_resistance_is_named_with_its_size(tmp_path):
    finding = searched(tmp_path, replace(RIG, wheel=replace(RIG.wheel, rolling_resistance=0.02)))
    (effect,) = finding.effects
    assert (finding.verdict, effect.effect) == ("named", "rolling_resistance")
    (found,) = effect.parameters.values()
    assert found.low is not None and found.high is not None
    assert found.low <= 0.02 <= found.high
    assert found.value == pytest.approx(0.02, rel=0.05)


@pytest.mark.slow
def test_a_weaker_motor_is_among_the_candidates_that_the_data_cannot_distinguish(tmp_path):
    weak = replace(RIG.motor, torque_constant=0.92 * RIG.motor.torque_constant)
    (effect,) = searched(tmp_path, replace(RIG, motor=weak)).effects
    assert "torque_constant" in (effect.effect, *effect.indistinguishable_from)


@pytest.mark.slow
def test_a_current_that_contradicts_the_motion_is_not_explained_away(tmp_path):
    """The motor is weak, the recorded current that of a strong one: no machine is like that."""
    weak = replace(RIG.motor, torque_constant=0.92 * RIG.motor.torque_constant)
    finding = searched(tmp_path, replace(RIG, motor=weak), torque_constant=RIG.motor.torque_constant)
    assert (finding.verdict, finding.effects) == ("unexplained", ())
