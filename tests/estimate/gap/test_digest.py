"""`gap.json` keeps to its schema whatever was found, and holds the numbers of the finding."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_findings import FINDINGS, linear_axis, rig_ambiguous, rig_named, rig_no_gap, robot

from omnimj.estimate.gap.files import digest
from omnimj.estimate.gap.records import run_gaps, typical_run, worst_run
from omnimj.estimate.gap.sentences import (
    as_sentence,
    format_amount,
    format_in_noise,
    format_percent,
    join_words,
    summarize_finding,
)
from omnimj.recording.json_files import to_jsonable, write_json

SCHEMA = json.loads((Path(__file__).parents[2] / "schema" / "gap.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", FINDINGS)
def test_every_finding_keeps_to_the_schema(tmp_path, name):
    finding = FINDINGS[name]()
    write_json(
        tmp_path / "gap.json", digest(finding, "model.toml" if finding.effects else None, None, "omnimj gap")
    )
    content = json.loads((tmp_path / "gap.json").read_text(encoding="utf-8"))
    jsonschema.validate(content, SCHEMA)
    assert content["verdict"] == finding.verdict
    assert [effect["effect"] for effect in content["effects"]] == [e.effect for e in finding.effects]
    assert [place["share"] for place in content["where"]] == sorted(
        (place.share for place in finding.where), reverse=True
    )


def test_an_effect_keeps_its_interval_its_rivals_and_its_selector():
    (effect,) = digest(robot())["effects"]
    assert effect["parameters"]["scale"] == {"value": 0.91, "low": 0.89, "high": 0.925, "unit": "1"}
    assert effect["indistinguishable_from"] == ["current_scale"]
    assert effect["selectors"] == {"wheel": 3}


def test_a_regime_is_given_in_words_and_as_bounds_with_null_for_an_open_side():
    place = next(p for p in digest(rig_named())["where"] if "negative" in p["regime"]["words"])
    assert place["regime"]["bounds"] == {"lateral_speed": [None, -0.1]}


def test_what_is_not_a_number_becomes_null_and_never_nan():
    finding = replace(rig_named(), effective_samples=math.nan, noise={"wheel_speed": math.inf})
    content = digest(finding)
    assert content["n_eff"] is None and content["noise"] == {"wheel_speed": None}
    json.dumps(content, allow_nan=False)


numbers = st.floats() | st.integers() | st.booleans() | st.none() | st.text()


@pytest.mark.slow
@given(
    st.recursive(numbers, lambda x: st.lists(x) | st.dictionaries(st.text(), x) | st.tuples(x), max_leaves=20)
)
def test_any_content_can_be_written_as_json(value):
    json.dumps(to_jsonable(value), allow_nan=False)
    json.dumps(to_jsonable(np.array([1.0, math.nan])), allow_nan=False)


def test_the_gap_of_the_runs_adds_up_to_that_of_the_channels():
    finding = rig_named()
    lengths = {o.run: len(o.time) for o in finding.overlays}
    held = [gap for gap in run_gaps(finding) if gap.heldout]
    for channel, whole in finding.heldout.items():
        squares = sum(lengths[gap.run] * gap.before[channel] ** 2 for gap in held)
        assert math.sqrt(squares / sum(lengths[gap.run] for gap in held)) == pytest.approx(whole.before)


def test_windows_of_one_run_are_one_run():
    gaps = run_gaps(robot())
    assert sorted(gap.run for gap in gaps) == ["mission_1", "mission_2", "mission_3"]
    assert [gap.run for gap in gaps if gap.heldout] == ["mission_3"] and not any(gap.partly for gap in gaps)


def test_a_run_of_which_some_windows_are_held_out_is_held_out_in_part():
    finding = robot()
    some = tuple(replace(o, heldout=k == 0) for k, o in enumerate(finding.overlays))
    (gap,) = [gap for gap in run_gaps(replace(finding, overlays=some)) if gap.heldout]
    assert gap.partly and gap.run == "mission_1"


def test_the_worst_run_is_held_out_and_the_typical_one_is_not_worse():
    finding = linear_axis()
    by_name = {gap.run: gap for gap in run_gaps(finding)}
    worst, typical = worst_run(finding), typical_run(finding)
    assert worst is not None and typical is not None and worst != typical
    assert by_name[worst].heldout and by_name[typical].heldout
    assert by_name[worst].total_before >= by_name[typical].total_before


def test_masked_blocks_do_not_count():
    finding = rig_no_gap()
    first = finding.overlays[0]
    measured = first.measured.copy()
    measured[5:9, 1] = math.nan
    masked = replace(finding, overlays=(replace(first, measured=measured),))
    (gap,) = run_gaps(masked)
    kept = np.delete((first.measured - first.before)[:, 1], slice(5, 9))
    assert gap.before["carriage_speed"] == pytest.approx(math.sqrt(np.mean(kept**2)))


def test_a_channel_without_any_value_is_null(tmp_path):
    finding = rig_no_gap()
    nothing = tuple(replace(o, measured=o.measured * [1.0, math.nan, 1.0]) for o in finding.overlays)
    content = digest(replace(finding, overlays=nothing))
    assert content["runs"][0]["before"]["carriage_speed"] is None
    assert content["runs"][0]["total_before"] > 0.0


def test_the_summary_names_what_is_missing_and_every_rival():
    assert "lateral_coupling" in summarize_finding(rig_named()) and "0.0561 m/s" in summarize_finding(
        rig_named()
    )
    for name in ("rail_coulomb", "rolling_resistance", "grade"):
        assert name in summarize_finding(rig_ambiguous())
    assert "interrupted" in summarize_finding(replace(rig_named(), failure="interrupted"))


def test_numbers_are_printed_as_a_person_writes_them():
    assert (format_percent(0.583), format_percent(0.0045), format_percent(-0.02)) == (
        "58 %",
        "0.45 %",
        "−2 %",
    )
    assert (
        format_amount(-0.1, "N.m2") == "−0.1 N·m²"
        and format_amount(None, "N") == "–"
        and format_amount(0.5, "1") == "0.5"
    )
    assert format_in_noise(1.02) == "about the noise" and format_in_noise(4.44) == "4.4 times the noise"
    assert join_words(["a", "b", "c"], "or") == "a, b or c"
    assert (
        as_sentence("what is left") == "What is left."
        and as_sentence("rail_drag leads") == "rail_drag leads."
    )
