"""Scenarios over both links in lock-step: diagnoses and, but for quantisation, trace are the plant's own."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from nightly import representative
from wired_devices import served

from omnimj.cli.main import main
from omnimj.link.host.frame_log import FrameRecording
from omnimj.plant.mujoco.twin import RobotTwin
from omnimj.signals import CurrentCommand
from omnimj.simulate.plants import LinkOptions, make_plant
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are of POSIX")
CLOSE = 1e-9
"""In every column's unit: what calibration there and back adds to a double. A command that is rounded to
float32 may flip a sensor's last bit, and the runs part there; so the twin alone is given rounded ones too."""
COLUMNS = ("current", "wheel_speed", "acceleration_x", "acceleration_y", "yaw_rate", "yaw", "current_target")


def as_on_the_wire(scenario, plant, monkeypatch):
    """The run of a plant whose currents have been through float32, as on a wire."""
    with monkeypatch.context() as patched:
        step = RobotTwin.step
        rounded = lambda current: current.astype(np.float32).astype(float)  # noqa: E731
        patched.setattr(
            RobotTwin, "step", lambda self, c: step(self, CurrentCommand(rounded(c.current), c.brake))
        )
        return run_scenario(scenario, plant, "robust")


@posix
@pytest.mark.parametrize(
    ("name", "duration", "link"),
    representative(
        *(
            ("degraded_motor", 2.5, "serial"),
            ("degraded_motor", 4.5, "serial"),
            ("degraded_motor", 4.5, "udp"),
        ),
        *(("nylon_patch", 4.0, "udp"), ("nylon_patch", 4.0, "serial")),
    ),
)
def test_over_a_wire_the_diagnoses_and_the_trace_are_those_of_the_plant(
    name, duration, link, measured, monkeypatch
):
    plant = "twin"
    scenario = read_scenario(name, [f"duration={duration}"])
    never_rounded = run_scenario(scenario, plant, "robust")
    alone = as_on_the_wire(scenario, plant, monkeypatch)
    behind = make_plant(scenario, plant, 0)
    try:
        with served(behind, link) as address:
            wired = run_scenario(scenario, address, "robust", link=LinkOptions(lock_step=True))
    finally:
        behind.close()
    assert wired.trace.about["failure"] is None
    assert np.allclose(wired.trace["time"], alone.trace["time"], rtol=0.0, atol=1e-9)
    results = [
        [(d["kind"], d["wheels"], round(d["time"], 9)) for d in run.metrics["diagnoses"]]
        for run in (never_rounded, alone, wired)
    ]
    assert results[0] == results[1] == results[2] and results[0]
    for column in COLUMNS:
        names = [c for c in alone.trace.columns if c == column or c.startswith(column + "_")]
        for one in (c for c in names if c in (column, *(f"{column}_{i}" for i in range(1, 5)))):
            away = wired.trace[one] - alone.trace[one]
            if column == "yaw":
                away = (away + np.pi) % (2.0 * np.pi) - np.pi
            worst = float(np.abs(away).max())
            measured(f"{name} over {link}, {plant}: {column}", worst, CLOSE)
            assert worst <= CLOSE, one
    assert wired.metrics["truth"] is False and wired.metrics["faults"] == []
    unjudged = {c["name"] for c in wired.metrics["checks"] if not c.get("judged", True)}
    assert {"tracking_error_max", "false_alarms"} <= unjudged
    assert not any(c["ok"] for c in wired.metrics["checks"] if c["name"] in unjudged)


@pytest.fixture
def driven_folder(tmp_path, monkeypatch):
    """A run over a link by the command line, its folder and exit code."""

    def touch(path, *_):
        path.touch()

    monkeypatch.setattr("omnimj.view.report.run.write_report", touch)
    monkeypatch.setattr("omnimj.view.rerun.recording.write_recording_of", touch)
    monkeypatch.setattr("omnimj.cli.run._picture_of", lambda *_: None)
    behind, out = make_plant(read_scenario("degraded_motor"), "planar", 0), tmp_path / "run"
    with served(behind, "udp") as address:
        words = ["--set", "duration=2.5", "--plant", address, "--lock-step", "--out", str(out)]
        code = main(["run", "degraded_motor", *words])
    behind.close()
    return out, code


@pytest.mark.slow
def test_a_run_keeps_every_frame_and_they_are_diagnosed_as_the_run_was(driven_folder, tmp_path, monkeypatch):
    out, code = driven_folder
    assert code in (0, 1)
    metrics = json.loads((out / "metrics.json").read_text())
    recording = FrameRecording(out / "frames.bin")
    frames = list(recording)
    assert recording.is_whole and recording.dropped == 0
    # the three stops of the end are not in metrics, which is older
    assert len(frames) == metrics["link"]["sent"] + metrics["link"]["received"] + 3
    monkeypatch.setattr("omnimj.view.report.diagnosis.write_diagnosis_report", lambda path, *_: path.touch())
    assert main(["diagnose", str(out), "--out", str(tmp_path / "diagnosed")]) == 0
    recomputed = json.loads((tmp_path / "diagnosed" / "diagnoses.json").read_text())["runs"]["degraded_motor"]
    first, again = metrics["diagnoses"][0], recomputed["diagnoses"][0]
    assert (first["kind"], first["wheels"]) == (again["kind"], again["wheels"])
    assert again["time"] == pytest.approx(first["time"], abs=0.02)
    # a program that is killed leaves half a record
    (out / "frames.bin").write_bytes((out / "frames.bin").read_bytes()[:-7])
    cut = FrameRecording(out / "frames.bin")
    assert len(list(cut)) == len(frames) - 1 and not cut.is_whole


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["--plant", "udp:nowhere"], "whole number"),
        (["--plant", "udp:127.0.0.1:9", "--compare"], "more than once"),
        (["--lock-step"], "there is no wire"),
        (["--plant", "twin", "--readonly"], "there is no wire"),
        (["--plant", "udp:127.0.0.1:9", "--readonly", "--lock-step"], "time stands still"),
        (["--plant", "udp:192.0.2.1:9"], "key"),
        (["--plant", "udp:127.0.0.1:9", "--key-file", "/nowhere"], "key file"),
        (["--plant", "serial:/dev/nowhere"], "cannot be opened"),
    ],
)
def test_a_wrong_flag_of_a_wire_is_one_line(given, words, capsys):
    assert main(["run", "nylon_patch", *given]) == 2
    err = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("compiling")]
    assert len(err) == 1 and words in err[0], err


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([], "--udp --serial"),
        (["--udp", "0.0.0.0:9750"], "key"),
        (["--udp", "9750", "--plant", "udp:1"], "unknown plant"),
        (["--udp", "9750", "--scenario", "rig_slip"], "scenario of the robot"),
        (["--udp", "9750", "--defect", "smell:yaw"], "unknown kind"),
        (["--udp", "9750", "--defect", "gain:yaw"], "gain:PLACE:VALUE"),
        (["--udp", "9750", "--defect", "gain:yaw:nan"], "finite"),
        (["--udp", "0", "--serial", "x"], "not allowed with"),
        (["--serial", "/dev/nowhere"], "cannot be opened"),
    ],
)
def test_a_wrong_flag_of_the_device_is_one_line(given, words, capsys):
    assert main(["device", *given]) == 2
    err = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("compiling")]
    assert len(err) == 1 and words in err[0], err
