"""What a notebook shows of a record: a table that escapes every text, and Bokeh layouts by name."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import made_findings
import numpy as np
import pytest
from bokeh.models import Column, GlyphRenderer

from omnimj.diagnosis.calibration import CalibratedThreshold, Calibration, Tail
from omnimj.diagnosis.replay import DiagnosedRuns, RunDiagnosis
from omnimj.errors import UnknownNameError
from omnimj.estimate.drives.records import DrivenRun, DriveValidation, Group, Motion, RunNumbers
from omnimj.estimate.robot.records import RobotEstimate, RobotIdentification, Unexcited
from omnimj.parameters import read_rig, read_robot
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Diagnosis, Trace
from omnimj.simulate.run import RunResult
from omnimj.view import notebook

HOSTILE = "<script>alert('&')</script>"
WEAK = Diagnosis(2.0, "motor", (3,), 0.99, effectiveness=0.4)


class _Tags(HTMLParser):
    """Tags of a text, and whether each is closed."""

    def __init__(self, text: str):
        super().__init__()
        self.seen, self.open = set(), []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.seen.add(tag)
        if tag != "br":
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def run_result(trace, scenario, metrics) -> RunResult:
    about = {"plant": "twin", "method": "robust", "seed": 1, "floor": "pvc"}
    ended = {"interrupted": False, "failure": None}
    return RunResult(scenario, Trace(trace.columns, about | ended), metrics)


@pytest.fixture
def run(robot_trace, robot_scenario, robot_metrics) -> RunResult:
    scenario: Any = robot_scenario
    return run_result(robot_trace, scenario, robot_metrics | {"scenario": "circle_8m"})


def diagnosed(trace, name="run_1") -> RunDiagnosis:
    return RunDiagnosis(name, (WEAK,), 0.5, 10.0, trace, ("a note",), method="robust")


def calibration() -> Calibration:
    tail = CalibratedThreshold("slip_distance", 0.0123, Tail(0.1, 1.0, 0.1, 0.3), 0.01)
    return Calibration(0.1, 3.0, 7, ("pvc",), (tail,), ())


def robot_numbers() -> RobotIdentification:
    names = {"torque_constant": "N.m/A", "mass": "kg", "mass_ratio": "kg.A/N"}
    numbers = [
        RobotEstimate(name, name.replace("_", " "), unit, 1.1, 1.0, 1.2, 1.05, left)
        for (name, unit), left in zip(names.items(), (0.1, 0.6, 0.9), strict=True)
    ]
    fit: Any = SimpleNamespace(runs=(SimpleNamespace(name="a"),))
    open_number = Unexcited(numbers[2], "spin", 0.4)
    rest: dict[str, Any] = {"floors": (), "without_creep": (), "noise": {}, "seconds": 9.0}
    return RobotIdentification(
        Path("logs"), read_robot(), fit, tuple(numbers), (open_number,), residual=np.ones(3), **rest
    )


def drives() -> DriveValidation:
    time, pose = np.linspace(0.0, 1.0, 50), np.linspace(0.0, 1.0, 150).reshape(50, 3)
    motion = Motion(pose, np.zeros((50, 3)))
    runs = tuple(
        DrivenRun("r", plant, "pvc", time, np.ones((50, 3)), motion, motion, 0.2)
        for plant in ("twin", "rolling")
    )
    one, three = np.ones(3), np.zeros(3)
    group = Group("pvc", "twin", ("r",), 0.3, 0.3, 0.3, 0.02, three, one, 0.1, 0.01, 0.02, 0.03)
    numbers = RunNumbers("r", "twin", "pvc", 0.3, one, one, three, three, 1.0, 0.1, 0.1)
    return DriveValidation(
        Path("logs"), Path("m.toml"), (), ("twin", "rolling"), (group,), (numbers,), runs, {}, (), ()
    )


def test_a_run_shows_its_verdict_its_checks_and_its_diagnoses(run):
    text = run._repr_html_()
    assert "Circle 8m" in text and "method robust, seed 1" in text
    for check in run.metrics["checks"]:
        assert check["name"].replace("_", " ") in text
    assert not _Tags(text).open and "script" not in _Tags(text).seen


def test_a_finding_shows_its_effects_with_their_intervals():
    finding = made_findings.rig_named()
    text = finding._repr_html_()
    for effect in finding.effects:
        for name, value in effect.parameters.items():
            assert name.replace("_", " ") in text and value.low is not None
    assert "90 % interval" in text and finding.heldout and "held out: before" in text
    assert "fitted" not in made_findings.rig_no_gap()._repr_html_()


def test_diagnoses_thresholds_and_numbers_have_their_tables(robot_trace):
    one = diagnosed(robot_trace)
    assert "motor 3 is weak: 40 % left" in one._repr_html_() and "a note" in one._repr_html_()
    many = DiagnosedRuns([one] * 40)
    assert len(many) == 40 and "and 10 more runs" in many._repr_html_()
    assert "slip distance" in calibration()._repr_html_() and "0.0123" in calibration()._repr_html_()
    numbers = robot_numbers()._repr_html_()
    assert (
        "1 … 1.2" in numbers and "data and prior" in numbers and "Not excited by the drive: mass" in numbers
    )
    assert "pvc" in drives()._repr_html_() and "0.3000" in drives()._repr_html_()


def test_a_trace_shows_its_columns_those_of_the_wheels_together(robot_trace):
    text = robot_trace._repr_html_()
    assert "current_1 … 4" in text and f"{len(robot_trace['time'])} rows" in text
    assert Trace({"time": np.empty(0), "x": np.empty(0)})._repr_html_()


def dataset() -> Dataset:
    columns = {"time": np.arange(5.0)}
    runs = tuple(Run(f"run_{k}", columns, {}, {"floor": HOSTILE, "mass": 20.0}) for k in range(40))
    return Dataset(Path("logs"), "quarter_rig", runs, (HOSTILE,))


def test_a_dataset_shows_its_runs_and_constants_their_units_and_sources():
    text = dataset()._repr_html_()
    assert "40 runs of quarter_rig" in text and "and 10 more runs" in text and "mass 20.0" in text
    for machine in (read_robot(), read_rig()):
        text = machine._repr_html_()
        assert f"{len(machine.provenance)} quantities" in text and "datasheet" in text
        cells = re.findall(r"<td[^>]*>([^<]*)</td>", text)
        at = cells.index("wheel.radius")
        assert cells[at : at + 4] == ["wheel.radius", "0.05", "m", "chosen"]


def records(run, robot_trace) -> list[Any]:
    one = diagnosed(robot_trace, HOSTILE)
    finding = dataclasses.replace(made_findings.rig_named(), dataset=HOSTILE, reason=HOSTILE)
    metrics = run.metrics | {"checks": [{"name": HOSTILE, "value": 1.0, "limit": 2.0, "ok": True}]}
    trace = Trace({"time": np.arange(3.0), HOSTILE: np.ones(3)}, {"scenario": HOSTILE})
    return [
        dataclasses.replace(run, metrics=metrics),
        one,
        DiagnosedRuns([one]),
        finding,
        trace,
        dataclasses.replace(calibration(), floors=(HOSTILE,)),
        dataclasses.replace(robot_numbers(), dataset=Path(HOSTILE.replace("/", "")), notes=(HOSTILE,)),
        dataclasses.replace(drives(), notes=(HOSTILE,)),
        dataset(),
        dataclasses.replace(read_robot(), file=Path(HOSTILE)),
    ]


def test_no_text_of_a_record_becomes_markup(run, robot_trace):
    for record in records(run, robot_trace):
        text = record._repr_html_()
        assert HOSTILE not in text and "&lt;script&gt;" in text, type(record)
        tags = _Tags(text)
        assert not tags.open and "script" not in tags.seen, type(record)


@pytest.mark.slow
@pytest.mark.parametrize("make", [made_findings.rig_named, made_findings.robot, robot_numbers, drives])
def test_every_plot_of_a_record_is_drawn(make):
    record = make()
    assert record.plots and len(set(record.plots)) == len(record.plots)
    for panel in record.plot(*record.plots).children:
        assert any(isinstance(renderer, GlyphRenderer) for renderer in panel.renderers)


def drawn_in(shown) -> list[GlyphRenderer]:
    assert isinstance(shown, Column)
    found = [renderer for plot in shown.children for renderer in plot.renderers]
    return [renderer for renderer in found if isinstance(renderer, GlyphRenderer)]


@pytest.mark.slow
def test_plots_of_a_run_share_their_time_axis(run):
    assert {"path", "heading", "currents"} <= set(run.plots)
    shown = run.plot("wheel-speeds", "currents")
    ranges = {id(panel.x_range) for panel in shown.children}
    assert len(shown.children) > 4 and len(ranges) == 1
    assert drawn_in(run.plot()) and drawn_in(run.plot("path"))
    with pytest.raises(UnknownNameError, match=r"RunResult\.plot: unknown plot 'pth'; did you mean 'path'"):
        run.plot("pth")


def test_columns_of_a_trace_are_plotted_as_they_are(robot_trace):
    shown = robot_trace.plot("x", "current")
    assert len(shown.children) == 2 and "current" in robot_trace.plots
    first = next(r for r in shown.children[0].renderers if isinstance(r, GlyphRenderer))
    largest = [np.nanmax(values) for values in first.data_source.data.values()]
    assert any(np.isclose(value, robot_trace["x"].max(), rtol=1e-2) for value in largest)
    assert len(drawn_in(robot_trace.plot())) >= 4
    with pytest.raises(UnknownNameError, match=r"Trace\.plot: unknown column 'xx'"):
        robot_trace.plot("xx")


@pytest.mark.slow
def test_records_are_shown_without_loading_a_drawing_library_before():
    script = """
import sys
from omnimj.signals import Trace
from omnimj.simulate.run import RunResult
print('bokeh' in sys.modules, 'omnimj.view' in sys.modules, hasattr(RunResult, '_repr_html_'))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False", "True"]


def test_every_displayed_record_has_a_table():
    from omnimj.display import Displayed

    known = {(kind.__module__, kind.__name__) for kind in notebook.summarize.registry}
    displayed = {(kind.__module__, kind.__name__) for kind in Displayed.__subclasses__()}
    assert displayed and displayed <= known
    with pytest.raises(TypeError, match="no table for int"):
        notebook.summarize(3)
