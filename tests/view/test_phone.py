"""Every report fits a phone's screen, can be read there and prints; it is one file without references."""

from __future__ import annotations

import html
import re

import pytest
from browser import chromium, on_a_phone
from diagnosed_runs import diagnosis_record, with_robust
from inline_executor import InlineExecutor
from made_findings import FINDINGS
from nightly import representative
from rig_runs import twin_run
from test_report import Page, without_scripts
from test_sensitivity_report import outcome_of, study_of

from omnimj.cli.main import main
from omnimj.parameters import read_floors, read_rig
from omnimj.recording.write_dataset import DatasetWriter
from omnimj.studies import workers
from omnimj.studies.statistics import Table
from omnimj.view.report import page
from omnimj.view.report.evaluation import write_benchmark_report
from omnimj.view.report.gap import write_gap_report
from omnimj.view.report.run import write_report
from omnimj.view.report.sensitivity import write_sensitivity_report

READABLE = 8.5
"""Height of the smallest letters in a figure on a phone [CSS pixels]: those of a footnote in print."""
KINDS = ("run", "compared", "rig", "diagnose", "evaluate", "gap", "benchmark", "identify", "validate")
KINDS += ("sensitivity",)


def others(*kinds: str) -> list[str]:
    """Kinds of pages but these."""
    return [kind for kind in KINDS if kind not in kinds]


_PAGE = "<!DOCTYPE html><html><head><meta charset='utf-8'></head><body>%s</body></html>"
LONG = "a_name_without_any_space_that_is_far_longer_than_the_screen_of_a_phone_is_wide/report.html"


@pytest.fixture(scope="module")
def rig_data(tmp_path_factory):
    """Three runs of the rig on a floor."""
    rig, floor = read_rig(), read_floors()["natural_stone"]
    path = tmp_path_factory.mktemp("data") / "runs"
    writer = DatasetWriter(path, "quarter_rig", {"floor": "natural_stone", "mass": rig.rig.masses[0]})
    for seed, current in enumerate((0.6, 1.2, 1.5)):
        writer.add(twin_run(rig, floor, current, seed, name=f"run_{round(100 * current):03d}"))
    return path


@pytest.fixture(scope="module")
def pages(
    tmp_path_factory,
    rig_data,
    robot_trace,
    robot_scenario,
    robot_metrics,
    rig_trace,
    rig_scenario,
    rig_metrics,
):
    """A page of every kind, by kind."""
    folder = tmp_path_factory.mktemp("pages")
    paths = {kind: folder / f"{kind}.html" for kind in KINDS}
    trace = with_robust(robot_trace)
    metrics = {**robot_metrics, "command": f"omnimj run nylon_patch --out {LONG} --force"}
    metrics["diagnoses"] = [
        diagnosis_record(3.1, "slip", 2),
        diagnosis_record(6.9, "motor", 3, ambiguous_with=["slip 3", "motor 1"]),
    ]
    write_report(paths["run"], trace, robot_scenario, metrics)
    beside = {**metrics, "compared": {"published": {**robot_metrics, "method": "published"}}}
    write_report(paths["compared"], trace, robot_scenario, beside, others={"published": robot_trace})
    write_report(paths["rig"], rig_trace, rig_scenario, rig_metrics)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("omnimj.view.report.gap.MOST_FIGURES", 3)  # of 24 runs that look alike
        write_gap_report(paths["gap"], FINDINGS["named"](), new_model="model.toml")
    words = "why this case was or was not solved, in a sentence that is longer than a phone is wide"
    table = Table("Cases", ("case", "truth", "found", "words"), (("1", "slope", LONG, words),))
    write_benchmark_report(paths["benchmark"], ("130 cases",), (table,))
    studies = [study_of("speed", "m/s", 0.0), study_of("tracking_error_max", "m", 0.0)]
    write_sensitivity_report(paths["sensitivity"], outcome_of(*studies))
    manoeuvres = ["--suite", "manoeuvres", "--faults", "motor", "--method", "robust", "--trials", "2"]
    commands = {
        "identify": [str(rig_data)],
        "validate": [str(rig_data), "--plant", "planar"],
        "diagnose": [str(rig_data)],
        "evaluate": manoeuvres,
    }
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(workers, "ProcessPoolExecutor", lambda *_, **__: InlineExecutor())
        for kind, words in commands.items():
            out = folder / kind
            assert main([kind, *words, "--out", str(out)]) == 0
            paths[kind] = out / "report.html"
    return paths


@pytest.fixture(scope="module")
def browser() -> str:
    found = chromium()
    if found is None:
        pytest.skip("no Chromium on this machine: what a phone shows is not looked at")
    return found


@pytest.mark.parametrize("kind", representative("run", "gap", *others("run", "gap"), keep=2))
def test_nothing_is_wider_than_a_phone_and_no_text_is_too_small(kind, pages, browser, tmp_path):
    seen = on_a_phone(browser, pages[kind].read_text(encoding="utf-8"), tmp_path)
    assert seen.found == []
    if seen.smallest is not None:
        assert seen.smallest >= READABLE


def test_the_check_on_a_phone_finds_what_is_too_wide_and_too_small(browser, tmp_path):
    wide = f"<p style='white-space: nowrap; width: max-content'>{LONG}</p>"
    seen = on_a_phone(browser, _PAGE % wide, tmp_path)
    assert any("P." in words for words in seen.found)
    small = "<figure><svg viewBox='0 0 780 100'><text x='9' y='50' font-size='8px'>fine</text></svg></figure>"
    seen = on_a_phone(browser, _PAGE % small, tmp_path)
    assert seen.found == [] and seen.smallest is not None and seen.smallest < 0.7 * READABLE


@pytest.mark.parametrize("kind", KINDS)
def test_every_report_is_one_file_and_knows_paper(kind, pages):
    whole = pages[kind].read_text(encoding="utf-8")
    assert re.search(r"@media print \{", whole) and "print-color-adjust: exact" in whole
    assert "break-inside: avoid" in whole
    assert "<meta name='viewport' content='width=device-width, initial-scale=1'>" in whole
    whole = without_scripts(whole)
    assert "@import" not in whole
    links = Page(pages[kind]).links
    assert [link for link in links if not link.startswith(("#", "data:"))] == []
    assert re.findall(r"url\((?!#|\"?data:)", whole) == []
    assert not re.search(r"https?://", re.sub(r"<code>.*?</code>", "", whole))


def test_a_command_is_broken_between_words_only():
    command = "omnimj run a --out 'o & o' --set drive.speed=-1 -x"
    ready = page.command_line(command)
    assert ready.count("<span class='option'>") == 3
    assert html.unescape(re.sub(r"<[^>]*>", "", ready)) == command


def test_rows_with_sentences_are_stacked_and_label_each_cell():
    row = ("1", "2", "3", "a sentence of more than forty letters stands here")
    assert page.table([row], ("a", "b", "c", "d")).kind == "stacked"
    assert page.table([row[:3]], ("a", "b", "c")).kind == ""


def test_cells_of_stacked_rows_carry_their_headings(pages):
    assert "<td data-head='words'>why this case" in pages["benchmark"].read_text(encoding="utf-8")
