"""The planar plant runs on the corrected equations or on those printed; the twin has no printed form."""

import numpy as np
import pytest

from omnimj.errors import InputError, UnknownNameError
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario


def speeds(equations):
    scenario = read_scenario(
        "rig_constant_current", (f"equations={equations}", "current=0.0", "duration=0.5")
    )
    return run_scenario(scenario, "planar").trace["true_carriage_speed"]


def test_as_printed_a_rig_without_current_drives_backward_and_corrected_it_stays():
    assert np.abs(speeds("corrected")).max() < 1e-9
    assert speeds("published")[-1] < -0.05  # T_nl has no sign in Eqs. 3.80-3.85


def test_the_twin_refuses_the_printed_form():
    with pytest.raises(InputError, match=r"equations: found 'published'; .*planar"):
        run_scenario(read_scenario("nylon_patch", ("equations=published",)), "twin")


@pytest.mark.parametrize("value", ["printed", "3", "[1]", "true"])
def test_another_form_is_refused_with_the_choices(value):
    with pytest.raises(UnknownNameError, match="corrected, published"):
        read_scenario("nylon_patch", (f"equations={value}",))
