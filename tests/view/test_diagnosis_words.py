"""A report never contradicts itself: what decided is what is shown, and what was found stands first."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from browser import chromium, on_a_phone, operate
from driven_missions import as_run, driven
from test_report import Page

from omnimj.cli.main import main
from omnimj.diagnosis.replay import DiagnosisConfig, RunDiagnosis
from omnimj.parameters import read_robot
from omnimj.recording.dataset import Dataset
from omnimj.recording.traces import read_trace
from omnimj.recording.write_dataset import write_dataset
from omnimj.signals import Diagnosis, Trace
from omnimj.view.diagnosis_words import describe_diagnosis, describe_evidence
from omnimj.view.report.diagnosis import run_section, write_diagnosis_report

TESTS = (
    "loss",
    "friction",
    "learnt loss",
    "accelerometer",
    "slip",
    "current",
    "standing",
    "readings",
    "yaw rates",
    "wheel speed",
)
"""Tests that decide."""
LEARNT = Diagnosis(4.0, "motor", (2,), 0.9, (), 0.93, test="learnt loss", statistic=0.071, threshold=0.03)
SUDDEN = Diagnosis(3.0, "motor", (1,), 0.99, (), 0.43, test="loss", statistic=31.2, threshold=23.5)
BRAKED = Diagnosis(2.0, "motor", (4,), 0.99, (), 1.0, test="friction", statistic=40.0, threshold=23.5)
SLIP = Diagnosis(1.0, "slip", (3,), 0.9, cleared=1.5, test="slip", statistic=0.0006, threshold=0.00051)
LOCKED = Diagnosis(5.0, "locked", (2,), 0.99, (), 0.0, test="standing", statistic=6.0, threshold=6.0)


def test_no_motor_is_weak_that_has_all_of_its_torque():
    for left in (0.975, 0.999, 1.0):
        for test in ("loss", "learnt loss", "friction", ""):
            words = describe_diagnosis(Diagnosis(1.0, "motor", (4,), 0.9, (), left, test=test))
            assert "is weak" not in words and "% left" not in words and "4" in words
    assert describe_diagnosis(BRAKED) == "wheel 4 is braked"
    assert describe_diagnosis(SUDDEN) == "motor 1 is weak: 43 % left"


@pytest.mark.parametrize("test", TESTS)
def test_every_test_has_words_and_its_statistic_stands_at_or_above_its_threshold(test):
    words = describe_evidence(Diagnosis(1.0, "motor", (1,), 0.9, test=test, statistic=7.001, threshold=7.0))
    numbers = re.fullmatch(r"\D+, ([\d.]+) ?\D* ≥ ([\d.]+)", words)
    assert numbers and float(numbers[1]) > float(numbers[2])


def run_of(name: str, *diagnoses: Diagnosis, judged: float = 10.0) -> RunDiagnosis:
    time = np.linspace(0.0, 10.0, 200)
    columns = {"time": time}
    for i in range(1, 5):
        columns |= {f"residual_motor_{i}": 0.0 * time, f"threshold_motor_{i}": 0.0 * time + 23.5}
        columns |= {f"residual_slip_{i}": 0.0 * time, f"threshold_slip_{i}": 0.0 * time + 0.00051}
    return RunDiagnosis(name, diagnoses, 1.0, judged, Trace(columns), ())


RUNS = (
    run_of("quiet"),
    run_of("slippery", SLIP),
    run_of("twice", SLIP, SUDDEN),
    run_of("worn", LEARNT),
    run_of("stuck", LOCKED),
    run_of("empty", judged=0.0),
)


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Path:
    """A page of six runs."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    robot, dataset = read_robot(), Dataset(Path("night"), "uto_robot", ())
    from omnimj.diagnosis.logs import read_machine

    config = DiagnosisConfig(dataset, read_machine(dataset), "robust", {})
    assert robot.wheels
    names = [name for name in RUNS[0].trace.columns if name != "time"]
    sections = [run_section(run, "robust", names, 50) for run in RUNS]
    write_diagnosis_report(path, config, RUNS, sections)
    return path


@pytest.mark.slow
def test_a_diagnosis_that_no_plotted_statistic_explains_says_which_test_decided(page):
    text = page.read_text("utf-8")
    captions = re.findall(r"Decided by a test that is not drawn here: ([^<]*)\.", text)
    assert len(captions) == 2
    assert "motor 2 is weak (loss learnt while driving, 7.1 % ≥ 3)" in captions[1]
    assert "wheel 2 is locked (standing against floor or motor, 6 blocks ≥ 6)" in captions[0]


def test_the_page_begins_with_what_was_found_in_how_many_runs_worst_first(page):
    text = page.read_text("utf-8")
    first = text.partition("<section>")[0]
    found = re.findall(r"data-find='([^']*)'>[^<]*</button></td><td[^>]*>(\d of 6)", first)
    assert found == [
        ("wheel 2 is locked", "1 of 6"),
        ("motor 1 is weak", "1 of 6"),
        ("motor 2 is weak", "1 of 6"),
        ("wheel 3 slips", "2 of 6"),
        ("nothing found", "1 of 6"),
        ("no usable samples", "1 of 6"),
    ]
    order = list(dict.fromkeys(re.findall(r"data-run='run-([a-z]*)'", text)))
    assert order == ["stuck", "twice", "worn", "slippery", "quiet", "empty"]
    assert len(Page(page).ids) > 6


@pytest.mark.slow
def test_a_finding_filters_the_runs_that_have_it_and_a_second_click_shows_all(page, tmp_path):
    browser = chromium()
    if browser is None:
        pytest.skip("no Chromium on this machine: the page is not operated")
    script = """
    const shown = () => [...document.querySelectorAll('details.run')].filter(e => !e.hidden)
      .map(e => e.dataset.run);
    const button = text => [...document.querySelectorAll('button.find')].find(e => e.textContent === text);
    const found = [];
    for (const text of ['wheel 3 slips', 'motor 2 is weak', 'nothing found', 'nothing found']) {
      button(text).click(); found.push(shown());
    }
    return found;
    """
    slips, weak, nothing, everything = operate(browser, page.read_text("utf-8"), script, tmp_path)
    # a run with a weak motor 1 and a slip of another wheel is not one with a weak motor 2
    assert (slips, weak, nothing) == (["run-twice", "run-slippery"], ["run-worn"], ["run-quiet"])
    assert len(everything) == len(RUNS)
    seen = on_a_phone(browser, page.read_text("utf-8"), tmp_path)
    assert seen.found == []


@pytest.mark.slow
def test_at_every_alarm_the_drawn_statistic_of_its_test_is_at_its_threshold(tmp_path):
    runs = [as_run(driven(weak=True), "weak"), as_run(driven(), "healthy")]
    write_dataset(tmp_path / "runs", "uto_robot", {"floor": "natural_stone"}, runs)
    assert main(["diagnose", str(tmp_path / "runs"), "--out", str(tmp_path / "out")]) == 0
    content = json.loads((tmp_path / "out" / "diagnoses.json").read_text("utf-8"))
    (found,) = content["runs"]["weak"]["diagnoses"]
    assert found["test"] in TESTS and found["statistic"] >= found["threshold"]
    trace, family = read_trace(tmp_path / "out" / "weak.parquet"), "motor"
    row = int(np.argmin(np.abs(trace["time"] - found["time"])))
    drawn = trace[f"residual_{family}_2"][row], trace[f"threshold_{family}_2"][row]
    assert found["test"] not in ("loss", "friction") or drawn[0] >= drawn[1]
    assert drawn == pytest.approx((found["statistic"], found["threshold"]), rel=1e-6)
