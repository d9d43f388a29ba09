"""The report is one well-formed page that needs nothing else and holds everything of the metrics."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import numpy as np
import pytest
from drawn import lines, shades, texts
from hypothesis import given

from omnimj.parameters import read_robot
from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.picture import Picture
from omnimj.view.plots import runs
from omnimj.view.plots.document import embed
from omnimj.view.plots.panels import Drawing, Panel
from omnimj.view.plots.thinning import averaged, envelope
from omnimj.view.report.run import write_report
from omnimj.view.wording import Span, fault_spans, measure, repeat_command

_VOID = {"meta", "img", "br", "hr", "link", "input"}


class Page(HTMLParser):
    """Tags, ids, links and text of a page; complains about tags that do not match."""

    def __init__(self, path: Path):
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.words: list[str] = []
        self.places: list[str] = []
        self.scripts: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        for name, value in attrs:
            value = value or ""
            if (name, value) == ("class", "plot"):
                self.places.append(dict(attrs).get("aria-label") or "")
            if name == "id":
                self.ids.append(value)
            if name in ("href", "src", "xlink:href", "action", "srcset"):
                self.links.append(value)
        if tag not in _VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in _VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag):
        assert self.open and self.open[-1] == tag, f"</{tag}> closes <{self.open[-1:]}>"
        self.open.pop()

    def handle_data(self, data):
        (self.scripts if self.open[-1:] == ["script"] else self.words).append(data)

    @property
    def plots(self) -> int:
        """Number of places for plots."""
        return len(self.places)

    @property
    def text(self) -> str:
        return " ".join(self.words)


def without_scripts(text: str) -> str:
    """The page without its scripts, which are data and the plotting library."""
    return re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)


@pytest.fixture(scope="module")
def robot_page(robot_file: Path) -> Page:
    return Page(robot_file)


def test_the_page_is_whole_and_needs_nothing_from_elsewhere(robot_page, robot_file):
    raw = without_scripts(robot_file.read_text(encoding="utf-8"))
    assert raw.startswith("<!DOCTYPE html>")
    assert not re.search(r"https?:|//cdn|@import|url\((?!#)", raw)
    assert all(link.startswith(("#", "data:")) for link in robot_page.links)
    assert robot_file.stat().st_size < 5e6


def test_ids_are_unique_and_every_reference_within_the_page_has_its_target(robot_page, robot_file):
    assert len(robot_page.ids) == len(set(robot_page.ids))
    raw = without_scripts(robot_file.read_text(encoding="utf-8"))
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', raw)) <= set(robot_page.ids)


def test_every_check_is_there_with_value_limit_and_a_word_for_its_state(robot_page, robot_metrics):
    for check in robot_metrics["checks"]:
        assert check["name"].replace("_", " ") in robot_page.text
        assert f"{check['value']:g}" in robot_page.text
        assert f"≤ {check['limit']:g}" in robot_page.text
    assert "✓ ok" in robot_page.text
    assert "✗ failed" in robot_page.text
    assert "Failed: 1 of 2 checks" in robot_page.text


@pytest.mark.slow
def test_texts_from_outside_cannot_break_the_page(page_path, robot_trace, robot_scenario, robot_metrics):
    evil = "</main><script>alert('x')</script>"
    metrics = {
        **robot_metrics,
        "scenario": evil,
        "method": evil,
        "floor": evil,
        "command": f"omnimj run '{evil}'",
    }
    metrics["faults"] = [{"kind": evil, "wheel": 1, "onset": 1.0, "end": 2.0, "note": evil}]
    metrics["checks"] = [{"name": evil, "value": 1.0, "limit": 2.0, "ok": True}]
    write_report(page_path, robot_trace, robot_scenario, metrics)
    page = Page(page_path)
    assert not any(evil in script for script in page.scripts)
    assert evil in page.text
    assert robot_scenario.description in page.text


def test_a_robots_run_has_all_its_figures_and_the_picture(robot_page):
    assert robot_page.plots == 9
    assert robot_page.tags.count("figure") == 10
    assert robot_page.tags.count("img") == 1
    for words in (
        "Path",
        "Heading and position",
        "Wheel speeds",
        "Slip velocity",
        "Traction",
        "Normal force",
        "Velocity",
        "Currents",
    ):
        assert words in robot_page.text
    assert "Rendered by MuJoCo (osmesa)" in robot_page.text


def test_without_a_picture_the_report_explains_how_to_get_one(
    page_path, robot_path, robot_scenario, robot_metrics, undrawn
):
    write_report(page_path, robot_path, robot_scenario, robot_metrics, Picture(None, "", "the robot"))
    page = Page(page_path)
    assert "img" not in page.tags and "MUJOCO_GL=osmesa" in page.text


def test_faults_and_diagnoses_are_described_in_sentences(robot_page):
    for words in ("slip", "motor loss", "loss 57 %", "6.5 s – end", "97 %", "3.100 s"):
        assert words in robot_page.text


@pytest.mark.slow
@pytest.mark.parametrize("failure", [None, "at 3.1 s: the newest telemetry is 22.5 ms old"])
def test_a_run_that_was_broken_off_is_marked_at_the_top(
    failure, page_path, robot_path, robot_scenario, robot_metrics, undrawn
):
    metrics = {**robot_metrics, "interrupted": True, "failure": failure, "duration": 3.1}
    write_report(page_path, robot_path, robot_scenario, metrics)
    words = " ".join(Page(page_path).words)
    assert f"Ended early: {failure or 'interrupted at 3.1 s'}" in words


def test_the_rigs_report_has_its_own_figures(rig_file):
    page = Page(rig_file)
    for words in ("Wheel and carriage", "Slip velocity", "Traction and lateral force", "Normal force"):
        assert words in page.text
    for words in ("Current", "Lateral speed", "≥ 1"):
        assert words in page.text
    assert page.plots == 6
    assert "Passed: the check holds" in page.text


def test_a_run_without_truth_has_a_report_too(page_path, robot_trace, robot_scenario, robot_metrics, undrawn):
    measured = ("time", "current", "wheel_speed", "target")
    columns = {name: values for name, values in robot_trace.columns.items() if name.startswith(measured)}
    columns["yaw"] = np.mod(robot_trace["heading"], 2 * np.pi)
    metrics = {**robot_metrics, "checks": [], "faults": [], "diagnoses": []}
    write_report(page_path, Trace(columns), robot_scenario, metrics)
    page = Page(page_path)
    assert page.plots == 3
    assert "No checks in this scenario" in page.text


def figures(robot_trace: Trace, rig_trace: Trace, spans) -> dict[str, Drawing]:
    return {
        "path": runs.path(robot_trace, (), spans, read_robot()),
        "deviation": runs.deviation(robot_trace, spans),
        "velocity": runs.velocity(robot_trace, spans),
        "wheel_speeds": runs.wheel_speeds(robot_trace, spans),
        "currents": runs.currents(robot_trace, spans),
        "slip": runs.per_wheel(robot_trace, "slip_velocity", "slip velocity [m/s]", spans),
        **{f"rig_{name}": one for name, one in runs.rig_plots(rig_trace, 0.05, spans).items()},
    }


@pytest.mark.slow
@pytest.mark.parametrize("missing", [("wheel_speed",), ("wheel_speed", "current", "slip_velocity")])
def test_a_run_without_a_quantity_of_its_wheels_has_a_report_without_its_plot(
    missing, page_path, robot_trace, robot_scenario, robot_metrics, undrawn
):
    kept = {name: one for name, one in robot_trace.columns.items() if not name.startswith(missing)}
    write_report(page_path, Trace(kept, robot_trace.about), robot_scenario, robot_metrics)
    page = page_path.read_text(encoding="utf-8")
    assert "id='wheel-speeds'" not in page and "id='path'" in page
    assert ("id='currents'" in page) == ("current" not in missing)


@pytest.mark.slow
def test_every_axis_names_its_quantity_and_unit(robot_trace, rig_trace):
    for name, figure in figures(robot_trace, rig_trace, ()).items():
        for panel in figure.panels:
            assert re.search(r"\[(m|m/s|rad/s|N|A|°)\]$", panel.y_axis.axis_label), name
        assert re.search(r"\[(s|m)\]$", figure.panels[-1].x_axis.axis_label), name


@pytest.mark.slow
def test_faults_are_shaded_in_all_time_plots_and_named_once(robot_trace, rig_trace, robot_metrics):
    spans = fault_spans(robot_metrics, 10.0)
    for name, figure in figures(robot_trace, rig_trace, spans).items():
        if name == "path":
            continue
        for row, panel in enumerate(figure.panels):
            assert {(box.left, box.right) for box in shades(panel)} == {(s.start, s.end) for s in spans}, name
            assert len(texts(panel)) == (len(spans) if row == 0 else 0), name


def test_faults_of_one_interval_share_a_band_and_a_label(robot_trace):
    spans = [Span(f"slip, wheel {i}", f"wheel_{i}", "slip", 2.0, 4.0) for i in (1, 3)]
    (panel,) = runs.per_wheel(robot_trace, "slip_velocity", "slip velocity [m/s]", spans).panels
    assert texts(panel) == ["slip, wheels 1, 3"]
    assert len(shades(panel)) == 1


def test_the_path_has_equal_axes(robot_trace):
    (panel,) = runs.path(robot_trace, (), ()).panels
    assert panel.plot.match_aspect


def test_a_wheel_keeps_its_colour_in_every_plot(robot_trace):
    (slip,) = runs.per_wheel(robot_trace, "slip_velocity", "slip velocity [m/s]", ()).panels
    colors = {line.label: line.color for line in lines(slip)}
    for i, panel in enumerate(runs.wheel_speeds(robot_trace, ()).panels):
        assert lines(panel)[0].color == palette.wheel_color(i) == colors[f"wheel {i + 1}"]


def test_the_values_below_the_cursor_are_those_of_the_trace(robot_trace):
    (slip,) = runs.per_wheel(robot_trace, "slip_velocity", "slip velocity [m/s]", ()).panels
    (hover,) = [tool for tool in slip.plot.toolbar.tools if tool.kind == "HoverTool"]
    (carrier,) = hover.renderers
    shown = dict(hover.tooltips)
    column = re.match(r"@(\w+)\{.*\} m/s$", shown["wheel 2"])
    assert column
    values = robot_trace["slip_velocity_2"].astype(np.float32)
    assert set(carrier.data_source.data[column[1]]) <= set(values)
    assert max(carrier.data_source.data[column[1]]) == values.max()


def test_plots_over_the_same_times_zoom_together_and_share_their_data(robot_trace):
    drawn = {"slip": runs.per_wheel(robot_trace, "slip_velocity", "slip [m/s]", ())}
    drawn |= {"speeds": runs.wheel_speeds(robot_trace, ()), "again": runs.wheel_speeds(robot_trace, ())}
    script, elements = embed(drawn)
    panels = [panel for drawing in drawn.values() for panel in drawing.panels]
    assert len({id(panel.plot.x_range) for panel in panels}) == 1
    sources = {id(r.data_source) for panel in panels for r in panel.plot.renderers if r.glyph.line_alpha}
    assert len(sources) <= 2  # samples, and means
    assert set(elements) == set(drawn)
    samples = min(len(robot_trace["time"]), 8001)
    # 1 column of times, 4 of slip, 8 of speeds; those drawn again are not embedded again
    assert len(script) < 1.4 * 14 * samples * 4


def luminance(color: str) -> float:
    """Relative luminance of sRGB, WCAG 2."""
    channels = np.array(palette.rgb(color)) / 255.0
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def test_wheels_differ_without_colour_by_their_dashes():
    assert len({str(palette.wheel_line(i)) for i in range(4)}) == 4


def test_lines_stand_out_from_white_paper():
    for i in range(4):
        assert 1.05 / (luminance(palette.wheel_color(i)) + 0.05) > 2.5


def test_thinning_a_signal_loses_no_peak():
    time = np.linspace(0, 10, 100_001)
    value = np.sin(time)
    value[54_321] = 17.0
    thinned_time, thinned = envelope(time, value, 100)
    assert thinned.max() == 17.0
    assert thinned.min() == value.min()
    assert len(thinned) <= 202
    assert np.all(np.diff(thinned_time) > 0)


@given(
    values=hnp.arrays(float, st.integers(1, 300), elements=st.one_of(st.just(np.nan), st.floats(-1e3, 1e3))),
    bins=st.integers(1, 40),
)
def test_thinning_keeps_the_extremes_of_any_signal_with_gaps(values, bins):
    time = np.arange(len(values), dtype=float)
    thinned_time, thinned = envelope(time, values, bins)
    assert len(thinned) == len(thinned_time) <= max(2 * bins + 1, len(values))
    assert np.all(np.diff(thinned_time) >= 0)
    if np.isfinite(values).any():
        assert np.nanmax(thinned) == np.nanmax(values) and np.nanmin(thinned) == np.nanmin(values)


def test_the_command_to_repeat_is_the_one_that_was_given(robot_scenario, robot_metrics):
    built = repeat_command(robot_scenario, robot_metrics)
    assert built == "omnimj run nylon_patch --method robust --seed 3 --set floor=pvc --out OUT"
    given = {**robot_metrics, "command": "omnimj run nylon_patch --seed 3"}
    assert repeat_command(robot_scenario, given) == "omnimj run nylon_patch --seed 3"


def test_the_kinematic_level_has_no_empty_plots(
    page_path, robot_trace, robot_scenario, robot_metrics, undrawn
):
    forces = ("current", "slip", "normal", "traction", "target_wheel")
    columns = {name: values for name, values in robot_trace.columns.items() if not name.startswith(forces)}
    write_report(
        page_path, Trace(columns), robot_scenario, {**robot_metrics, "plant": "kinematic", "method": "off"}
    )
    page = Page(page_path)
    assert page.plots == 4
    assert "none: motion without forces" in page.text


def test_a_gantry_at_rest_has_no_plot_of_its_speed(page_path, rig_trace, rig_scenario, rig_metrics, undrawn):
    columns = {**rig_trace.columns, "lateral_speed": 0.0 * rig_trace["time"]}
    write_report(page_path, Trace(columns), rig_scenario, rig_metrics)
    assert "Lateral speed" not in Page(page_path).text


def test_an_averaged_signal_keeps_its_mean_beside_its_extremes():
    time = np.linspace(0.0, 20.0, 20_001)
    value = np.sin(700.0 * time) + 0.1 * time
    value[7_777] = 9.0
    middle, mean = averaged(time, value)
    assert len(middle) < 500
    assert np.mean(mean) == pytest.approx(np.mean(value), abs=1e-3)
    panel = Panel(200)
    panel.rippling(time, value, palette.MEASURED, "ripple")
    panel.legend()
    samples, means = lines(panel, "ripple")
    assert samples.y.max() == 9.0
    assert means.y.max() < 4.0


def test_angles_are_given_in_degrees_too():
    assert measure(0.02, "rad") == "0.02 rad (1.15°)"
    assert measure(None, "m") == "–"
    assert measure(0.5, "m/s") == "0.5 m/s"


def test_the_path_shows_each_wheel_of_a_robot_that_is_large_enough_to_see(robot_trace):
    short = Trace({name: values[:1500] for name, values in robot_trace.columns.items()})
    (panel,) = runs.path(short, (), (), read_robot()).panels
    assert sorted(texts(panel)) == ["1", "1", "2", "2", "3", "3", "4", "4"]
