"""What `omnimj run` prints of a diagnosis, and runs with the other methods beside it."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from called_commands import called_compiled

from omnimj.cli.run_summary import format_diagnoses
from omnimj.plant.planar import PlanarRobot
from omnimj.recording.traces import read_trace

pytestmark = pytest.mark.usefixtures("undrawn")

SCHEMA = json.loads((Path(__file__).parent.parent / "schema" / "metrics.json").read_text(encoding="utf-8"))
QUICK = ("run", "nylon_patch", "--plant", "planar", "--set", "duration=0.3", "--set", "checks={}")
RIG = ("run", "rig_slip", "--plant", "planar", "--set", "duration=0.1", "--set", "checks={}")


def record(time: float, kind: str, *wheels: int, **own):
    return {"time": time, "kind": kind, "wheels": list(wheels), "cleared": None, **own}


def summary(faults=(), diagnoses=(), method="robust") -> str:
    metrics = {"method": method, "faults": list(faults), "diagnoses": list(diagnoses)}
    return format_diagnoses(metrics, 4)


WEAK = {"kind": "motor", "wheel": 1, "onset": 0.8, "end": None, "loss": 0.57}


def test_truth_diagnosis_and_delay_stand_in_one_line():
    words = summary([WEAK], [record(0.85, "motor", 1)])
    assert words.splitlines()[1].split("  ") == [
        "motor loss, wheel 1 (loss 57 %) from 0.8 s",
        "motor loss, wheel 1",
        "0.850 s",
        "0.05 s",
    ]


def test_false_alarms_and_ambiguities_are_printed():
    words = summary([WEAK], [record(0.85, "motor", 1, ambiguous_with=["motor 3"]), record(2.0, "slip", 2)])
    assert "motor loss, wheel 1 or motor loss, wheel 3" in words
    assert [cell.strip() for cell in words.splitlines()[2].split("  ") if cell] == [
        "–",
        "slip, wheel 2",
        "2.000 s",
        "false alarm",
    ]


def test_no_diagnosis_is_printed_as_a_sentence():
    assert summary() == "diagnosis: no fault, and none was diagnosed"
    expected = "diagnosis: none; true faults: motor loss, wheel 1 (loss 57 %) from 0.8 s"
    assert summary([WEAK]) == expected
    assert summary([WEAK], method="off") == ""


def test_many_false_alarms_leave_the_checks_on_the_screen():
    channels = [record(1.0, "sensor", channel=f"channel_{k}") for k in range(40)]
    lines = summary([WEAK], channels).splitlines()
    assert len(lines) == 14 and lines[-1] == "and 29 more, in metrics.json"


def test_a_run_prints_its_diagnoses_after_its_checks(capsys):
    argv = ("run", "nylon_patch", "--plant", "planar", "--method", "published")
    _, out, _ = called_compiled(capsys, *argv, "--set", "duration=1.0", "--set", "checks={}")
    assert "no checks" in out and out.index("no checks") < out.index("true fault")
    assert "slip, wheel 1 (floor nylon) from 0 s" in out
    _, out, _ = called_compiled(capsys, *QUICK, "--method", "off")
    assert "diagnos" not in out.split("\n", 1)[1]


def test_compare_drives_every_method_of_the_machine_with_one_seed(capsys, tmp_path, plain_files):
    folder = tmp_path / "run"
    code, out, _ = called_compiled(capsys, *QUICK, "--compare", "--seed", "5", "--json", "--out", str(folder))
    assert code == 0
    metrics = json.loads(out)
    jsonschema.validate(metrics, SCHEMA)
    assert metrics["method"] == "robust" and set(metrics["compared"]) == {"published", "off"}
    for method, other in metrics["compared"].items():
        jsonschema.validate(other, SCHEMA)
        assert (other["method"], other["seed"], other["failure"]) == (method, 5, None)
        assert "compared" not in other
    expected = {"trace.parquet", "trace_off.parquet", "trace_published.parquet", "metrics.json"}
    assert {path.name for path in folder.iterdir()} == expected | {"run.rrd", "report.html"}
    for name, method in (("trace", "robust"), ("trace_off", "off"), ("trace_published", "published")):
        assert read_trace(folder / f"{name}.parquet").about["method"] == method
    alone = tmp_path / "alone"
    assert called_compiled(capsys, *QUICK, "--method", "off", "--seed", "5", "--out", str(alone))[0] == 0
    beside, own = (read_trace(path) for path in (folder / "trace_off.parquet", alone / "trace.parquet"))
    assert all(np.array_equal(beside[name], own[name]) for name in own.columns)


def test_an_earlier_comparison_leaves_no_trace_beside_a_new_run(capsys, tmp_path, plain_files):
    (tmp_path / "trace_mine.parquet").write_text("precious")
    assert called_compiled(capsys, *QUICK, "--compare", "--out", str(tmp_path), "--force")[0] == 0
    assert (tmp_path / "trace_off.parquet").exists()
    assert called_compiled(capsys, *QUICK, "--out", str(tmp_path), "--force")[0] == 0
    assert not (tmp_path / "trace_off.parquet").exists() and (tmp_path / "trace_mine.parquet").exists()


def test_the_rig_is_compared_with_what_it_has(capsys):
    code, out, _ = called_compiled(capsys, *RIG, "--compare")
    assert code == 0
    assert any(line.split() == ["published", "off"] for line in out.splitlines())


def test_a_comparison_where_there_is_no_other_method_is_refused(capsys, tmp_path):
    folder = tmp_path / "run"
    code, out, err = called_compiled(capsys, "run", "circle_8m_kinematic", "--compare", "--out", str(folder))
    assert (code, out, len(err)) == (2, "", 1)
    assert "--compare" in err[0] and "kinematic" in err[0] and not folder.exists()


@pytest.mark.slow
def test_a_report_sets_the_methods_side_by_side(capsys, tmp_path, unrendered):
    assert called_compiled(capsys, *QUICK, "--compare", "--out", str(tmp_path / "run"))[0] == 0
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    for words in ("Comparison of methods", "Diagnosis", "Courses", "Paths", "trace_off.parquet"):
        assert words in page


@pytest.mark.parametrize("steps", [450, 301])
def test_ctrl_c_while_the_others_are_driven_keeps_the_run_that_is_whole(
    capsys, tmp_path, monkeypatch, plain_files, steps
):
    step, taken = PlanarRobot.step, []

    def interrupted(self, command):
        taken.append(None)
        if len(taken) == steps:
            raise KeyboardInterrupt
        return step(self, command)

    monkeypatch.setattr(PlanarRobot, "step", interrupted)
    code, _, _ = called_compiled(capsys, *QUICK, "--compare", "--out", str(tmp_path / "run"))
    assert code == 130
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8"))
    assert metrics["passed"] and not metrics["interrupted"] and "off" not in metrics.get("compared", {})
    assert len(read_trace(tmp_path / "run" / "trace.parquet")["time"]) == 301


def test_another_method_that_breaks_down_is_reported_in_one_line_and_the_run_is_kept(
    capsys, tmp_path, monkeypatch, plain_files
):
    truth, calls = PlanarRobot.truth, []

    def broken(self):
        calls.append(None)
        return truth(self) * (float("nan") if len(calls) > 400 else 1.0)

    monkeypatch.setattr(PlanarRobot, "truth", broken)
    code, out, err = called_compiled(capsys, *QUICK, "--compare", "--out", str(tmp_path / "run"))
    assert code == 1 and "not judged: there is nothing to check" in out
    assert [line.split(" at ")[0] for line in err] == ["omnimj: method published:", "omnimj: method off:"]
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8"))
    assert metrics["failure"] is None and "x is nan" in metrics["compared"]["published"]["failure"]
