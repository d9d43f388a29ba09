"""Plots of a report answer to the mouse in a browser: zoom, values below the cursor, switching of lines."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from browser import operate
from diagnosed_runs import with_robust

from omnimj.diagnosis.replay import RunDiagnosis
from omnimj.parameters import read_robot
from omnimj.signals import Diagnosis, Trace
from omnimj.view.report.diagnosis import bins_for, run_section, write_diagnosis_report

_PLOT = "const panel = panels('wheel-speeds')[1]; panel.scrollIntoView(); await pause(100);"
_TIMES = "models('Range1d').filter(r => r.start === 0 && r.end === %s)"
_DRAG = """
const box = canvas(panel).getBoundingClientRect(), high = box.top + 0.5 * box.height;
const at = share => box.left + 62 + share * (box.width - 76);
pointer(canvas(panel), 'move', at(0.25), high); await pause(50);
pointer(canvas(panel), 'down', at(0.25), high); await pause(50);
for (const share of [0.3, 0.4, 0.5]) { pointer(canvas(panel), 'move', at(share), high); await pause(50); }
pointer(canvas(panel), 'up', at(0.5), high); await pause(200);
"""


@pytest.fixture(scope="module")
def page(robot_file) -> str:
    return robot_file.read_text(encoding="utf-8")


@pytest.mark.slow
def test_dragging_over_one_plot_zooms_all_plots_over_time(page, browser, tmp_path, robot_trace):
    end = float(robot_trace["time"][-1])
    script = f"""
    const times = {_TIMES % f"{end:g}"}; {_PLOT} {_DRAG}
    const shown = panels('traction_force').concat(panels('velocity'));
    return [times.length, times[0].start, times[0].end, shown.length];
    """
    number, start, stop, shown = operate(browser, page, script, tmp_path)
    assert number == 1  # one range for all of them
    assert start == pytest.approx(0.25 * end, abs=0.05 * end) and stop == pytest.approx(
        0.5 * end, abs=0.05 * end
    )
    assert shown == 3


@pytest.mark.slow
def test_the_values_below_the_cursor_are_those_of_the_trace_at_its_time(page, browser, tmp_path, robot_trace):
    script = f"""
    {_PLOT} const box = canvas(panel).getBoundingClientRect();
    pointer(canvas(panel), 'move', box.left + 300, box.top + 0.5 * box.height); await pause(300);
    const tips = find(document.body, 'bk-Tooltip').flatMap(tip => [...parts(tip.shadowRoot)]);
    return tips.filter(e => e.tagName !== 'STYLE' && !e.children.length).map(e => e.textContent).join('|');
    """
    words = operate(browser, page, script, tmp_path)
    found = re.search(r"time: \|([\d.]+) s.*?measured: \|([-+\d.e]+) rad/s", words)
    assert found, words
    k = int(np.argmin(np.abs(robot_trace["time"] - float(found[1]))))
    assert float(found[2]) == pytest.approx(robot_trace["wheel_speed_2"][k], rel=2e-3, abs=1e-3)


@pytest.mark.slow
def test_a_click_on_the_legend_hides_a_line_and_another_shows_it(page, browser, tmp_path):
    script = """
    const lines = () => models('GlyphRenderer').filter(r => !r.visible).length;
    const plot = panels('slip_velocity')[0]; plot.scrollIntoView(); await pause(100);
    const counts = [lines()];
    const entry = find(plot.shadowRoot, 'bk-item')[2];
    pointer(entry, 'down', 0, 0); await pause(200); counts.push(lines());
    pointer(entry, 'down', 0, 0); await pause(200); counts.push(lines());
    return [entry.textContent, counts];
    """
    name, (before, hidden, shown) = operate(browser, page, script, tmp_path)
    assert name == "wheel 3"
    assert (before, hidden, shown) == (0, 2, 0)  # the samples and their mean


@pytest.mark.slow
def test_a_finger_scrolls_the_page_instead_of_zooming(page, browser, tmp_path):
    script = "return models('Toolbar').map(bar => bar.active_drag === null)"
    assert not any(operate(browser, page, script, tmp_path))
    coarse = page.replace("<main>", "<script>window.matchMedia = () => ({matches: true});</script><main>", 1)
    assert all(operate(browser, coarse, script, tmp_path))


@pytest.mark.slow
def test_the_text_of_a_page_comes_before_its_scripts_so_that_it_is_painted_first(page):
    assert 0 < page.index("</main>") < page.index("<script>")


def diagnosis_config() -> Any:
    return SimpleNamespace(
        method="robust",
        thresholds=None,
        dataset=SimpleNamespace(path=Path("night"), notes=()),
        machine=SimpleNamespace(constants=read_robot()),
    )


@pytest.mark.parametrize(("diagnosed", "is_open"), [(3, 3), (4, 1)])
def test_many_diagnosed_runs_are_not_all_open_from_the_beginning(
    tmp_path, robot_trace, diagnosed, is_open, undrawn
):
    slip = Diagnosis(1.0, "slip", (2,), 0.9)
    found = [RunDiagnosis(f"run_{k}", (slip,) * (k < diagnosed), 0.0, 3.0, robot_trace, ()) for k in range(8)]
    sections = [run_section(run, "robust", [], 0) for run in found]
    write_diagnosis_report(tmp_path / "report.html", diagnosis_config(), found, sections)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert len(re.findall("<details class='run'[^>]* open>", page)) == is_open


@pytest.mark.slow
def test_plots_of_a_run_are_made_when_its_part_is_opened_and_the_search_hides_others(
    browser, tmp_path, robot_trace
):
    trace = with_robust(Trace({name: values[:3000] for name, values in robot_trace.columns.items()}))
    slip = Diagnosis(1.0, "slip", (2,), 0.9)
    found = [RunDiagnosis(f"run_{k}", (slip,) if k == 2 else (), 0.0, 3.0, trace, ()) for k in range(1, 5)]
    names = [name for name in trace.columns if name.startswith(("residual_", "threshold_"))]
    sections = [run_section(run, "robust", names, bins_for(len(found))) for run in found]
    config = diagnosis_config()
    write_diagnosis_report(tmp_path / "report.html", config, found, sections)
    script = """
    const parts = [...document.querySelectorAll('details.run')], made = () => Bokeh.documents.length;
    const counts = [parts.map(part => part.open), made()];
    parts[3].open = true; await pause(800); counts.push(made(), panels('r-run-5f-4').length);
    const field = document.querySelector('.filter input');
    field.value = 'Slip'; field.dispatchEvent(new Event('input'));
    counts.push(parts.map(part => part.hidden));
    return counts;
    """
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    is_open, before, after, drawn, hidden = operate(browser, page, script, tmp_path)
    assert is_open == [True, False, False, False]  # the worst comes first, and has a diagnosis
    assert (before, after) == (1, 2) and drawn > 0
    assert hidden == [False, True, True, True]
