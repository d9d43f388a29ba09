"""A static picture shows what the browser draws: the same values, ranges, names and words, in few bytes."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from typing import Any

import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import numpy as np
import pytest
from browser import run
from hypothesis import given, settings
from test_report import Page

from omnimj.view import palette
from omnimj.view.plots import runs
from omnimj.view.plots.outlines import CLOSE, simplified
from omnimj.view.plots.over_time import shade_faults
from omnimj.view.plots.panels import Drawing, Panel, new_drawing
from omnimj.view.plots.static import WIDTH, svg, svg_file
from omnimj.view.wording import Span

TENTH = 0.06  # [pixels] rounding of coordinates
STILL = re.compile(r"<div class='still'>(<svg.*?)</div>", re.DOTALL)
BLUE = "#0000FF"


def read(text: str) -> Any:
    """Root of a picture."""
    return ElementTree.fromstring(text)


def elements(drawing: Drawing) -> Any:
    """Root of the picture of a drawing."""
    return read(svg(drawing))


def frame_of(picture: Any) -> tuple[Any, float, float]:
    """The inner picture of the first panel, and its width and height [pixels]."""
    inner = picture.find("svg")
    return inner, float(inner.get("width")), float(inner.get("height"))


def points_of(path: str) -> list[np.ndarray]:
    """Corners of the lines of a path, each shape (k, 2) [pixels]."""
    found = []
    for part in path.split("M")[1:]:
        numbers = np.array([float(n) for n in re.findall(r"-?(?:\d+\.?\d*|\.\d+)", part)])
        found.append(np.cumsum(numbers.reshape(-1, 2), axis=0))
    return found


def drawn(picture: Any, color: str) -> np.ndarray:
    """Corners of all lines of a colour in the first panel, shape (k, 2) [pixels]."""
    paths = [p.get("d") for p in frame_of(picture)[0].iter("path") if p.get("stroke") == color]
    return np.vstack([points for path in paths for points in points_of(path)])


def words(picture: Any) -> list[str]:
    return ["\n".join(text.itertext()) for text in picture.iter("text")]


def value_ticks(picture: Any) -> list[tuple[float, float]]:
    """Value and height [pixels] of the ticks of the value axis."""
    found = [text for text in picture.findall("text") if text.get("text-anchor") == "end" and text.get("x")]
    return [(float(text.text.replace("−", "-")), float(text.get("y"))) for text in found]


def plain(x, y, **style) -> Drawing:
    """A line in a panel that is not over time."""
    panel = Panel(250, over_time=False, label="value [m]", x_label="place [m]", **style)
    panel.line(np.asarray(x, float), np.asarray(y, float), BLUE)
    panel.finish()
    return Drawing((panel,))


@pytest.fixture(scope="module")
def pages(compared_file, rig_file):
    """Reports of a run of the robot beside another method, and of a run of the rig."""
    return {"robot": compared_file, "rig": rig_file}


@pytest.mark.slow
@pytest.mark.parametrize("machine", ["robot", "rig"])
def test_every_plot_of_a_run_has_a_static_picture_in_its_page(machine, pages):
    found = STILL.findall(pages[machine].read_text(encoding="utf-8"))
    assert len(found) == Page(pages[machine]).plots >= 6
    for text in found:
        picture = read(text)
        assert list(picture.iter("path")) and words(picture)
    assert sum(map(len, found)) < 40_000 * len(found)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    values=hnp.arrays(float, st.integers(2, 900), elements=st.floats(-1e6, 1e6, allow_subnormal=False)),
)
def test_the_extremes_of_every_line_lie_inside_the_frame_where_bokeh_puts_them(values):
    picture = elements(plain(np.arange(len(values)), values))
    _, width, height = frame_of(picture)
    across, up = drawn(picture, BLUE).T
    # Bokeh pads the data by a share of their span: 0.1 across and 0.08 up
    assert [across.min(), across.max()] == pytest.approx([width * 0.05 / 1.1, width * 1.05 / 1.1], abs=TENTH)
    expected = [height * 0.04 / 1.08, height * 1.04 / 1.08]
    span = np.ptp(values.astype(np.float32))
    if span > 1e-3 * np.abs(values).max():
        # each left-out point may be 0.3 pixels from the line
        assert [up.min(), up.max()] == pytest.approx(expected, abs=0.3 + TENTH)
    assert up.min() >= 0.0 and up.max() <= height


def test_a_peak_of_one_sample_is_in_the_static_picture():
    time = np.linspace(0.0, 10.0, 200_001)
    value = np.sin(time)
    value[123_456] = 30.0
    drawing = new_drawing(250)
    drawing.panels[0].line(time, value, BLUE)
    drawing.panels[0].x_limits(0.0, 10.0)
    picture = elements(drawing)
    _, width, height = frame_of(picture)
    points = drawn(picture, BLUE)
    peak = points[points[:, 1].argmin()]
    assert peak[1] == pytest.approx(height * 0.04 / 1.08, abs=TENTH)
    assert peak[0] == pytest.approx(width * time[123_456] / 10.0, abs=1.5)
    assert len(svg(drawing)) < 10_000


def distance(point: np.ndarray, line: np.ndarray) -> float:
    """Distance of a point from a line with corners, shape (k, 2)."""
    start, along = line[:-1], np.diff(line, axis=0)
    share = np.sum((point - start) * along, axis=1) / np.maximum(np.sum(along**2, axis=1), 1e-12)
    return float(np.linalg.norm(start + np.clip(share, 0, 1)[:, None] * along - point, axis=1).min())


@pytest.mark.parametrize("kind", ["wandering", "there and back", "circle"])
def test_no_point_of_a_path_is_further_than_half_a_pixel_from_its_picture(kind):
    rng, turn = np.random.default_rng(3), np.linspace(0.0, 2.0 * np.pi, 700)
    x, y = {
        "wandering": np.cumsum(rng.normal(size=(2, 700)), axis=1),
        "there and back": np.array([np.sin(turn), 0.5 * np.sin(turn)]),
        "circle": np.array([np.cos(turn), np.sin(turn)]),
    }[kind]
    picture = elements(plain(x, y))
    _, width, height = frame_of(picture)
    line = drawn(picture, BLUE)
    across = width * (0.05 + (x - x.min()) / np.ptp(x)) / 1.1
    up = height * (0.04 + (y.max() - y) / np.ptp(y)) / 1.08
    assert max(distance(point, line) for point in np.column_stack([across, up])) < 0.5
    assert kind == "wandering" or len(line) < 200


def recursively(places: np.ndarray, close: float) -> list[complex]:
    """Douglas and Peucker as they wrote it."""
    first, last = places[0], places[-1]
    if len(places) < 3:
        return [first, last]
    ends = np.array([[first.real, first.imag], [last.real, last.imag]])
    away = [distance(np.array([p.real, p.imag]), ends) for p in places[1:-1]]
    middle = int(np.argmax(away)) + 1
    if away[middle - 1] <= close:
        return [first, last]
    return recursively(places[: middle + 1], close)[:-1] + recursively(places[middle:], close)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(-40, 40), st.integers(-40, 40)), min_size=1, max_size=40))
def test_a_line_is_simplified_as_by_splitting_it_at_its_farthest_point_again_and_again(corners):
    places = np.array([complex(x, y) for x, y in corners])
    found = simplified(places).tolist()
    expected = recursively(places, CLOSE)
    assert found == (expected if len(places) > 1 else places.tolist())


def test_a_gap_in_the_data_is_a_gap_in_the_line():
    values = np.array([0.0, 1.0, np.nan, 1.0, 0.0, np.nan, np.nan, 3.0])
    picture = elements(plain(np.arange(8), values))
    (path,) = (p.get("d") for p in frame_of(picture)[0].iter("path") if p.get("stroke") == BLUE)
    assert [len(points) for points in points_of(path)] == [2, 2, 2]  # the last one is a dot


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    middle=st.floats(-1e4, 1e4),
    span=st.floats(1e-3, 1e5),
)
def test_the_names_of_ticks_span_the_range_in_equal_steps_at_their_heights(middle, span):
    low, high = middle - 0.5 * span, middle + 0.5 * span
    panel = Panel(250, over_time=False)
    panel.limits(low, high)
    panel.finish()
    picture = elements(Drawing((panel,)))
    inner, _, height = frame_of(picture)
    values, heights = np.array(value_ticks(picture)).T
    steps = np.diff(values)
    near = 1e-6 * span + 1e-8 * abs(middle)
    assert 2 <= len(values) <= 9
    assert steps == pytest.approx(np.full(len(steps), steps[0]), abs=near)
    assert low - near <= values[0] < low + steps[0] + near
    assert high - steps[0] - near < values[-1] <= high + near
    expected = float(inner.get("y")) + height * (high - values) / (high - low) + 4
    assert heights == pytest.approx(expected, abs=TENTH + height * near / span)
    digits = f"{steps[0]:.3e}"[:5]
    assert digits in ("1.000", "2.000", "5.000")


def test_decades_are_equally_far_apart_on_a_logarithmic_axis():
    values = np.geomspace(0.01, 1e4, 50)
    picture = elements(plain(np.arange(50), values, y_log=True))
    ticks = np.array(value_ticks(picture))
    assert ticks[:, 0] == pytest.approx(10.0 ** np.arange(-2, 5))
    assert np.diff(ticks[:, 1]) == pytest.approx(np.full(6, np.diff(ticks[:, 1])[0]), abs=2 * TENTH)
    across, up = drawn(picture, BLUE).T  # an exponential is straight
    assert np.polyval(np.polyfit(across, up, 1), across) == pytest.approx(up, abs=0.4)


def test_named_ticks_have_their_names_and_other_places_none():
    panel = Panel(250, over_time=False)
    panel.bars([0.0, 1.0], [2.0, 3.0], [0, 1], 0.5, [BLUE, "#00FF00"])
    panel.rows(["true: wheel 1", "a long name\nin two lines"])
    panel.finish()
    picture = elements(Drawing((panel,)))
    rows = [text for text in picture.findall("text") if text.get("text-anchor") == "end"]
    assert ["\n".join(text.itertext()) for text in rows] == ["true: wheel 1", "a long name\nin two lines"]
    assert float(rows[0].get("y")) < float(rows[1].get("y"))  # the first row is at the top
    inner, width, height = frame_of(picture)
    bars = {p.get("fill"): points_of(p.get("d").rstrip("z"))[0] for p in inner.iter("path") if p.get("fill")}
    for color, row, ends in ((BLUE, 0, (0.0, 2.0)), ("#00FF00", 1, (1.0, 3.0))):
        expected = width * (0.05 + np.array(ends) / 3.0) / 1.1
        assert [bars[color][:, 0].min(), bars[color][:, 0].max()] == pytest.approx(expected, abs=TENTH)
        assert bars[color][:, 1].mean() == pytest.approx(height * (row + 0.5) / 2.0, abs=TENTH)


def test_panels_that_share_their_value_axis_have_the_same_ticks(robot_trace):
    drawing = runs.wheel_speeds(robot_trace, ())
    values = [value for value, _ in value_ticks(elements(drawing))]
    quarter = len(values) // 4
    assert quarter >= 2 and all(values[:quarter] == values[k * quarter :][:quarter] for k in range(4))
    speeds = np.array([robot_trace[f"wheel_speed_{i}"] for i in range(1, 5)])
    assert values[quarter - 1] < 1.05 * speeds.max() and values[0] > 1.05 * speeds.min()


def test_a_circle_on_a_map_is_round():
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    across, up = drawn(elements(plain(3.0 * np.cos(turn), 3.0 * np.sin(turn), equal=True)), BLUE).T
    assert np.ptp(across) == pytest.approx(np.ptp(up), rel=0.01)


def test_texts_are_escaped_and_read_back_as_they_were():
    evil = '</svg><script>alert("x & y")</script>'
    panel = Panel(250, label=evil, x_label=evil)
    panel.line(np.array([0.0, 1.0]), np.array([0.0, 1.0]), label=evil)
    panel.text(0.5, 0.5, evil)
    panel.x_limits(0.0, 1.0)
    panel.legend()
    panel.finish()
    text = svg(Drawing((panel,)), evil)
    assert "<script" not in text
    picture = read(text)
    assert picture.get("aria-label") == evil
    assert words(picture).count(evil) == 4  # label of each axis, entry of the legend, words at the point


def test_what_is_invisible_is_not_drawn_but_counts_for_the_range():
    panel = Panel(250, over_time=False)
    panel.points([0.0], [0.0], BLUE)
    panel.contains(np.array([-10.0, -10.0]), np.array([10.0, 10.0]))
    panel.finish()
    picture = elements(Drawing((panel,)))
    inner, width, height = frame_of(picture)
    ((dot,),) = (
        points_of(p.get("d").replace("h0", "")) for p in inner.iter("path") if p.get("stroke") == BLUE
    )
    assert dot[0] == pytest.approx([0.5 * width, 0.5 * height], abs=TENTH)
    assert len([p for p in inner.iter("path") if p.get("stroke") != palette.GRID]) == 1
    assert value_ticks(picture)[-1][0] >= 10.0


def test_a_fault_is_shaded_from_its_onset_to_its_end_and_named():
    panel = Panel(250)
    panel.x_limits(0.0, 10.0)
    shade_faults(panel, [Span("slip, wheel 2", "wheel_2", "slip", 3.0, 5.0)], np.array([0.0, 10.0]))
    panel.finish()
    picture = elements(Drawing((panel,)))
    inner, width, height = frame_of(picture)
    (band,) = (p for p in inner.iter("path") if p.get("fill") == palette.FAULT)
    left, top, right, bottom = map(float, re.findall(r"-?[\d.]+", band.get("d"))[:4])
    assert [left, right] == pytest.approx([0.3 * width, 0.5 * width], abs=1.1)
    assert top <= 0.0 and bottom >= height
    assert "slip, wheel 2" in words(picture)


def test_entries_of_a_legend_are_all_there_inside_the_picture():
    panel = Panel(250, over_time=False)
    for k in range(9):
        panel.line(np.array([0.0, 1.0]), np.array([0.0, k]), label=f"line number {k}")
    panel.points([0.5], [0.5], BLUE, "points", "star")
    panel.legend()
    panel.finish()
    picture = elements(Drawing((panel,)))
    entries = {text.text: float(text.get("x")) for text in picture.findall("text")}
    for name in panel.labels:
        assert 0.0 < entries[name] < WIDTH - 6 * len(name)


def test_a_kind_of_glyph_or_mark_that_is_unknown_is_an_error_that_names_it():
    drawing = plain([0.0, 1.0], [0.0, 1.0])
    drawing.panels[0].plot.renderers[0].glyph.kind = "Wedge"
    with pytest.raises(TypeError, match="Wedge"):
        svg(drawing)
    panel = Panel(250, over_time=False)
    panel.points([0.0], [0.0], marker="hex")
    with pytest.raises(TypeError, match="hex"):
        svg(Drawing((panel,)))


def test_a_file_is_a_picture_of_its_own_on_white(robot_trace):
    drawing = runs.velocity(robot_trace, ())
    picture = read(svg_file(drawing, "velocity"))
    assert picture.tag == "{http://www.w3.org/2000/svg}svg"
    assert picture[0].get("fill") == "white"
    assert picture.get("viewBox") == f"0 0 {picture.get('width')} {picture.get('height')}"
    assert int(picture.get("height")) == drawing.height


@pytest.mark.slow
def test_the_static_picture_is_shown_only_where_scripts_do_not_run(pages, browser, tmp_path):
    look = """<!DOCTYPE html><body><pre id='result'></pre><script>
    const page = %s, seen = [];
    for (const rights of ['allow-same-origin', 'allow-same-origin allow-scripts']) {
      const frame = document.createElement('iframe');
      frame.width = 1200; frame.setAttribute('sandbox', rights); frame.srcdoc = page;
      frame.onload = () => {
        const heights = name => [...frame.contentDocument.getElementsByClassName(name)].map(
          e => e.getBoundingClientRect().height > 100);
        seen.push([rights, heights('still'), heights('live')]);
        document.getElementById('result').textContent = JSON.stringify(seen);
      };
      document.body.append(frame);
    }</script>"""
    quoted = json.dumps(pages["rig"].read_text(encoding="utf-8")).replace("<", "\\u003c")
    (tmp_path / "look.html").write_text(look % quoted, encoding="utf-8")
    dumped = run(browser, tmp_path, "--dump-dom", (tmp_path / "look.html").as_uri())
    result = re.search(r"<pre id=\"result\">(.+?)</pre>", dumped)
    assert result
    seen = {rights: (set(still), set(live)) for rights, still, live in json.loads(result[1])}
    assert seen == {
        "allow-same-origin": ({True}, {False}),
        "allow-same-origin allow-scripts": ({False}, {True}),
    }


@pytest.mark.slow
def test_plots_on_paper_are_the_static_pictures_and_not_the_canvases_of_the_screen(pages, browser, tmp_path):
    run(browser, tmp_path, f"--print-to-pdf={tmp_path / 'page.pdf'}", pages["rig"].as_uri())
    whole = pages["rig"].read_text(encoding="utf-8").replace(".live { display: none; }", "")
    (tmp_path / "canvases.html").write_text(whole, encoding="utf-8")
    run(
        browser,
        tmp_path,
        f"--print-to-pdf={tmp_path / 'canvases.pdf'}",
        (tmp_path / "canvases.html").as_uri(),
    )
    images = [
        (tmp_path / f"{name}.pdf").read_bytes().count(b"/Subtype /Image") for name in ("page", "canvases")
    ]
    assert images[0] == 0 and images[1] > 0
