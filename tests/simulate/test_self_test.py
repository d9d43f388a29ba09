"""A scenario may switch on a self-test and switch off dither and recovery."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.errors import InputError
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario

FREE = 'faults=[{ kind = "free", wheel = 2, onset = 0.0 }]'


def test_a_self_test_names_a_dead_motor_before_the_plan_begins():
    run = run_scenario(
        read_scenario("circle_8m", (FREE, "diagnosis.self_test=true", "duration=4.0")), "planar", "robust"
    )
    (first, *_) = run.metrics["diagnoses"]
    assert (first["kind"], first["wheels"]) == ("free", [2])
    waits = run.trace["time"] < 1.4
    assert first["time"] < 1.4
    assert not run.trace["pace"][waits].any()
    assert np.hypot(run.trace["twist_x"], run.trace["twist_y"])[waits].max() < 0.05


def test_without_recovery_the_robust_method_only_watches():
    overrides = (FREE, "diagnosis.recovery=false", "duration=3.0")
    run = run_scenario(read_scenario("circle_8m", overrides), "planar", "robust")
    assert "recovery" not in run.trace
    off = run_scenario(read_scenario("circle_8m", overrides), "planar", "off")
    assert np.array_equal(run.trace["x"], off.trace["x"])
    assert run.metrics["diagnoses"]


@pytest.mark.parametrize("key", ["self_test", "dither", "recovery"])
def test_a_flag_is_true_or_false(key):
    with pytest.raises(InputError, match=f"diagnosis.{key}: found 'yes'; must be true or false"):
        read_scenario("circle_8m", (f"diagnosis.{key}='yes'",))
