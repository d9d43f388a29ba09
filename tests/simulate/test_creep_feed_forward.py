"""Driving on soft floors with the creep of an assumed floor fed forward, which need not be the true one."""

import numpy as np
import pytest

from omnimj.resources import models_folder
from omnimj.simulate.run import make_controller, run_scenario
from omnimj.simulate.scenario.scenario import read_scenario

FLOORS = models_folder() / "robotino" / "soft_floors.toml"


def scenario(tmp_path, *overrides, worse=1.0):
    """The circle on soft floors, whose creep may be larger than identified."""
    floors = tmp_path / f"floors_{worse}.toml"
    lines = []
    for line in FLOORS.read_text(encoding="utf-8").splitlines():
        key, _, value = line.partition(" = ")
        lines.append(f"{key} = {worse * float(value)}" if key == "turnover" else line)
    floors.write_text("\n".join(lines), encoding="utf-8")
    return read_scenario("soft_floor_circle", overrides, floors_file=floors)


@pytest.mark.slow
@pytest.mark.parametrize("floor", ["gray", "green"])
def test_the_path_error_falls_by_70_percent_on_a_floor_that_creeps_a_tenth_more_than_assumed(tmp_path, floor):
    truth = scenario(tmp_path, f"floor={floor}", worse=1.1)
    errors = []
    for assumed in ("", floor):
        nominal = scenario(tmp_path, f"floor={floor}", f"drive.creep_floor={assumed}")
        errors.append(run_scenario(nominal, "planar", truth=truth).metrics["path_error_rms"])
    assert errors[1] < 0.3 * errors[0]


def test_the_controller_knows_the_assumed_floor_only(tmp_path):
    on = [scenario(tmp_path, f"floor={floor}", "drive.creep_floor=gray") for floor in ("gray", "green")]
    first, second = (make_controller(one).constants.creep for one in on)
    assert first.feeds and np.array_equal(first.model.floors, second.model.floors)
    other = make_controller(scenario(tmp_path, "drive.creep_floor=green")).constants.creep
    assert not np.array_equal(first.model.floors, other.model.floors)
    assert not make_controller(scenario(tmp_path, "drive.creep_floor=")).constants.creep.feeds
