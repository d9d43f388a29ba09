"""What a page gives to BokehJS is what Bokeh's own classes know, with the same values."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator
from typing import Any

import bokeh.models
import made_findings
import numpy as np
import pytest
from bokeh.core.serialization import Deserializer
from bokeh.plotting import figure
from test_report import figures

from omnimj.view.plots import mismatch, runs
from omnimj.view.plots.document import embed
from omnimj.view.plots.evaluation import confusion_picture
from omnimj.view.plots.models import Model, encode, python_models
from omnimj.view.plots.panels import Drawing, Panel
from omnimj.view.wording import Span

FAULT = Span("slip, wheel 2", "wheel_2", "slip", 3.0, 5.0)
FREE = {"kind", "id"}


def below(value: Any) -> Iterator[Model]:
    """Objects in a value, each once per place."""
    if isinstance(value, Model):
        yield value
        value = [part for name, part in vars(value).items() if name not in FREE]
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        yield from itertools.chain.from_iterable(map(below, value))


@pytest.fixture
def drawings(robot_trace, rig_trace) -> list[Drawing]:
    """All kinds of plots and glyphs."""
    finding = made_findings.rig_named()
    variable, place = mismatch.regime_variables(finding)[0]
    other = Panel(250, over_time=False, x_log=True)
    other.band(np.array([1.0, 2.0]), np.zeros(2), np.ones(2), "#112233", 0.3)
    other.bars([1.0, 2.0], [3.0, 4.0], [0, 1], 0.5, ["#112233", "#445566"], "bars", ("one", "two"))
    other.shade("regime", 1.0, None, 0.2)
    other.legend()
    return [
        *figures(robot_trace, rig_trace, (FAULT,)).values(),
        runs.path(robot_trace, (), (FAULT,)),
        mismatch.against_regime(finding, variable, place),
        mismatch.spectra(finding, [0, 1]),
        mismatch.shrinkage(finding),
        confusion_picture({"none": {"none": 3}, "motor 1": {"several": 1, "motor 1": 2}}),
        other.finish(),
    ]


@pytest.mark.slow
def test_bokeh_knows_every_kind_attribute_and_value_that_a_page_has(drawings):
    seen = set()
    for panel in itertools.chain.from_iterable(drawing.panels for drawing in drawings):
        checked = python_models(panel.plot)
        assert isinstance(checked, figure)
        found = {model.id: model for model in checked.references()}
        for own in below(panel.plot):
            other = found[own.id]
            assert isinstance(other, getattr(bokeh.models, own.kind, figure))
            assert set(vars(own)) - FREE <= set(other.properties()), own.kind
            plain = {
                name: value
                for name, value in vars(own).items()
                if name not in FREE and isinstance(value, str | float | int | None)
            }
            for name, value in plain.items():
                assert getattr(other, name) == value, (own.kind, name)
            seen.add(own.kind)
    assert seen >= {"Line", "Scatter", "HBar", "Patch", "Quad", "Segment", "VArea", "BoxAnnotation", "Label"}


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (Model("Wedges"), "Wedges"),
        (Model("Span", line_dash="zigzag"), "zigzag"),
        (Model("Span", level=3), "level"),
    ],
)
def test_a_kind_or_value_that_bokeh_does_not_know_does_not_become_a_model_of_it(wrong, named):
    with pytest.raises(ValueError, match=named):
        python_models(wrong)


def test_an_object_in_several_places_is_described_once_and_numbers_without_json_are_kept():
    shared = Model("Range1d", start=float("nan"), end=np.float64(2.0))
    first, again = encode([shared, shared], {"range": shared})
    assert first[1] == again["entries"][0][1] == {"id": shared.id}
    assert first[0]["attributes"] == {"start": {"type": "number", "value": "nan"}, "end": 2.0}


def test_no_text_of_a_plot_ends_the_script_of_its_page():
    evil = "</script><!--<script>\u2028'\"\\"
    panel = Panel(250, over_time=False, label=evil)
    panel.line(np.array([0.0, np.nan]), np.array([0.0, np.inf]), label=evil)
    panel.text(0.5, 0.5, evil)
    panel.legend()
    script, elements = embed({"plot": panel.finish()})
    assert "<" not in script and list(elements) == ["plot"]
    called = re.fullmatch(r"Bokeh\.embed\.embed_items\((\{.*\}),(\[.*\])\);", script.replace("}, [", "},["))
    assert called
    document, (item,) = json.loads(called[1])["page"], json.loads(called[2])
    assert f"id='{item['root_ids'][0]}'" in elements["plot"]
    (root,) = Deserializer().decode(document["roots"])
    assert root.children[0].yaxis.axis_label == evil
