import pickle
from dataclasses import replace

import numpy as np
import pytest
from driven_missions import as_dataset, as_run, driven
from healthy_recordings import (
    axis_runs,
    both,
    frozen,
    late,
    rig_reversals,
    rig_steps,
    robot_missions,
    scaled,
    spoilt,
)
from mentions import mentions

from omnimj.effects import effects_of
from omnimj.errors import DataFaultError, InputError
from omnimj.estimate.gap.check.acceptance import (
    check_dataset,
    fault_records,
    holding_back,
    longest_delay,
    sound_dataset,
    sound_logs,
)
from omnimj.estimate.gap.check.suspicions import GROSS
from omnimj.parameters import read_robot
from omnimj.recording.dataset import Dataset
from omnimj.workflows import record

ROBOT = read_robot()
HELD = {
    "time in ms": (axis_runs, scaled("time", 1e3), "time_base"),
    "positions in mm": (axis_runs, scaled("position", 1e3), "unit"),
    "force of the other sign": (axis_runs, scaled("force", -1.0), "sign"),
    "current of the other sign": (rig_reversals, scaled("current", -1.0), "sign"),
    "speed 60 ms late": (rig_steps, late("carriage_speed", 0.06), "delay"),
    "gyro in degrees": (robot_missions, scaled("yaw_rate", 57.3), "unit"),
}
GOES_ON = {
    "speed 40 ms late": (rig_steps, late("carriage_speed", 0.04)),
    "position 10 ms late": (axis_runs, late("position", 0.01)),
    "current with a gain of 1.2": (rig_steps, scaled("current", 1.2)),
    "accelerometer with a gain of 1.3": (rig_steps, scaled("carriage_acceleration", 1.3)),
    "frozen gyro": (robot_missions, frozen("yaw_rate", 200)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", HELD)
def test_a_certain_fault_holds_the_data_back_and_is_named_in_one_line(name):
    recorded, change, kind = HELD[name]
    broken = spoilt(recorded(0), change)
    with pytest.raises(DataFaultError) as caught:
        sound_dataset(broken, None)
    message = str(caught.value)
    assert "\n" not in message and isinstance(caught.value, InputError)
    assert mentions(message, str(broken.path), kind.replace("_", " "), "[columns]", "--accept")


@pytest.mark.slow
@pytest.mark.parametrize("name", HELD)
def test_accepted_data_go_on_with_notes_and_units_corrected(name):
    recorded, change, kind = HELD[name]
    own = recorded(0)
    sound, check = sound_dataset(spoilt(own, change), None, accept=True)
    assert check.suspicions[0].kind == kind
    assert sound.notes[: len(check.notes)] == check.notes
    if kind in ("time_base", "unit"):
        assert any("divided by" in note for note in sound.notes)
        assert not holding_back(check_dataset(sound), sound.plant)
        for run, whole in zip(sound.runs, own.runs, strict=True):
            np.testing.assert_allclose(run.time, whole.time, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", GOES_ON)
def test_what_the_search_may_name_is_reported_and_not_held_back(name):
    recorded, change = GOES_ON[name]
    sound, check = sound_dataset(spoilt(recorded(0), change), None)
    assert sound.notes == check.notes


def test_all_certain_faults_are_in_the_message_the_most_important_first():
    broken = spoilt(axis_runs(0), both(scaled("time", 1e3), scaled("velocity", 1e3), scaled("force", -1.0)))
    with pytest.raises(DataFaultError) as caught:
        sound_dataset(broken, None)
    message = str(caught.value)
    assert "3 sure faults" in message
    places = [message.index(word) for word in ("time base: ", "unit: velocity", "sign: force")]
    assert places == sorted(places)


@pytest.mark.parametrize("plant", ["quarter_rig", "uto_robot", "linear_axis"])
def test_effects_of_twice_their_typical_size_lie_below_what_holds_data_back(plant):
    for effect in effects_of(plant).values():
        for p in effect.parameters:
            if p.name == "delay":
                assert 2.0 * p.typical < longest_delay(plant) <= 0.05
            if p.name == "scale" and effect.where == "sensors":
                assert 1.0 / 3.0 < 1.0 + 2.0 * (p.typical - 1.0) < np.exp(GROSS)


def test_the_error_travels_between_processes():
    error = DataFaultError("data", ["time base: x"], "rule")
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again)) == (DataFaultError, str(error))


def test_records_of_faults_are_plain_and_most_important_first():
    broken = spoilt(rig_steps(0), both(scaled("current", -1.0), frozen("wheel_speed", 100)))
    first, *rest = fault_records(check_dataset(broken))
    assert (first["channel"], first["kind"], first["size"], first["sure"]) == ("current", "sign", -1.0, True)
    assert [one["kind"] for one in rest] == ["frozen"]
    assert set(first) == {"channel", "kind", "size", "sure", "words", "or_channels", "runs"}


MACHINES_WITH_EFFECTS = [
    ("axis_moves", "sensor_delay", {"channel": "force", "delay": 0.005}),
    ("rig_currents", "torque_constant", {"scale": 0.9}),
    ("axis_moves", "payload", {"mass": 5.0}),
    ("axis_moves", "current_scale", {"scale": 1.05}),
    ("axis_moves", "backlash", {"angle": 2e-4}),
    ("rig_currents", "sensor_delay", {"channel": "carriage_speed", "delay": 0.02}),
]


@pytest.mark.slow
@pytest.mark.parametrize("suite, effect, values", MACHINES_WITH_EFFECTS)
def test_a_machine_with_an_effect_of_typical_size_is_searched(tmp_path, suite, effect, values):
    recorded = record(suite, tmp_path / "runs", 7, 1, "planar", effects={effect: values})
    sound, _ = sound_dataset(recorded, None)
    assert sound.plant == recorded.plant


FAULTY_MACHINES = {
    "weak motor": lambda: as_dataset(as_run(driven(weak=True))),
    "dead encoder": lambda: changed("wheel_speed_2", lambda v, late: np.where(late, 0.0, v)),
    "encoder of the other sign, from the middle on": lambda: changed(
        "wheel_speed_2", lambda v, late: np.where(late, -v, v)
    ),
    "current monitor at the end of its range": lambda: changed(
        "current_1", lambda v, late: np.where(late, 5.0, v)
    ),
    "gyro that sticks": lambda: changed("yaw_rate", lambda v, late: np.where(late, 0.3, v)),
}


def changed(name: str, change) -> Dataset:
    """A mission with a channel changed from a third of it on."""
    own = as_run(driven())
    late = np.arange(len(own.time)) > len(own.time) // 3
    return as_dataset(replace(own, columns={**own.columns, name: change(own.columns[name], late)}))


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTY_MACHINES)
def test_a_diagnosis_gets_logs_of_a_faulty_machine_as_they_are(name):
    logs = FAULTY_MACHINES[name]()
    sound, check = sound_logs(logs, ROBOT)
    assert sound == logs and check.suspicions == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, factor",
    [("time", 1e3), ("current_2", -1.0), ("yaw", 180.0 / np.pi), ("yaw_rate", -1.0), ("current_2", 1e3)],
)
def test_a_diagnosis_refuses_logs_that_are_wrong_throughout(name, factor):
    broken = spoilt(robot_missions(0), scaled(name, factor))
    with pytest.raises(DataFaultError):
        sound_logs(broken, ROBOT)
    sound, _ = sound_logs(broken, ROBOT, accept=True)
    assert sound.notes
