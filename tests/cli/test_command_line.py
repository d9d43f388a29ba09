"""The command line: exit codes, one line per error, files, and a quick start."""

from __future__ import annotations

import io
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest
from called_commands import called

from omnimj.cli.main import main, make_parser
from omnimj.cli.progress import ProgressBar
from omnimj.cli.terminal import format_table, format_value
from omnimj.plant.mujoco.twin import RobotTwin
from omnimj.plant.planar import PlanarRobot
from omnimj.recording.traces import read_trace
from omnimj.resources import scenarios_folder

SCHEMA = json.loads((Path(__file__).parent.parent / "schema" / "metrics.json").read_text(encoding="utf-8"))
SHORT = ("run", "nylon_patch", "--plant", "planar")
QUICK = (*SHORT, "--set", "duration=0.2", "--set", "checks={}")


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
    heavy = "{'numba', 'mujoco', 'bokeh', 'rerun', 'pyarrow', 'scipy'}"
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
    assert "FAILED" in out and "failed: 1 of 6 checks" in out


def test_json_is_the_content_of_metrics_json(capsys, tmp_path, plain_files):
    code, out, _ = called(capsys, *QUICK, "--json", "--seed", "7", "--out", str(tmp_path / "run"))
    assert code == 0
    printed = json.loads(out)
    jsonschema.validate(printed, SCHEMA)
    assert printed["seed"] == 7 and printed["plant"] == "planar" and printed["floor"] == "natural_stone"
    assert printed["command"].startswith("omnimj run nylon_patch --plant planar")
    assert json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8")) == printed


def test_out_holds_the_run_and_is_not_overwritten_without_force(capsys, tmp_path, undrawn, unrendered):
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
    assert all(path.stat().st_size > 1000 for path in out.iterdir())


def test_force_replaces_an_earlier_run_and_nothing_else(capsys, tmp_path, plain_files):
    (tmp_path / "mine.txt").write_text("precious")
    (tmp_path / "trace.parquet").write_text("old")
    assert called(capsys, *QUICK, "--out", str(tmp_path), "--force")[0] == 0
    assert (tmp_path / "mine.txt").read_text() == "precious"
    assert len(read_trace(tmp_path / "trace.parquet")["time"]) == 201


def test_one_seed_gives_one_run(capsys, tmp_path, plain_files):
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        assert called(capsys, *QUICK, "--seed", seed, "--out", str(tmp_path / name))[0] == 0
    first, second, other = (read_trace(tmp_path / name / "trace.parquet") for name in "abc")
    assert all((first[name] == second[name]).all() for name in first.columns)
    assert any((first[name] != other[name]).any() for name in first.columns)


@pytest.mark.parametrize("json_wanted", [False, True])
@pytest.mark.parametrize("plant", ["planar", "twin"])
def test_ctrl_c_exits_with_130_and_keeps_what_was_recorded(
    capsys, tmp_path, monkeypatch, plain_files, plant, json_wanted
):
    kind = PlanarRobot if plant == "planar" else RobotTwin
    step, steps = kind.step, []

    def interrupted(self, command):
        steps.append(None)
        if len(steps) == 100:
            raise KeyboardInterrupt
        return step(self, command)

    monkeypatch.setattr(kind, "step", interrupted)
    argv = [*QUICK[:2], "--plant", plant, *QUICK[4:], "--out", str(tmp_path / "run")]
    code, out, _ = called(capsys, *argv, *(["--json"] if json_wanted else []))
    assert code == 130
    assert len(read_trace(tmp_path / "run" / "trace.parquet")["time"]) == 100
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8"))
    jsonschema.validate(metrics, SCHEMA)
    assert metrics["interrupted"] and not metrics["passed"] and metrics["duration"] == pytest.approx(0.099)
    assert json.loads(out) == metrics if json_wanted else "interrupted" in out


def test_ctrl_c_while_files_are_written_keeps_those_that_are_whole(
    capsys, tmp_path, monkeypatch, plain_files
):
    def interrupted(path: Path, *_: object) -> None:
        path.write_text("half")
        raise KeyboardInterrupt

    monkeypatch.setattr("omnimj.view.report.run.write_report", interrupted)
    assert called(capsys, *QUICK, "--out", str(tmp_path))[0] == 130
    assert sorted(path.name for path in tmp_path.iterdir()) == ["metrics.json", "run.rrd", "trace.parquet"]


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
    lines = [line for line in err.splitlines() if not line.startswith("compiling native code")]
    assert len(lines) == 1 and "at 0.0000 s: x is nan" in lines[0]


def help_of(capsys, *command: str) -> str:
    with pytest.raises(SystemExit) as ended:
        main([*command, "--help"])
    assert ended.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("command", ["scenarios", "run", "bench"])
def test_every_sub_command_has_help_with_an_example_that_is_right(capsys, command):
    examples = help_of(capsys, command).split("example", 1)[1].splitlines()[1:]
    assert examples
    for line in examples:
        program, *argv = shlex.split(line)
        arguments, unknown = make_parser().parse_known_args(argv)
        assert program == "omnimj" and arguments.command == command and not unknown


def test_help_lists_every_command(capsys):
    text = help_of(capsys)
    for command in ("scenarios", "run", "bench"):
        assert f"\n    {command}" in text
    assert "omnimj run nylon_patch" in text


@pytest.mark.slow
def test_a_terminal_without_the_signs_shows_others():
    script = "import sys; from omnimj.cli.main import main; sys.exit(main(['run', 'circle_8m_kinematic']))"
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        check=False,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )
    assert done.returncode == 0 and b"<= 0.0168 m" in done.stdout and b">= 0.016 m" in done.stdout


@pytest.mark.parametrize(
    ("sink", "codes"), [("/dev/full", (1,)), (None, (0, 141))], ids=["full disk", "closed pipe"]
)
def test_a_closed_output_pipe_is_no_traceback(sink, codes):
    if sink and not Path(sink).exists():
        pytest.skip("this system has no /dev/full")
    read_end, write_end = os.pipe() if sink is None else (None, os.open(str(sink), os.O_WRONLY))
    if read_end is not None:
        os.close(read_end)
    script = "import sys; from omnimj.cli.main import main; sys.exit(main(['scenarios']))"
    done = subprocess.run(
        [sys.executable, "-c", script], stdout=write_end, stderr=subprocess.PIPE, check=False
    )
    os.close(write_end)
    assert done.returncode in codes and done.stderr.count(b"\n") == (1 if sink else 0)
    assert b"Traceback" not in done.stderr


@pytest.mark.slow
def test_a_reader_that_closes_the_pipe_costs_no_file(tmp_path):
    read_end, write_end = os.pipe()
    os.close(read_end)
    out = tmp_path / "out"
    script = "import sys; from omnimj.cli.main import main; sys.exit(main(sys.argv[1:]))"
    argv = ("run", "circle_8m_kinematic", "--set", "duration=0.5", "--set", "checks={}", "--out", str(out))
    done = subprocess.run(
        [sys.executable, "-c", script, *argv], stdout=write_end, stderr=subprocess.PIPE, check=False
    )
    os.close(write_end)
    assert done.returncode in (0, 141) and b"Traceback" not in done.stderr
    assert {"trace.parquet", "metrics.json", "report.html"} <= {one.name for one in out.iterdir()}


def test_the_kinematic_level_runs_without_a_plant(capsys, tmp_path, undrawn, unrendered):
    argv = (
        "run",
        "circle_8m_kinematic",
        "--set",
        "duration=2.0",
        "--set",
        "checks={}",
        "--json",
        "--out",
        str(tmp_path / "run"),
    )
    code, out, _ = called(capsys, *argv)
    assert code == 0 and json.loads(out)["plant"] == "kinematic"
    assert (tmp_path / "run" / "report.html").stat().st_size > 1000


def test_the_rig_runs(capsys, tmp_path, undrawn, unrendered):
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
    assert format_table(("a", "b"), [("xx", "1"), ("y", "22")]) == "a   b\nxx  1\ny   22"
    assert format_value(None) == "–" and format_value(0.12345, "m") == "0.1235 m" and format_value(2.0) == "2"
