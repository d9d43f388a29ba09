"""The command line: exit codes, one line per error, files, and a quick start."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

from omnimj.cli.main import main
from omnimj.cli.progress import ProgressBar
from omnimj.cli.tables import shown, table
from omnimj.plant.planar import PlanarRobot
from omnimj.recording.traces import read_trace
from omnimj.resources import scenarios_folder

SCHEMA = json.loads((Path(__file__).parent.parent / "schema" / "metrics.json").read_text(encoding="utf-8"))
SHORT = ("run", "nylon_patch", "--plant", "planar")
QUICK = (*SHORT, "--set", "duration=0.2", "--set", "checks={}")


def called(capsys, *argv: str) -> tuple[int, str, str]:
    """Exit code, stdout, stderr."""
    code = main(list(argv))
    out, err = capsys.readouterr()
    return code, out, err


def refused(capsys, *argv: str) -> str:
    code, out, err = called(capsys, *argv)
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1 and err.startswith("omnimj")
    return err


def test_scenarios_lists_names_and_descriptions(capsys):
    code, out, _ = called(capsys, "scenarios")
    assert code == 0
    assert "nylon_patch" in out and len(out.splitlines()) == len(list(scenarios_folder().glob("*.toml")))
    code, out, _ = called(capsys, "scenarios", "--json")
    assert code == 0 and json.loads(out)["nylon_patch"].startswith("A nylon sheet")


def test_the_list_needs_no_heavy_import():
    heavy = "{'numba', 'mujoco', 'matplotlib', 'rerun', 'pyarrow', 'scipy'}"
    script = "import sys; from omnimj.cli.main import main; main(['scenarios'])"
    script += f"; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"


def test_a_run_that_holds_exits_with_0_and_prints_its_checks(capsys):
    code, out, _ = called(capsys, *SHORT)
    assert code == 0
    assert "peak_slip_1" in out and "≥ 0.15 m/s" in out and "passed" in out and "FAILED" not in out
    assert "\x1b" not in out and "\r" not in out


def test_a_run_that_does_not_hold_exits_with_1(capsys):
    code, out, _ = called(capsys, *SHORT, "--set", "checks.peak_slip_3=0.001")
    assert code == 1
    assert "FAILED" in out and "failed: 1 of 4 checks" in out


def test_json_is_the_content_of_metrics_json(capsys, tmp_path):
    code, out, _ = called(capsys, *QUICK, "--json", "--seed", "7", "--out", str(tmp_path / "run"))
    assert code == 0
    printed = json.loads(out)
    jsonschema.validate(printed, SCHEMA)
    assert printed["seed"] == 7 and printed["plant"] == "planar" and printed["floor"] == "natural_stone"
    assert printed["command"].startswith("omnimj run nylon_patch --plant planar")
    assert json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8")) == printed


def test_out_holds_the_run_and_is_not_overwritten_without_force(capsys, tmp_path):
    out = tmp_path / "a" / "run"
    assert called(capsys, *QUICK, "--out", str(out))[0] == 0
    assert sorted(p.name for p in out.iterdir()) == [
        "metrics.json",
        "report.html",
        "run.rrd",
        "trace.parquet",
    ]
    trace = read_trace(out / "trace.parquet")
    assert len(trace["time"]) == 201 and trace.about["scenario"] == "nylon_patch"
    assert "is not empty" in refused(capsys, *QUICK, "--out", str(out))
    assert called(capsys, *QUICK, "--out", str(out), "--force")[0] == 0


def test_one_seed_gives_one_run(capsys, tmp_path):
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        assert called(capsys, *QUICK, "--seed", seed, "--out", str(tmp_path / name))[0] == 0
    first, second, other = (read_trace(tmp_path / name / "trace.parquet") for name in "abc")
    assert all((first[name] == second[name]).all() for name in first.columns)
    assert any((first[name] != other[name]).any() for name in first.columns)


def test_ctrl_c_exits_with_130_and_keeps_what_was_recorded(capsys, tmp_path, monkeypatch):
    step, steps = PlanarRobot.step, []

    def interrupted(self, command):
        steps.append(None)
        if len(steps) == 100:
            raise KeyboardInterrupt
        return step(self, command)

    monkeypatch.setattr(PlanarRobot, "step", interrupted)
    code, out, _ = called(capsys, *QUICK, "--out", str(tmp_path / "run"))
    assert code == 130 and "interrupted" in out
    assert len(read_trace(tmp_path / "run" / "trace.parquet")["time"]) == 100
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8"))
    jsonschema.validate(metrics, SCHEMA)
    assert metrics["interrupted"] and not metrics["passed"]


def test_ctrl_c_before_anything_was_recorded_exits_with_130(capsys, tmp_path, monkeypatch):
    def interrupted(self):
        raise KeyboardInterrupt

    monkeypatch.setattr(PlanarRobot, "reset", interrupted)
    assert called(capsys, *QUICK, "--out", str(tmp_path / "run"))[0] == 130
    assert not (tmp_path / "run").exists()


def test_a_simulation_that_breaks_down_exits_with_1_and_one_line(capsys, monkeypatch):
    truth = PlanarRobot.truth
    monkeypatch.setattr(PlanarRobot, "truth", lambda self: truth(self) * float("nan"))
    code, out, err = called(capsys, *QUICK)
    assert code == 1 and out == ""
    told = [line for line in err.splitlines() if not line.startswith("compiling native code")]
    assert len(told) == 1 and "at 0.0000 s: x is nan" in told[0]


@pytest.mark.parametrize(
    ("argv", "told"),
    [
        ((), "required: COMMAND"),
        (("fly",), "invalid choice: 'fly'"),
        (("run",), "required: scenario"),
        (("run", "nylon_patch", "--seed", "x"), "invalid int value"),
        (("run", "nylon_patch", "--seed", "-1"), "--seed: found -1"),
        (("run", "nylon_patch", "--sede", "1"), "--sede"),
        (("run", "nylon_patch", "--force"), "there is no --out"),
        (("run", "nylon_path"), "did you mean 'nylon_patch'"),
        (("run", "no/such.toml"), "no such scenario file"),
        ((*SHORT, "--set", "floor=lava"), "unknown floor 'lava'"),
        ((*SHORT, "--set", "flor=pvc"), "unknown key 'flor'"),
        ((*SHORT, "--set", "faults.0.wheel=3"), "'faults' has 0"),
        ((*SHORT, "--set", "duration=-1"), "duration: found -1"),
        ((*SHORT, "--model", "no_such.toml"), "no_such.toml: no such file"),
        ((*SHORT, "--method", "robust"), "this version has no diagnosis yet; choices: off"),
        ((*SHORT, "--method", "published"), "this version has no diagnosis yet; choices: off"),
        (("run", "nylon_patch", "--plant", "serial:/dev/ttyUSB0?baud=1"), "drives no real robot"),
        (("run", "nylon_patch", "--plant", "udp:robot:9000"), "drives no real robot"),
        (("run", "nylon_patch", "--plant", "moon"), "unknown plant 'moon'"),
        (("run", "circle_8m_kinematic", "--plant", "planar"), "leave --plant out"),
    ],
)
def test_bad_input_exits_with_2_and_one_clear_line(capsys, argv, told):
    assert told in refused(capsys, *argv)


def test_a_broken_scenario_file_exits_with_2(capsys, tmp_path):
    broken = tmp_path / "broken.toml"
    broken.write_text("plant = \n")
    assert "is not valid TOML" in refused(capsys, "run", str(broken))


def test_a_file_that_may_not_be_read_exits_with_2(capsys, monkeypatch):
    def forbidden(self, mode="r"):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "open", forbidden)
    assert "nylon_patch.toml: Permission denied" in refused(capsys, *QUICK)


def test_nothing_is_driven_before_all_input_is_checked(capsys, tmp_path, monkeypatch):
    def driven(self):
        raise AssertionError("driven")

    monkeypatch.setattr(PlanarRobot, "reset", driven)
    (tmp_path / "mine.txt").write_text("")
    assert "is not empty" in refused(capsys, *QUICK, "--out", str(tmp_path))
    assert "is a file" in refused(capsys, *QUICK, "--out", str(tmp_path / "mine.txt"))
    assert "choices: off" in refused(capsys, *QUICK, "--method", "robust")


@pytest.mark.parametrize("command", ["scenarios", "run", "bench"])
def test_every_sub_command_has_help_with_an_example(capsys, command):
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    out = capsys.readouterr().out
    assert ended.value.code == 0
    assert f"omnimj {command}" in out.split("example", 1)[1]


def test_the_kinematic_level_runs_without_a_plant(capsys, tmp_path):
    argv = ("run", "circle_8m_kinematic", "--json", "--out", str(tmp_path / "run"))
    code, out, _ = called(capsys, *argv)
    assert code == 0 and json.loads(out)["plant"] == "kinematic"
    assert (tmp_path / "run" / "report.html").stat().st_size > 1000


def test_the_rig_runs(capsys, tmp_path):
    argv = ("run", "rig_lateral", "--plant", "planar", "--out", str(tmp_path / "run"))
    code, out, _ = called(capsys, *argv)
    assert code == 0 and "final_current" in out
    assert "lateral_speed" in read_trace(tmp_path / "run" / "trace.parquet")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_bar_shows_on_a_terminal_only_and_cleans_up():
    for stream, expected in ((io.StringIO(), ""), (Terminal(), " 50 %")):
        with ProgressBar(stream) as bar:
            bar.show(50, 100)
            bar.show(50, 100)
        assert expected in stream.getvalue() and stream.getvalue().count(" 50 %") <= 1
        assert bool(expected) == stream.getvalue().endswith("\r\x1b[K")


def test_a_table_aligns_its_columns():
    assert table(("a", "b"), [("xx", "1"), ("y", "22")]) == "a   b\nxx  1\ny   22"
    assert shown(None) == "–" and shown(0.12345, "m") == "0.1235 m" and shown(2.0) == "2"
