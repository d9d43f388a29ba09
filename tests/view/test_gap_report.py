"""The gap report is one page that needs nothing else; its numbers are those of `gap.json`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn import labels_of, lines, row_names
from made_findings import FINDINGS, rig_named, rig_no_gap, robot
from test_report import Page, without_scripts
from undrawn_pages import without_embedding

from omnimj.estimate.gap.files import digest
from omnimj.estimate.gap.records import ChannelGap, Finding, MismatchRegime, NamedEffect, run_gaps
from omnimj.view.plots import candidates, mismatch
from omnimj.view.plots.panels import Panel
from omnimj.view.report.gap import write_gap_report

_NUMBER = re.compile(r"(?<![\w.])[−-]?\d+(?:\.\d+)?(?:e[−-]?\d+)?(?![\w.])")


class Cells(HTMLParser):
    """Texts of the cells of numbers."""

    def __init__(self, path: Path):
        super().__init__()
        self.texts: list[str] = []
        self._inside = False
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        if tag == "td":
            self._inside = "number" in (dict(attrs).get("class") or "")
            if self._inside:
                self.texts.append("")
        if tag == "small":
            self._inside = False

    def handle_endtag(self, tag):
        if tag == "td":
            self._inside = False

    def handle_data(self, data):
        if self._inside:
            self.texts[-1] += data


def numbers_in(value: object) -> Iterator[float]:
    """All numbers of a digest."""
    if isinstance(value, dict):
        for name, entry in value.items():
            if name != "decoys":  # so many that any number would be among them
                yield from numbers_in(entry)
    elif isinstance(value, list):
        for entry in value:
            yield from numbers_in(entry)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield float(value)


DRAWN = ("three", "robot")
"""Findings whose pages have scripts: that of the rig with most figures, and windows of a robot."""


@pytest.fixture(scope="module", autouse=True)
def few_figures():
    """Plots of the worst and the typical run on a page: they take most of its time, and there are 24."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("omnimj.view.report.gap.MOST_FIGURES", 2)
        yield


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("gap")
    for name, make in FINDINGS.items():
        finding = make()
        new_model = "model.toml" if finding.effects else None
        command = f"omnimj gap {name} --out 'o & o'"
        with nullcontext() if name in DRAWN else without_embedding():
            write_gap_report(folder / f"{name}.html", finding, new_model, None, command)
    return {name: folder / f"{name}.html" for name in FINDINGS}


@pytest.mark.slow
@pytest.mark.parametrize("name", FINDINGS)
def test_the_page_is_whole_and_needs_nothing_from_elsewhere(pages, name):
    raw = without_scripts(pages[name].read_text(encoding="utf-8"))
    page = Page(pages[name])
    assert raw.startswith("<!DOCTYPE html>")
    assert not re.search(r"https?:|//cdn|@import|url\((?!#)", raw)
    assert all(link.startswith(("#", "data:")) for link in page.links)
    assert pages[name].stat().st_size < 2e6
    assert len(page.ids) == len(set(page.ids))
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', raw)) <= set(page.ids)


@pytest.mark.slow
@pytest.mark.parametrize("name", FINDINGS)
def test_every_number_in_the_tables_is_in_gap_json(pages, name):
    known = list(numbers_in(digest(FINDINGS[name]())))
    known = np.array(known)
    cells = Cells(pages[name]).texts
    assert len(cells) > 20
    for text in cells:
        values = 100.0 * known if "%" in text else known
        for shown in _NUMBER.findall(text.replace("e−", "e-")):
            number = float(shown.replace("−", "-"))
            exponent = math.floor(math.log10(abs(number))) if number else 0
            digits = len(re.sub(r"e.*|[−.-]", "", shown).lstrip("0")) or 1
            room = 0.5 * 10.0 ** (exponent - digits + 1)
            assert np.min(np.abs(values - number)) <= room * (1.0 + 1e-6), (text, shown)


@pytest.mark.slow
@pytest.mark.parametrize("name", FINDINGS)
def test_the_story_goes_from_the_verdict_to_how_it_was_done(pages, name):
    page = Page(pages[name])
    text = page.text
    finding = FINDINGS[name]()
    amount = "How much smaller" if finding.effects else "How large"
    order = ["Gap of", "Data check", "Where the gap is", "Missing effects"]
    order += ["Uncertain parameters", "How sure", amount, "Next step", "Method"]
    places = [text.index(words, 0) if k == 0 else text.rindex(words) for k, words in enumerate(order)]
    assert places == sorted(places)
    for effect in finding.effects:
        assert effect.words in text
        for rival in effect.indistinguishable_from:
            assert rival in text
    for place in finding.where:
        assert place.regime in text
    assert f"omnimj gap {name} --out 'o & o'" in "".join(page.words)


@pytest.mark.slow
def test_every_figure_has_a_heading_and_a_caption(pages):
    raw = pages["three"].read_text(encoding="utf-8")
    figures = re.findall(r"<figure.*?</figure>", raw, re.DOTALL)
    assert len(figures) > 10
    for figure in figures:
        found = re.match(
            r"<figure[^>]*><figcaption><b>(.+?)</b>(.+?)</figcaption><div class='plot'", figure, re.DOTALL
        )
        assert found and len(found[1]) > 4 and len(found[2]) > 30


@pytest.mark.slow
def test_an_unfinished_search_is_marked_as_such(pages):
    assert "Not finished" in Page(pages["interrupted"]).text
    assert "Not finished" not in Page(pages["named"]).text


@pytest.mark.slow
def test_a_verdict_is_shown_by_word_and_symbol_and_not_by_colour_alone(pages):
    words = {
        "named": "✓ Named",
        "ambiguous": "? Ambiguous",
        "unexplained": "✗ Unexplained",
        "no_gap": "✓ No gap",
    }
    for name, verdict in words.items():
        assert verdict in Page(pages[name]).text


@pytest.mark.slow
def test_texts_from_outside_cannot_break_the_page(page_path):
    evil = "</main><script>alert('x')</script>"
    finding = rig_named()
    effect = replace(
        finding.effects[0], words=evil, indistinguishable_from=(evil,), selectors={"channel": evil}
    )
    place = replace(finding.where[0], regime=evil)
    notes = (evil,)
    first = replace(finding.overlays[0], run=evil, conditions={evil: evil})
    broken = replace(
        finding,
        dataset=evil,
        reason=evil,
        effects=(effect,),
        where=(place,),
        data_notes=notes,
        overlays=(first, *finding.overlays[1:]),
        next_experiment={"why": evil, "run": {evil: evil}, "separates": [evil], "parting": {evil: 2.0}},
        heldout_runs=(evil,),
        failure=evil,
    )
    write_gap_report(page_path, broken, "m.toml", "f.toml", evil)
    page = Page(page_path)
    assert not any(evil in script for script in page.scripts) and evil in page.text


def bare(finding: Finding) -> Finding:
    """Without all that may be missing."""
    return replace(
        finding,
        where=(),
        stages=(),
        refitted=(),
        overlays=(),
        next_experiment=None,
        data_notes=(),
        noise={},
        heldout={name: ChannelGap(1.0, None, None) for name in finding.channels},
        shrink=None,
    )


@pytest.mark.parametrize("name", ["named", "no_gap", "unexplained"])
def test_a_finding_with_next_to_nothing_in_it_has_a_report_too(page_path, name, undrawn):
    write_gap_report(page_path, bare(FINDINGS[name]()))
    assert "Method" in Page(page_path).text


@pytest.mark.slow
def test_masked_blocks_and_a_silent_channel_do_not_break_the_report(page_path):
    finding = rig_named()
    overlays = []
    for k, overlay in enumerate(finding.overlays):
        measured = overlay.measured * [1.0, math.nan if k % 2 else 1.0, math.nan]
        overlays.append(replace(overlay, measured=measured))
    write_gap_report(page_path, replace(finding, overlays=tuple(overlays)))
    assert "nan" not in Page(page_path).text.lower().replace("explanation", "")


@pytest.mark.slow
def test_every_axis_names_its_quantity(pages):
    finding = rig_named()
    variable, place = mismatch.regime_variables(finding)[0]
    (panel,) = mismatch.against_regime(finding, variable, place).panels
    assert panel.x_axis.axis_label == "lateral speed [m/s]"
    assert panel.y_axis.axis_label.endswith("[m/s]")
    run = mismatch.overlay(finding, list(finding.overlays[:1]))
    assert all(re.search(r"\[.+\]$", panel.y_axis.axis_label) for panel in run.panels)
    spectrum = mismatch.spectra(finding, [0, 1, 2])
    assert all(panel.y_axis.axis_label.endswith("/√Hz]") for panel in spectrum.panels)


def test_the_noise_of_a_perfect_model_lies_on_the_line_of_the_noise():
    finding = rig_no_gap()
    for panel in mismatch.spectra(finding, [0, 1, 2]).panels:
        spectrum, floor = lines(panel)
        assert np.sqrt(np.mean(spectrum.y[1:-1] ** 2)) == pytest.approx(floor.y[0], rel=0.12)


def test_a_place_for_either_sign_is_shaded_on_both_sides():
    place = MismatchRegime(
        "wheel_speed", "speed (either sign) above 0.5 m/s", {"speed": (0.5, 2.0)}, 1.0, 1.0
    )
    assert mismatch.spans_of(place, "speed") == [(-2.0, -0.5), (0.5, 2.0)]
    one = replace(place, regime="speed above 0.5 m/s")
    assert mismatch.spans_of(one, "speed") == [(0.5, 2.0)]


def test_texts_as_regimes_are_not_drawn_over():
    finding = rig_named()
    floors = tuple(
        replace(o, regimes={**o.regimes, "floor": np.full(len(o.time), "pvc", object)})
        for o in finding.overlays
    )
    place = replace(finding.where[0], bounds={"floor": (0.0, 1.0)})
    drawn = mismatch.regime_variables(replace(finding, overlays=floors, where=(place,)))
    assert drawn == []


def markers(panel: Panel) -> dict[str, Any]:
    """Markers by their entry of the legend."""
    return {label: drawn for drawn, label in labels_of(panel).items() if drawn.glyph.kind == "Scatter"}


def test_each_row_shows_the_mismatch_of_its_run():
    gaps = run_gaps(rig_named())[:14]
    (panel,) = mismatch.by_run(gaps).panels
    assert [name.split()[0] for name in row_names(panel)] == [gap.run for gap in gaps]
    for label in ("before", "after"):
        data = markers(panel)[label].data_source.data
        rows = [getattr(gaps[int(row)], f"total_{label}") for row in data["y"]]
        assert len(rows) == len(gaps) and data["x"] == pytest.approx(rows, rel=1e-6)


def test_the_ladder_distinguishes_verdicts_by_their_marks():
    (panel,) = candidates.candidate_gains(FINDINGS["ambiguous"]().stages[0]).panels
    marks = {label: drawn.glyph.marker for label, drawn in markers(panel).items()}
    assert len({marks["named"], marks["rival"], marks["beaten"]}) == 3


def test_windows_are_not_joined_by_a_line():
    finding = robot()
    windows = [o for o in finding.overlays if o.run == "mission_3"]
    apart = [replace(o, time=o.time + 3.0 * k) for k, o in enumerate(windows)]
    panel = mismatch.overlay(finding, apart).panels[0]
    for line in lines(panel):
        assert np.count_nonzero(np.isnan(line.y)) == len(apart) - 1


@pytest.mark.slow
def test_effects_without_known_probability_or_bounds_are_listed(page_path, undrawn):
    finding = rig_named()
    one: NamedEffect = finding.effects[0]
    loose = {name: replace(value, low=None, high=None) for name, value in one.parameters.items()}
    gain = replace(one.gain, low=None, high=None)
    effect = replace(one, p_false=None, parameters=loose, gain=gain)
    write_gap_report(page_path, replace(finding, effects=(effect,)))
    assert "no random curves were tried" in Page(page_path).text
