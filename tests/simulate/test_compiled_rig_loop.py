"""The compiled loop drives a rig as the stepwise loop does, bit for bit, whatever happens in the run."""

from __future__ import annotations

import numpy as np
import pytest
from same_traces import assert_same

from omnimj import read_scenario
from omnimj.effects import with_effects
from omnimj.estimate.rig_runs import drive_by_currents
from omnimj.parameters import read_floors, read_rig
from omnimj.plant.faults import Fault
from omnimj.plant.ground import Patch
from omnimj.plant.mujoco.twin import RigTwin
from omnimj.plant.planar_rig import PlanarRig
from omnimj.signals import CurrentCommand
from omnimj.simulate import loop
from omnimj.simulate.compiled.run import compiled_rig_loop
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.driving import drive_rig, drive_rig_stepwise
from omnimj.simulate.loop import Callbacks

EFFECTS = {
    "rail_viscous": {"coefficient": 2.0},
    "backlash": {"angle": 0.01},
    "supply_sag": {"resistance": 0.5},
    "sensor_delay": {"channel": "wheel_speed", "delay": 0.0035},
}
RIG, CHANGED, FLOORS = read_rig(), with_effects(read_rig(), EFFECTS), read_floors()
FAULTS = (
    Fault("slip", 0.4, 0.6, 1, {"grip": 0.1}),
    Fault("motor", 0.5, None, 1, {"loss": 0.5}),
    Fault("wheel_radius", 0.6, None, 1, {"scale": 1.02}),
    Fault("free", 0.7, 0.8, 1, {}),
    Fault("sensor", 0.3, None, None, {"channel": "current", "mode": "drift", "size": 0.2}),
    Fault("sensor", 0.55, 0.75, None, {"channel": "wheel_speed", "mode": "noise", "size": 0.1}),
)
CURRENT = np.where(np.arange(1100) % 500 < 300, 0.9, -0.7)
"""Longer than the sensors' noise is drawn ahead, twice [A]."""


def planar(rig=RIG, **options):
    return PlanarRig(rig, "natural_stone", seed=4, **options)


def twin(rig=RIG, **options):
    return RigTwin(rig, FLOORS["natural_stone"], seed=4, **options)


def both(make, callbacks=(loop.NO_CALLBACKS, loop.NO_CALLBACKS), current=CURRENT):
    """Traces of the compiled and of the stepwise loop."""
    plants = make(), make()
    assert compiled_rig_loop(plants[0]) is not None
    traces = drive_rig(plants[0], current, callbacks[0]), drive_rig_stepwise(plants[1], current, callbacks[1])
    assert_same(*traces)
    return traces[0]


@pytest.mark.parametrize("make", [planar, twin])
@pytest.mark.parametrize("lateral_speed", [0.0, -0.3])
def test_changing_conditions_effects_and_sideways_motion_leave_no_difference(make, lateral_speed):
    plain = both(lambda: make(lateral_speed=lateral_speed))
    assert not plain.about["interrupted"] and plain["wheel_speed"].max() > 5.0
    found = both(lambda: make(CHANGED, faults=FAULTS, lateral_speed=lateral_speed))
    for name in ("wheel_speed", "current", "true_wheel_speed"):
        assert np.abs(found[name] - plain[name])[450:].max() > 0.1, name


def test_patches_substeps_and_measured_currents_leave_no_difference():
    patches = (Patch("pvc", (0.2, 0.0), (0.3, 2.0)),)
    options = {"faults": FAULTS[:2], "patches": patches, "timestep": 2.5e-4}
    found = both(lambda: twin(CHANGED, lateral_speed=0.2, **options))
    assert np.abs(found["slip_velocity_1"] - both(twin)["slip_velocity_1"]).max() > 0.01
    both(lambda: twin(measured_current=True, ideal_sensors=True))
    both(lambda: planar(published=True))


@pytest.mark.parametrize("make", [planar, twin])
def test_a_rig_that_is_driven_again_gives_the_same_trace(make):
    rig = make(CHANGED, faults=FAULTS, lateral_speed=0.2)
    assert_same(drive_rig(rig, CURRENT), drive_rig(rig, CURRENT))


@pytest.mark.parametrize("make", [planar, twin])
def test_a_truth_beyond_all_bounds_ends_both_loops_at_the_same_row_with_the_same_words(make, monkeypatch):
    monkeypatch.setattr(loop, "LARGEST_TRUTH", 24.0)  # the wheel turns faster
    found = both(lambda: make(mass=2.0), current=np.full(3000, 1.5))
    assert found.about["failure"] and 50 < len(found["time"]) < 3000


@pytest.mark.parametrize("make", [planar, twin])
def test_progress_poses_and_ctrl_c_come_as_from_the_stepwise_loop(make):
    seen = ([], [], []), ([], [], [])

    def callbacks(into):
        def stop(done, total):
            into[0].append((done, total))
            if done >= 300:
                raise KeyboardInterrupt

        return Callbacks(
            progress=stop,
            snapshot=lambda now, pose: into[1].append((now, *pose)),
            rows=lambda names, rows: into[2].append((names, rows.copy())),
        )

    found = both(make, (callbacks(seen[0]), callbacks(seen[1])))
    assert found.about["interrupted"] and len(found["time"]) == 300
    assert seen[0][:2] == seen[1][:2] and seen[0][0] == [(k, len(CURRENT)) for k in (100, 200, 300)]
    assert len(seen[0][1]) == (0 if make is planar else 15)
    for (names, rows), (other_names, other_rows) in zip(seen[0][2], seen[1][2], strict=True):
        assert names == other_names and np.array_equal(rows, other_rows)


def test_a_rig_with_a_step_of_its_own_or_under_a_detector_is_driven_step_by_step():
    class Counting(PlanarRig):
        steps = 0

        def step(self, command):
            Counting.steps += 1
            return super().step(command)

    plant = Counting(RIG, "natural_stone", seed=4)
    assert compiled_rig_loop(plant) is None
    trace = drive_rig(plant, CURRENT[:200])
    assert Counting.steps == 199
    assert_same(trace, drive_rig(planar(), CURRENT[:200]))
    detector = make_detector("published", read_scenario("rig_constant_current"))
    watched = drive_rig(planar(), CURRENT[:200], detector=detector)
    assert len(watched.columns) > len(trace.columns)
    assert all(np.array_equal(watched[name], trace[name]) for name in trace.columns)


@pytest.mark.parametrize("make", [planar, twin])
@pytest.mark.parametrize("start", [(0.0, 0.0), (0.3, 5.0)])
def test_a_replay_by_currents_equals_steps_of_the_plant(make, start):
    options = {"measured_current": True, "ideal_sensors": True, "lateral_speed": 0.2, "faults": FAULTS[:4]}
    plant = make(CHANGED, **options)
    first = plant.reset()
    rows = [(first.wheel_speed, first.carriage_speed, first.carriage_acceleration)]
    if any(start):
        plant.set_speeds(*start)
        rows = [(start[1], start[0], first.carriage_acceleration)]
    for k in range(1, len(CURRENT)):
        m = plant.step(CurrentCommand(CURRENT[k : k + 1]))
        rows.append((m.wheel_speed, m.carriage_speed, m.carriage_acceleration))
    assert np.array_equal(drive_by_currents(make(CHANGED, **options), CURRENT, start), rows)
