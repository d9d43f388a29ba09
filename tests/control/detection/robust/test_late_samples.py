"""Late, missing and repeated readings: the time of a measurement decides what it counts, not its turn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from busy_host import LATE, MISSED, BusyHost, driven_by_a_busy_host
from driven_missions import WEAK, driven
from nightly import representative

from omnimj import read_scenario
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.detection.robust.blocks import samples_per_block
from omnimj.control.detection.robust.judgement import BLIND
from omnimj.parameters import read_robot
from omnimj.plant.faults import Fault
from omnimj.signals import Measurement, Trace
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.driving import drive_stepwise
from omnimj.simulate.plants import make_plant
from omnimj.simulate.run import make_diagnosing_controller


def readings(trace: Trace, rows) -> list[Measurement]:
    """What the sensors read at some rows."""
    columns = [trace.wheels(name) for name in ("current", "wheel_speed")]
    body = np.column_stack([trace[f"acceleration_{axis}"] for axis in "xy"])
    return [
        Measurement(
            float(trace["time"][k]),
            columns[0][k],
            columns[1][k],
            body[k],
            float(trace["yaw_rate"][k]),
            float(trace["yaw"][k]),
        )
        for k in rows
    ]


def observed(measurements):
    """States of the detector after each measurement."""
    detector = RobustDetector(read_robot())
    state, states = detector.start(measurements[0]), []
    for one in measurements:
        state = detector.step(state, one)
        states.append(state)
    return states


@pytest.mark.slow
@pytest.mark.parametrize("seed", [6, 1, 2, 3])
def test_a_healthy_robot_behind_a_busy_host_raises_no_alarm(seed):
    trace = driven_by_a_busy_host(seed)
    steps = np.diff(trace["time"])
    assert (steps > 1.5e-3).mean() > MISSED and (steps == 0.0).mean() > 0.8 * LATE
    assert trace.about["diagnoses"] == []


@pytest.mark.slow
def test_a_busy_host_hides_no_fault():
    weak = driven_by_a_busy_host(5, faults=(WEAK,)).about["diagnoses"]
    assert [(d["kind"], tuple(d["wheels"])) for d in weak] == [("motor", (2,))]
    slip = Fault("slip", 3.0, wheel=3, numbers={"grip": 0.15})
    found = driven_by_a_busy_host(5, faults=(slip,)).about["diagnoses"]
    assert {(d["kind"], tuple(d["wheels"])) for d in found} == {("slip", (3,))}


@pytest.mark.parametrize("seed", representative(1, 2))
def test_over_a_nylon_patch_only_the_wheel_on_it_slips(seed):
    scenario = read_scenario("nylon_patch")
    plant: Any = BusyHost(make_plant(scenario, "planar", seed), seed)
    controller = make_diagnosing_controller(scenario, make_detector("robust", scenario))
    trace = drive_stepwise(plant, controller, scenario.robot_drive.reference)
    assert [(d["kind"], tuple(d["wheels"])) for d in trace.about["diagnoses"]] == [("slip", (1,))]


@pytest.mark.slow
def test_a_reading_that_comes_again_changes_nothing():
    rows = np.arange(3000)
    once, again = (observed(readings(driven(), k)) for k in (rows, np.repeat(rows, 3)))
    assert once[-1].blocks == again[-1].blocks
    assert np.array_equal(once[-1].log, again[-1].log)
    before = observed([*readings(driven(), rows), *readings(driven(), rows[-50:-1])])[-1]
    assert np.array_equal(once[-1].evidence.velocity, before.evidence.velocity)


@pytest.mark.parametrize("lost", [6, 30, 90, 300])
def test_a_gap_cannot_be_judged_until_a_block_after_it_is_full(lost):
    row, per_block = 4000, samples_per_block(1e-3)
    rows = np.r_[0:row, row + lost : row + lost + 400]
    states = observed(readings(driven(), rows))
    assert abs(driven().wheels("wheel_speed")[row]).max() > 5.0 and states[row - 1].log[-1] != BLIND
    modes = np.array([state.log[-1] for state in states])
    first = row + int(np.argmax(modes[row:] == BLIND))
    assert first - row <= per_block and (modes[first : first + per_block] == BLIND).all()
    assert (modes[first + per_block + 1 :] != BLIND).all()
    assert not states[-1].diagnoses


def test_few_missing_readings_leave_every_block_judged():
    rows = np.arange(3000)
    kept = np.delete(rows, np.arange(5, 3000, 7))
    whole, few = (np.array([s.log[-1] for s in observed(readings(driven(), k))]) for k in (rows, kept))
    assert (whole == 0.0).any() and (whole[kept] != few).mean() < 0.02
