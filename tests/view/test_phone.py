"""Every report fits a phone's screen, can be read there and prints; it is one file without references."""

from __future__ import annotations

import functools
import html
import re
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pytest
from browser import on_a_phone
from diagnosed_runs import LONG
from inline_executor import InlineExecutor
from made_findings import FINDINGS
from rig_runs import twin_run
from test_report import Page, without_scripts
from test_sensitivity_report import outcome_of, study_of
from undrawn_pages import without_embedding

from omnimj.cli.main import main
from omnimj.parameters import read_floors, read_rig
from omnimj.recording.write_dataset import DatasetWriter
from omnimj.studies import workers
from omnimj.studies.statistics import Table
from omnimj.view.report.evaluation import write_tables_report
from omnimj.view.report.gap import write_gap_report
from omnimj.view.report.page import command_line, table
from omnimj.view.report.sensitivity import write_sensitivity_report

READABLE = 8.5
"""Height of the smallest letters in a figure on a phone [CSS pixels]: those of a footnote in print."""
KINDS = ("run", "compared", "rig", "diagnose", "evaluate", "gap", "benchmark", "identify", "validate")
KINDS += ("sensitivity",)
LOOKED_AT = ("compared", "gap")
"""Kinds whose pages every run of the tests looks at on a phone; nightly runs look at all of them."""


def others(*kinds: str) -> list[str]:
    """Kinds of pages but these."""
    return [kind for kind in KINDS if kind not in kinds]


_PAGE = "<!DOCTYPE html><html><head><meta charset='utf-8'></head><body>%s</body></html>"


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
def written(tmp_path_factory, rig_data, robot_file, compared_file, rig_file) -> Callable[..., Path]:
    """Gives the page of a kind, with its plots or only with their places; each is made once."""
    folder = tmp_path_factory.mktemp("pages")
    shared = {"run": robot_file, "compared": compared_file, "rig": rig_file}
    manoeuvres = ["--suite", "manoeuvres", "--faults", "motor", "--method", "robust", "--trials", "2"]
    commands = {
        "identify": [str(rig_data)],
        "validate": [str(rig_data), "--plant", "planar"],
        "diagnose": [str(rig_data)],
        "evaluate": manoeuvres,
    }

    def write(kind: str, out: Path) -> None:
        if kind == "gap":
            with pytest.MonkeyPatch.context() as patched:
                patched.setattr("omnimj.view.report.gap.MOST_FIGURES", 3)  # of 24 runs that look alike
                write_gap_report(out / "report.html", FINDINGS["named"](), new_model="model.toml")
        elif kind == "benchmark":
            words = "why this case was or was not solved, in a sentence that is longer than a phone is wide"
            cases = Table("Cases", ("case", "truth", "found", "words"), (("1", "slope", LONG, words),))
            write_tables_report(out / "report.html", "Benchmark", ("130 cases",), (cases,), "benchmark.json")
        elif kind == "sensitivity":
            studies = [study_of("speed", "m/s", 0.0), study_of("tracking_error_max", "m", 0.0)]
            write_sensitivity_report(out / "report.html", outcome_of(*studies))
        else:
            with pytest.MonkeyPatch.context() as patched:
                patched.setattr(workers, "ProcessPoolExecutor", lambda *_, **__: InlineExecutor())
                assert main([kind, *commands[kind], "--out", str(out)]) == 0

    @functools.cache
    def page_of(kind: str, drawn: bool) -> Path:
        if kind in shared:
            return shared[kind]
        out = folder / f"{kind}_{'drawn' if drawn else 'places'}"
        out.mkdir()
        with nullcontext() if drawn else without_embedding():
            write(kind, out)
        return out / "report.html"

    return page_of


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*LOOKED_AT, *others(*LOOKED_AT)])
def test_nothing_is_wider_than_a_phone_and_no_text_is_too_small(kind, written, browser, tmp_path):
    seen = on_a_phone(browser, written(kind, True).read_text(encoding="utf-8"), tmp_path)
    assert seen.found == []
    if seen.smallest is not None:
        assert seen.smallest >= READABLE


@pytest.mark.slow
def test_the_check_on_a_phone_finds_what_is_too_wide_and_too_small(browser, tmp_path):
    wide = f"<p style='white-space: nowrap; width: max-content'>{LONG}</p>"
    seen = on_a_phone(browser, _PAGE % wide, tmp_path)
    assert any("P." in words for words in seen.found)
    small = "<figure><svg viewBox='0 0 780 100'><text x='9' y='50' font-size='8px'>fine</text></svg></figure>"
    seen = on_a_phone(browser, _PAGE % small, tmp_path)
    assert seen.found == [] and seen.smallest is not None and seen.smallest < 0.7 * READABLE


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_report_is_one_file_and_knows_paper(kind, written):
    page = written(kind, kind in LOOKED_AT)
    whole = page.read_text(encoding="utf-8")
    assert re.search(r"@media print \{", whole) and "print-color-adjust: exact" in whole
    assert "break-inside: avoid" in whole
    assert "<meta name='viewport' content='width=device-width, initial-scale=1'>" in whole
    whole = without_scripts(whole)
    assert "@import" not in whole
    links = Page(page).links
    assert [link for link in links if not link.startswith(("#", "data:"))] == []
    assert re.findall(r"url\((?!#|\"?data:)", whole) == []
    assert not re.search(r"https?://", re.sub(r"<code>.*?</code>", "", whole))


def test_a_command_is_broken_between_words_only():
    command = "omnimj run a --out 'o & o' --set drive.speed=-1 -x"
    ready = command_line(command)
    assert ready.count("<span class='option'>") == 3
    assert html.unescape(re.sub(r"<[^>]*>", "", ready)) == command


def test_rows_with_sentences_are_stacked_and_label_each_cell():
    row = ("1", "2", "3", "a sentence of more than forty letters stands here")
    assert table([row], ("a", "b", "c", "d")).kind == "stacked"
    assert table([row[:3]], ("a", "b", "c")).kind == ""


@pytest.mark.slow
def test_cells_of_stacked_rows_carry_their_headings(written):
    assert "<td data-head='words'>why this case" in written("benchmark", False).read_text(encoding="utf-8")
