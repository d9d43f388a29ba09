"""Reports of many runs: one run's plots are loaded at a time, and a search field finds runs and rows."""

from __future__ import annotations

import base64
import dataclasses
import re
import zlib
from pathlib import Path

import pytest
from browser import operate
from inline_executor import InlineExecutor
from made_findings import FINDINGS
from test_report import Page

from omnimj.cli.main import main
from omnimj.studies import workers
from omnimj.view.report.gap import write_gap_report
from omnimj.view.report.page import RunSection, run_table

KINDS = ("gap", "evaluate")
_STATE = """
const sections = [...document.querySelectorAll('details.run')], made = () => Bokeh.documents.length;
const field = document.querySelector('.filter input'), count = document.querySelector('.filter output');
const rows = [...document.querySelectorAll('tr[data-run]')];
const type = words => { field.value = words; field.dispatchEvent(new Event('input', {bubbles: true})); };
const drawn = async part => { while (!find(part, 'bk-Figure').length) await pause(50); };
const shown = found => found.filter(e => getComputedStyle(e).display !== 'none').map(e => e.dataset.run);
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    finding = FINDINGS["named"]()
    few = tuple(o for o in finding.overlays if o.run.startswith("i150") or o.run.endswith("p35"))
    write_gap_report(folder / "gap.html", dataclasses.replace(finding, overlays=few))
    words = ["--suite", "manoeuvres", "--method", "robust", "--trials", "8", "--out", str(folder / "out")]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(workers, "ProcessPoolExecutor", lambda *_, **__: InlineExecutor())
        assert main(["evaluate", *words]) == 0
    return {"gap": folder / "gap.html", "evaluate": folder / "out" / "report.html"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_only_the_first_run_is_open_and_another_is_loaded_when_it_is_opened(kind, files, browser, tmp_path):
    script = f"""{_STATE}
    const before = [sections.map(part => part.open), made()];
    sections[2].open = true; await drawn(sections[2]);
    return [...before, made(), find(sections[2], 'bk-Figure').length, find(sections[3], 'bk-Figure').length];
    """
    is_open, before, after, figures, closed = operate(
        browser, files[kind].read_text("utf-8"), script, tmp_path
    )
    assert is_open == [True] + [False] * (len(is_open) - 1) and len(is_open) > 3
    assert after == before + 1 and figures > 0 and closed == 0


@pytest.mark.slow
def test_the_search_field_finds_held_out_runs_of_the_gap(files, browser, tmp_path):
    script = f"""{_STATE} type('Held OUT p35');
    const found = [shown(sections), shown(rows), count.textContent];
    type('35'); return [...found, count.textContent];
    """
    parts, rows, count, inside = operate(browser, files["gap"].read_text("utf-8"), script, tmp_path)
    assert sorted(parts) == sorted(rows) == ["run-i090-5f-p35", "run-i150-5f-p35"]
    assert count == "2 of 9 runs" and inside == "0 of 9 runs"  # no word begins with 35


@pytest.mark.slow
@pytest.mark.parametrize("width", [1200, 600])
def test_the_search_field_finds_cases_by_fault_floor_and_outcome(files, browser, tmp_path, width):
    page = files["evaluate"].read_text("utf-8")
    script = f"""{_STATE}
    const list = rows[0].closest('details'); list.open = true;
    const texts = Object.fromEntries(rows.map(row => [row.dataset.run, row.textContent]));
    const all = shown(rows).length, words = rows[3].children[5].textContent + ' ' +
      rows[3].children[2].textContent.replaceAll(' ', '_') + ' ' + rows[3].children[7].textContent;
    type(words);
    const found = [shown(rows), shown(sections), count.textContent];
    type('nothing of this kind'); found.push(shown(rows), count.textContent);
    type(''); found.push(shown(rows).length);
    return [all, rows[3].dataset.run, ...found];
    """
    all_rows, wanted, rows, parts, count, none, zero, again = operate(browser, page, script, tmp_path, width)
    assert wanted in rows and set(rows) == set(parts) and len(rows) < all_rows
    assert count == f"{len(rows)} of 8 cases" and zero == "0 of 8 cases"
    assert none == [] and again == all_rows == 8


@pytest.mark.slow
def test_a_link_of_the_table_opens_the_part_of_its_run(files, browser, tmp_path):
    script = f"""{_STATE}
    const link = rows[5].querySelector('a'), part = document.getElementById(rows[5].dataset.run);
    const before = part.open; link.click(); await drawn(part);
    return [before, part.open, find(part, 'bk-Figure').length];
    """
    before, after, drawn = operate(browser, files["gap"].read_text("utf-8"), script, tmp_path)
    assert (before, after) == (False, True) and drawn > 0


@pytest.mark.slow
def test_the_search_field_and_the_parts_are_reached_by_keyboard(files, browser, tmp_path):
    script = f"""{_STATE}
    const stops = [field, sections[1].querySelector('summary'), rows[1].querySelector('a')];
    rows[1].closest('details').open = true;
    const focused = stops.map(e => {{ e.focus(); return document.activeElement === e && e.tabIndex >= 0; }});
    return [focused, field.closest('label').textContent.trim(), count.tagName];
    """
    focused, label, live = operate(browser, files["gap"].read_text("utf-8"), script, tmp_path)
    assert focused == [True, True, True]
    assert label == "Show runs with" and live == "OUTPUT"  # read out when it changes


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_each_plot_is_embedded_once_and_has_a_still_picture(kind, files):
    page = files[kind].read_text(encoding="utf-8")
    groups = re.findall(r"<script type='text/plain'>(.*?)</script>", page)
    scripts = [zlib.decompress(base64.b64decode(one)).decode("utf-8") for one in groups]
    scripts += [
        one for one in re.findall(r"<script>(.*?)</script>", page, re.DOTALL) if "embed_items({" in one
    ]
    places = re.findall("<div id='([^']+)' data-root-id='([^']+)'", page)
    assert len(places) == page.count("<div class='still'><svg") == page.count("<div class='live'") > 3
    for place, root in places:
        assert sum(script.count(f'"{root}":"{place}"') for script in scripts) == 1
    assert len(groups) == len(re.findall("<details class='run'", page))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_without_scripts_the_field_is_absent_and_everything_else_is_there(kind, files):
    page = files[kind].read_text(encoding="utf-8")
    plain = re.search(r"<noscript><style>(.*?)</style></noscript>", page)
    assert plain and ".filter" in plain[1] and ".still { display: block; }" in plain[1]
    assert "::details-content" in page.partition("@media print")[2]
    assert " hidden" not in re.sub(r"<(script|style)[^>]*>.*?</\1>", "", page, flags=re.DOTALL)


def test_rows_without_a_part_of_the_page_have_no_link():
    table = run_table([("a", (1,)), ("b & b", (2,))], ("run", "n"), [RunSection("a", [])])
    assert [row[0].link for row in table.rows] == ["#run-a", ""]
    assert list(table.keys) == ["run-a", "run-b-20--26--20-b"]


@pytest.mark.slow
def test_a_gap_report_with_many_runs_has_parts_for_the_worst_and_a_row_for_each(
    tmp_path, undrawn, monkeypatch
):
    monkeypatch.setattr("omnimj.view.report.gap.MOST_FIGURES", 2)
    finding = FINDINGS["named"]()
    copies = [dataclasses.replace(o, run=f"{o.run}_{k}") for k in range(3) for o in finding.overlays]
    write_gap_report(tmp_path / "report.html", dataclasses.replace(finding, overlays=tuple(copies)))
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert text.count("<details class='run'") == 2 < text.count("<tr data-run=") == len(copies)
    assert "<details open><summary>All 72 as a table" in text
    assert len(Page(tmp_path / "report.html").ids) > 2
