"""`omnimj calibrate`: thresholds from fault-free recordings, and who takes them."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import re
import tomllib

import numpy as np
import pytest
from driven_missions import as_run, driven
from mentions import mentions

from omnimj.cli.main import main
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.detection.robust.thresholds import THRESHOLD_UNITS, Thresholds, read_thresholds
from omnimj.diagnosis import calibration as calibrating
from omnimj.diagnosis import model_misfit
from omnimj.diagnosis.calibration import lower_bounds
from omnimj.diagnosis.detectable_loss import LossInformation
from omnimj.diagnosis.logs import read_machine
from omnimj.diagnosis.model_misfit import inject
from omnimj.diagnosis.replay import DiagnosisConfig
from omnimj.estimate.gap.check import acceptance
from omnimj.parameters import read_floors
from omnimj.recording.dataset import Run
from omnimj.recording.read_dataset import read_dataset
from omnimj.recording.write_dataset import write_dataset
from omnimj.simulate.suites.catalogue import find_suite
from omnimj.simulate.suites.recording import RecordingConfig, record_suite

FLOOR = {"floor": "natural_stone"}
RATES = (100.0, 0.1, 0.001)


@pytest.fixture(scope="module", autouse=True)
def checked_once():
    """Recordings are checked for faults of their data at their first command only."""
    found, check = {}, acceptance.sound_dataset

    def first(dataset, machine, accept):
        key = dataset.path, accept
        if key not in found:
            found[key] = check(dataset, machine, accept)
        return found[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(acceptance, "sound_dataset", first)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three healthy missions: a minute and a bit of motion."""
    path = tmp_path_factory.mktemp("data") / "healthy"
    runs = [as_run(driven(28.0, seed), f"healthy_{seed}") for seed in (11, 12, 13)]
    write_dataset(path, "uto_robot", FLOOR, runs)
    return path


@pytest.fixture(scope="module")
def files(folder, tmp_path_factory):
    """`thresholds.toml` by rate."""
    out = tmp_path_factory.mktemp("out")
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        # what is seen in the recordings does not depend on the rate
        patch.setattr(calibrating, "_maxima", seen_in)
        # a minute of motion is too short for these rates, which is weighed elsewhere, as is what remains
        patch.setattr(calibrating, "_misfit", lambda *_: None)
        patch.setattr(calibrating, "replay_all", unless_checking)
        for rate in RATES:
            found[rate] = out / f"{rate:g}.toml"
            argv = ["calibrate", str(folder), "--false-alarms-per-hour", str(rate)]
            assert main([*argv, "--out", str(found[rate])]) == 0
    return found


def unless_checking(config, progress, phase, *watch, passes=calibrating.replay_all):
    """Replays of a phase; those that look for remaining diagnoses find none."""
    return [] if phase == "checking" else passes(config, progress, phase, *watch)


def seen_in(config, progress, *, measure=calibrating._maxima, found={}):  # noqa: B006 it is kept
    """Maxima in recordings, measured at their first command only."""
    if config.dataset.path not in found:
        found[config.dataset.path] = measure(config, progress)
    return found[config.dataset.path]


@pytest.mark.slow
def test_thresholds_are_never_below_their_floor_and_rise_when_the_rate_falls(files):
    found = {rate: read_thresholds(file) for rate, file in files.items()}
    for rate, thresholds in found.items():
        chance = math.log(3600.0 / rate * 100.0 * 10)
        for name in ("motor", "drag", "accelerometer"):
            assert getattr(thresholds, name) >= chance - 1e-9
        assert thresholds.slip >= Thresholds().slip
    for name in THRESHOLD_UNITS:
        values = [getattr(found[rate], name) for rate in RATES]
        assert all(a <= b for a, b in itertools.pairwise(values))
        # what health never showed in these recordings stays at its floor, whatever the rate
        assert values[0] < values[-1] or (
            name in ("slip", "worn") and values[-1] == lower_bounds(0.1, 4)[name]
        )


@pytest.mark.slow
def test_the_file_states_its_origin(files, folder):
    content = tomllib.loads(files[0.1].read_text(encoding="utf-8"))["calibration"]
    assert (
        content["dataset"] == str(folder) and content["false_alarms_per_hour"] == 0.1 and content["version"]
    )
    assert 60.0 / 3600.0 < content["hours"] < 90.0 / 3600.0
    assert set(content["largest"]) == set(THRESHOLD_UNITS)
    largest = read_thresholds(files[0.001])
    assert all(0.0 <= content["largest"][name] < getattr(largest, name) for name in THRESHOLD_UNITS)


@pytest.fixture
def weighed_once(monkeypatch):
    """Recordings are calibrated with at the first command only, with few losses injected.

    The calibration does not depend on whether its thresholds are accepted; how many injected losses are found
    is a test of its own.
    """
    found, calibrate = [], calibrating.calibrate

    def first(*arguments):
        if not found:
            found.append(calibrate(*arguments))
        return found[0]

    monkeypatch.setattr(calibrating, "_maxima", seen_in)
    monkeypatch.setattr(calibrating, "calibrate", first)
    monkeypatch.setattr(model_misfit, "INJECTIONS", 4)


@pytest.mark.slow
def test_the_extent_of_extrapolation_is_printed(weighed_once, folder, files, tmp_path, capsys):
    text = files[0.1].read_text(encoding="utf-8")
    assert mentions(text, "0.1 false alarms per hour", "one in 10 h", "-fold")
    assert mentions(text, "on natural_stone")
    assert "warning" in text and "less than 1 h" in text
    file = tmp_path / "t.toml"
    file.touch()
    argv = ["calibrate", str(folder), "--false-alarms-per-hour", "0.1", "--out", str(file), "--force"]
    assert main([*argv, "--json"]) == 1 and not file.read_text(encoding="utf-8")
    held_back = json.loads(capsys.readouterr().out)
    assert held_back["written"] is None and not any(r["is_seen"] for r in held_back["misfit"]["raised"])
    assert main([*argv, "--json", "--accept"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["extrapolated"] == pytest.approx(10.0 / content["hours"])
    assert set(content["thresholds"]) == set(THRESHOLD_UNITS)
    assert content["still_diagnosed"] == {} and len(content["warnings"]) == 1
    assert read_thresholds(file) == read_thresholds(files[0.1])


@pytest.fixture(scope="module")
def misfitting(tmp_path_factory):
    """Healthy missions of a robot with an axle far off its direction, which its model does not know of."""
    path = tmp_path_factory.mktemp("data") / "twisted"
    effects = {"wheel_misalignment": {"wheel": 1, "angle": 0.6}}
    config = RecordingConfig(path, plant="planar", effects=effects)
    record_suite(find_suite("robot_missions"), config, choose=lambda planned: planned[:4])
    return path


@pytest.mark.slow
def test_a_model_that_does_not_fit_raises_no_threshold_without_a_word(
    weighed_once, misfitting, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(calibrating, "replay_all", unless_checking)  # what remains is weighed elsewhere
    file = tmp_path / "t.toml"
    argv = ["calibrate", str(misfitting), "--false-alarms-per-hour", "0.1", "--out", str(file)]
    assert main(argv) == 1 and not file.exists()
    printed = capsys.readouterr().out
    assert mentions(printed, "nothing written", "--accept") and "the model does not fit" in printed
    assert re.search(r"\w+: .* × the shipped .*largest while \w+", printed)
    assert main([*argv, "--accept", "--json"]) == 0 and file.exists()
    content = json.loads(capsys.readouterr().out)
    assert content["written"] == str(file)
    raised = {one["name"]: one for one in content["misfit"]["raised"]}
    assert any(one["is_seen"] for one in raised.values())
    for name, one in raised.items():
        assert one["value"] == content["thresholds"][name]["value"] > 1.5 * one["shipped"]
        assert one["regime"] is None or 0 < one["regime"]["largest"] <= one["regime"]["of"]
    now, before = content["misfit"]["motor"], content["misfit"]["shipped_motor"]
    assert now["loss"] is None or now["loss"] > before["loss"]
    # the reason and the cost travel with the numbers
    comments = [line for line in file.read_text("utf-8").splitlines() if line.startswith("#")]
    assert mentions(
        " ".join(comments), "× the shipped", "largest while", "a sudden motor loss is", "expected"
    )


@pytest.mark.slow
def test_the_loss_that_is_stated_as_detectable_is_found_where_it_is_injected(folder):
    """The expected statistic against the detector itself, on healthy runs and with the shipped thresholds."""
    dataset = read_dataset(folder)
    config = DiagnosisConfig(dataset, read_machine(dataset), "robust", read_floors())
    quiet = dataclasses.replace(config, thresholds=calibrating.DISABLED)
    detector = quiet.detector_for(dataset.runs[0])
    information = LossInformation(4, detector.constants.model)
    calibrating.replay_all(quiet, None, "", information)
    expected = information.detectable(Thresholds().motor)
    assert expected.loss is not None and 0.1 < expected.loss < 0.4
    for loss, least, most in ((0.5 * expected.loss, 0.0, 0.35), (2.0 * expected.loss, 0.75, 1.0)):
        found = inject(config, loss, information.onsets, 4)
        delays = information.delays(loss, Thresholds().motor)
        share = np.isfinite(delays).mean()
        assert found.tried == 40 and least <= found.found / found.tried <= most
        assert abs(found.found / found.tried - share) < 0.2
    assert found.delay == pytest.approx(np.median(delays[np.isfinite(delays)]), abs=0.2)


@pytest.mark.slow
def test_diagnose_run_and_evaluate_take_them(files, folder, tmp_path, capsys):
    given = ("--thresholds", str(files[0.1]))
    assert main(["diagnose", str(folder), *given, "--json", "--out", str(tmp_path / "d")]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["thresholds"]["motor"] == read_thresholds(files[0.1]).motor
    assert not any(run["diagnoses"] for run in content["runs"].values())
    short = ("--plant", "planar", "--set", "duration=0.2", "--set", "checks={}")
    assert main(["run", "nylon_patch", *short, *given, "--json"]) == 0
    case = ("--suite", "manoeuvres", "--trials", "1", "--faults", "none", "--method", "robust")
    assert main(["evaluate", *case, *given, "--out", str(tmp_path / "e")]) == 0
    plan = json.loads((tmp_path / "e" / "evaluation_plan.json").read_text(encoding="utf-8"))
    assert plan["thresholds"]["motor"] == read_thresholds(files[0.1]).motor


@pytest.mark.slow
def test_the_observer_of_a_gains_file_is_the_one_that_is_calibrated_and_that_diagnoses(
    folder, files, tmp_path, capsys
):
    gains = tmp_path / "gains.toml"
    gains.write_text('[observer]\nmemory = { value = 2.0, unit = "s", source = "tuned" }\n')
    file, rate = tmp_path / "t.toml", ["--false-alarms-per-hour", "0.1"]
    assert main(["calibrate", str(folder), *rate, "--gains", str(gains), "--accept", "--out", str(file)]) == 0
    brief, usual = read_thresholds(file), read_thresholds(files[0.1])
    assert brief.motor != usual.motor and brief.drag != usual.drag
    capsys.readouterr()
    argv = ["diagnose", str(folder), "--gains", str(gains), "--json", "--out", str(tmp_path / "d")]
    assert main(argv) == 0
    assert json.loads(capsys.readouterr().out)["observer"]["memory"] == 2.0


@pytest.mark.slow
def test_a_run_with_thresholds_decides_by_them(monkeypatch, files):
    from omnimj.simulate import run as running

    seen = []
    whole = running.make_detector

    def noting(*arguments):
        method = whole(*arguments)
        assert isinstance(method, RobustDetector)
        seen.append(method.thresholds)
        return method

    monkeypatch.setattr(running, "make_detector", noting)
    short = ("--plant", "planar", "--set", "duration=0.2", "--set", "checks={}")
    assert main(["run", "nylon_patch", *short]) == 0
    assert main(["run", "nylon_patch", *short, "--thresholds", str(files[0.1])]) == 0
    assert seen == [Thresholds(), read_thresholds(files[0.1])]


def test_less_data_give_no_lower_thresholds_by_chance_alone():
    assert lower_bounds(0.1, 4)["motor"] == pytest.approx(17.4, abs=0.01)
    assert lower_bounds(0.1, 4)["slip"] == Thresholds().slip
    assert lower_bounds(1e9, 4)["motor"] > 0.0


@pytest.fixture(scope="module")
def mission():
    """A short healthy mission, driven before anything forbids to drive."""
    return driven()


@pytest.mark.slow
def test_recordings_with_a_failed_sensor_or_little_motion_are_refused(mission, refused, tmp_path):
    gyro = np.array(mission["yaw_rate"])
    gyro[4000:] = gyro[4000]
    frozen = Run("frozen", {**as_run(driven()).columns, "yaw_rate": gyro}, {}, FLOOR)
    write_dataset(tmp_path / "frozen", "uto_robot", FLOOR, [frozen])
    rate = ("--false-alarms-per-hour", "1", "--out", "t.toml")
    message = refused("calibrate", str(tmp_path / "frozen"), *rate)
    assert "run 'frozen': sensor yaw_rate has failed at" in message
    assert "calibration needs fault-free recordings" in message
    write_dataset(tmp_path / "short", "uto_robot", FLOOR, [as_run(driven())])
    message = refused("calibrate", str(tmp_path / "short"), *rate)
    assert "s of motion; at least 60 s are needed" in message


def test_a_fault_in_the_recordings_is_warned_about(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(calibrating, "MIN_STRETCHES", 1)
    monkeypatch.setattr(calibrating, "STRETCH", 3.0)
    monkeypatch.setattr(calibrating, "_misfit", lambda *_: None)
    gyro = np.array(driven()["yaw"])
    gyro[5000:] = (gyro[5000:] + 0.2 * np.arange(len(gyro) - 5000) * 1e-3) % (2.0 * np.pi)
    turning = Run("turning", {**as_run(driven()).columns, "yaw": gyro}, {}, FLOOR)
    write_dataset(tmp_path / "data", "uto_robot", FLOOR, [turning])
    argv = ["calibrate", str(tmp_path / "data"), "--false-alarms-per-hour", "1", "--accept"]
    assert main([*argv, "--out", str(tmp_path / "t.toml")]) == 0
    assert mentions(capsys.readouterr().out, "warning", "turning", "1 diagnosis")


@pytest.mark.slow
@pytest.mark.parametrize("rate", ["0", "-1", "nan", "inf", "many", "1e-9", "1e9", "1_0", ""])
def test_a_rate_out_of_range_is_one_line(refused, folder, rate):
    message = refused("calibrate", str(folder), f"--false-alarms-per-hour={rate}", "--out", "t.toml")
    assert f"found {rate!r}; must be a number, at least 1e-06" in message


@pytest.mark.slow
def test_bad_flags_are_one_line(refused, folder, files, tmp_path):
    rate = ("--false-alarms-per-hour", "1")
    assert "required: --out" in refused("calibrate", str(folder), *rate)
    assert "required: --false-alarms-per-hour" in refused("calibrate", str(folder), "--out", "t.toml")
    assert "no such folder" in refused("calibrate", "nowhere", *rate, "--out", "t.toml")
    assert "exists already" in refused("calibrate", str(folder), *rate, "--out", str(files[0.1]))
    assert "is a folder" in refused("calibrate", str(folder), *rate, "--out", str(tmp_path))
    assert "is a dataset's folder" in refused(
        "calibrate", str(folder), *rate, "--out", str(folder / "t.toml")
    )
    assert "no such file" in refused(
        "calibrate", str(folder), *rate, "--model", "none.toml", "--out", "t.toml"
    )
    assert "unknown shipped" in refused("calibrate", str(folder), *rate, "--model", "none", "--out", "t.toml")
    channels = ("current", "wheel_speed", "carriage_speed", "carriage_acceleration")
    rig = {name: np.zeros(60) for name in channels}
    rig_run = Run("one", {"time": np.arange(60.0) / 1000.0, **rig}, {}, {**FLOOR, "mass": 4.0})
    write_dataset(tmp_path / "rig", "quarter_rig", FLOOR, [rig_run])
    message = refused("calibrate", str(tmp_path / "rig"), *rate, "--out", "t.toml")
    assert mentions(message, "plant", "'quarter_rig'", "robust", "robot")
