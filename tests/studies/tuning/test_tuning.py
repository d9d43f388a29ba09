"""A tuning as a whole: what it keeps, goes on with, judges and refuses."""

from __future__ import annotations

import dataclasses
import json
import re
import tomllib
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from inline_executor import InlineExecutor, quiet
from short_push import scenario_file
from small_tuning import CASCADE, small_tuning

from omnimj.control.gains import GAIN_NAMES, Gains, read_gains
from omnimj.errors import InputError, SimulationError, UnknownNameError
from omnimj.parameters import read_robot
from omnimj.recording.json_files import write_json
from omnimj.studies.runner import TrialFolder
from omnimj.studies.tuning import trial
from omnimj.studies.tuning.cost import importance, most_important_pairs
from omnimj.studies.tuning.draws import FAULTS, apply_draw, draw_trial, read_tuned_scenarios
from omnimj.studies.tuning.reporting import format_gains_file
from omnimj.studies.tuning.search import select_gains
from omnimj.studies.tuning.study import TuningConfig, TuningResult, run_tuning
from omnimj.studies.tuning.trial import drive_healthy, drive_trial, read_metrics
from omnimj.view.plots.tuning import convergence, front_of, landscape_picture, pareto
from omnimj.view.report.tuning import write_tuning_report

IDLE = "recovery.grip_share"
"""A gain that makes no difference: nothing slips in these draws."""


def done(order: TuningConfig, executor=None, report=quiet) -> TuningResult:
    outcome = run_tuning(order, report, InlineExecutor() if executor is None else executor)
    assert outcome is not None
    return outcome


@pytest.fixture(scope="module")
def tuned(tmp_path_factory) -> TuningResult:
    """A tuning of three gains and an idle one."""
    names = (*CASCADE, "control.heading_proportional", IDLE)
    return done(dataclasses.replace(small_tuning(tmp_path_factory.mktemp("tuned")), names=names))


@pytest.mark.slow
def test_a_search_that_was_broken_off_goes_on_and_ends_with_the_identical_file(order, tmp_path):
    whole = InlineExecutor()
    text = format_gains_file(done(order, whole), "omnimj tune")
    parts = dataclasses.replace(order, out=tmp_path / "parts.toml")
    driven = 0
    for stop in (3, 9, 14):

        def broken_off(phrase: str, share: float, left=[stop]) -> None:  # noqa: B006 counts down
            left[0] -= 1
            if left[0] < 0:
                raise KeyboardInterrupt

        some = InlineExecutor()
        assert run_tuning(parts, broken_off, some) is None
        driven += len(some.calls)
        assert not parts.out.exists()
    rest = InlineExecutor()
    assert format_gains_file(done(parts, rest), "omnimj tune") == text
    kept = {f.name for f in parts.folder.iterdir()}
    assert kept == {f.name for f in order.folder.iterdir()}
    again = InlineExecutor()
    assert format_gains_file(done(parts, again), "omnimj tune") == text
    assert len(again.calls) == 0, "everything was kept"


@pytest.mark.slow
def test_more_generations_are_added_to_those_that_are_there(order):
    first = done(order)
    more = InlineExecutor()
    longer = done(dataclasses.replace(order, generations=3), more)
    searched = [one for one in first.tried if one.generation <= order.generations]
    assert list(longer.tried[: len(searched)]) == searched
    fresh = InlineExecutor()
    assert (
        done(dataclasses.replace(order, out=order.out.with_name("fresh.toml"), generations=3), fresh).tried
        == longer.tried
    )
    assert 0 < len(more.calls) <= len(fresh.calls) - len(searched)


@pytest.mark.slow
def test_a_thread_finds_what_is_found_at_once(order, tmp_path):
    text = format_gains_file(done(order), "omnimj tune")
    with ThreadPoolExecutor(2) as executor:
        other = done(dataclasses.replace(order, out=tmp_path / "other.toml"), executor)
    assert format_gains_file(other, "omnimj tune") == text


@pytest.mark.slow
def test_what_is_found_is_never_worse_than_the_gains_before_on_the_draws_it_was_tuned_with(tuned):
    first = tuned.tried[0].score
    assert first.cost == pytest.approx(1.0) and first.violation == 0.0
    chosen = min(tuned.tried, key=lambda one: one.score.fitness)
    assert tuned.values == chosen.values and chosen.score.fitness <= first.fitness
    (verdict,) = tuned.comparisons
    assert verdict.seed == 100 and verdict.before.cost == pytest.approx(1.0)
    assert tuned.is_better == verdict.after.is_better_than(verdict.before)


@pytest.mark.slow
def test_a_gain_that_makes_no_difference_stays_where_it_was(tuned):
    before = Gains(read_robot().control)
    assert tuned.gains.value(IDLE) == before.value(IDLE)
    assert any(one.values[3] != before.value(IDLE) for one in tuned.tried), "the search had moved it"
    assert tuned.gains.value(CASCADE[0]) != before.value(CASCADE[0])


@pytest.mark.slow
def test_no_candidate_leaves_the_bounds_that_were_set(order):
    bounds = {"control.speed_proportional": (0.2, 0.35)}
    tried = [one.values[0] for one in done(dataclasses.replace(order, bounds=bounds)).tried]
    assert 0.2 <= min(tried) < max(tried) <= 0.35
    assert (
        max(one.values[0] for one in done(dataclasses.replace(order, out=order.out.with_name("b"))).tried)
        > 0.35
    )


@pytest.mark.slow
def test_a_search_that_begins_with_the_gains_of_a_file_is_that_of_a_robot_that_has_them(order, tmp_path):
    file, model = tmp_path / "first.toml", tmp_path / "robot.toml"
    entry = '[control]\nspeed_integral = { value = 2.0, unit = "A/rad", source = "chosen" }\n'
    file.write_text(entry, encoding="utf-8")
    text = read_robot().file.read_text(encoding="utf-8")
    old = re.findall(r"speed_integral = .*", text)
    model.write_text(text.replace(old[0], entry.split("\n")[1]), encoding="utf-8")
    begun = dataclasses.replace(order, gains=read_gains(file, read_robot().control), out=tmp_path / "a.toml")
    of_model = done(dataclasses.replace(order, model=model, out=tmp_path / "b.toml"))
    outcome = done(begun)
    assert outcome.gains == of_model.gains and outcome.gains.value("control.speed_integral") == 2.0
    assert [one.score for one in outcome.tried] == [one.score for one in of_model.tried]
    assert outcome.comparisons == of_model.comparisons


@pytest.mark.slow
def test_the_file_is_read_again_as_the_gains_that_were_found_and_states_its_origin(tuned, order):
    begun = Gains(read_robot().control).changed({"control.speed_integral": 2.0, "observer.memory": 60.0})
    for outcome in (
        tuned,
        done(dataclasses.replace(order, gains=begun, trials=1, generations=1, landscape=0)),
    ):
        order.out.write_text(format_gains_file(outcome, 'omnimj tune "a b" ü\t'), encoding="utf-8")
        assert read_gains(order.out, read_robot().control) == outcome.gains
        origin = tomllib.loads(order.out.read_text(encoding="utf-8"))["tuned"]
        assert origin["command"] == 'omnimj tune "a b" ü\t' and origin["better"] == outcome.is_better
        assert origin["judged_on_planar"]["seed"] == 100
        worse = dataclasses.replace(
            outcome, comparisons=tuple(dataclasses.replace(v, after=v.before) for v in outcome.comparisons)
        )
        text = format_gains_file(worse, "")
        assert "NOT BETTER" in text and "better = false" in text


@pytest.mark.slow
def test_trials_of_other_settings_are_replaced_with_force_only_and_foreign_folders_never(order):
    done(order)
    other = dataclasses.replace(order, seed=1, generations=1, landscape=0)
    with pytest.raises(InputError, match="holds a tuning with other settings"):
        run_tuning(other, quiet, InlineExecutor())
    assert done(dataclasses.replace(other, force=True)).config.seed == 1
    strange = dataclasses.replace(order, out=order.out.with_name("strange.toml"), force=True)
    strange.folder.mkdir()
    (strange.folder / "mine.txt").touch()
    with pytest.raises(InputError, match="choose another --out"):
        run_tuning(strange, quiet, InlineExecutor())
    assert (strange.folder / "mine.txt").exists()


@pytest.mark.slow
def test_a_kept_trial_of_another_truth_is_refused_and_one_that_broke_is_driven_again(order):
    done(order)
    files = sorted(order.folder.glob("trial_*"))
    write_json(files[0], {"error": "it broke"})
    again = InlineExecutor()
    done(order, again)
    assert len(again.calls) == 1
    result = TrialFolder(order.folder).read(files[0].stem)
    assert result is not None
    write_json(files[0], result | {"draw": result["draw"] | {"floor": "lava"}})
    with pytest.raises(InputError, match="holds another draw than this seed draws"):
        run_tuning(order, quiet, InlineExecutor())


def test_a_trial_that_breaks_for_no_fault_of_the_gains_ends_the_search_with_an_error(order, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("once")

    monkeypatch.setattr("omnimj.studies.tuning.trial.measure_trial", broken)
    with pytest.raises(SimulationError, match=r"trials failed; trial_push.*ZeroDivisionError: once"):
        run_tuning(order, quiet, InlineExecutor())


@pytest.mark.slow
def test_gains_that_break_a_run_down_come_behind_all_that_do_not(order, monkeypatch):
    drive_trial = trial.drive_trial

    def fragile(draw, values, uses, thresholds):
        found = drive_trial(draw, values, uses, thresholds)
        if values[CASCADE[0]] > 0.3:
            found = found | {"facts": {"broke": "at 0.1 s: x is nan"}}
        return found

    monkeypatch.setattr(trial, "drive_trial", fragile)
    outcome = done(dataclasses.replace(order, landscape=0))
    broke = [one.score for one in outcome.tried if one.score.broke]
    fine = [one.score for one in outcome.tried if not one.score.broke and one.score.violation < 10.0]
    assert broke and min(s.fitness for s in broke) > max(s.fitness for s in fine)
    assert outcome.values[0] <= 0.3
    assert all(np.isinf(s.terms["path"]) for s in broke)
    text = format_gains_file(outcome, "omnimj tune")
    assert tomllib.loads(text)


@pytest.mark.slow
def test_the_report_is_one_page_with_all_its_pictures_and_captions(tuned, tmp_path, undrawn):
    file = tmp_path / "report.html"
    write_tuning_report(file, tuned, "omnimj tune <push>")
    page = file.read_text(encoding="utf-8")
    assert page.count("class='plot'") == 4 and "http" not in page
    in_the_air = f"{tuned.margins_before[0].crossover:.2f} Hz"
    for words in ("heading_proportional", "omnimj tune &lt;push&gt;", "Seed 100", "no crossover", in_the_air):
        assert words in page


def test_a_point_has_the_gains_of_its_candidate_below_the_cursor(tuned):
    for draw in (convergence, pareto):
        (panel,) = draw(tuned).panels
        points = [r.data_source.data for r in panel.plot.renderers if "candidate" in r.data_source.data]
        numbers = np.concatenate([data["candidate"] for data in points])
        values = np.concatenate([[data[f"gain{k}"] for k in range(len(tuned.axes))] for data in points], 1).T
        assert values.tolist() == [list(tuned.tried[number].values) for number in numbers]
        tried = range(len(tuned.tried))
        within = [k for k in tried if tuned.tried[k].score.violation == 0.0]
        assert sorted(numbers) == (within if draw is pareto else list(tried))


def test_a_cell_of_the_landscape_is_the_lighter_the_smaller_its_cost(tuned):
    for found in tuned.landscapes:
        panel, _ = landscape_picture(found).panels
        cells = panel.plot.renderers[0].data_source.data
        scores = [score for row in found.scores for score in row]
        matches = [re.search(r": cost ([\d.]+|inf)(, breaks a limit)?$", name) for name in cells["name"]]
        costs = np.array([float(one[1]) for one in matches if one])
        assert costs == pytest.approx([score.cost for score in scores], abs=5e-5)
        assert [bool(one[2]) for one in matches if one] == [score.violation > 0.0 for score in scores]
        green = np.array([int(color[3:5], 16) for color in cells["color"]])[np.isfinite(costs)]
        order = np.argsort([score.cost for score in scores if np.isfinite(score.cost)])
        assert np.all(np.diff(green[order]) <= 0)
        (left, right), (low, high) = found.x[:2], found.y[:2]
        assert cells["right"][0] == pytest.approx(np.sqrt(left * right))
        assert cells["top"][0] == pytest.approx(np.sqrt(low * high))


def test_draws_depend_on_scenario_seed_and_number_alone_and_take_turns_in_what_breaks(tmp_path):
    text, other = scenario_file(tmp_path), scenario_file(tmp_path, "shove")
    both = read_tuned_scenarios((text, other), None)
    draws = [draw_trial(text, both[text], 7, k, "planar") for k in range(4)]
    assert draws == [draw_trial(text, both[text], 7, k, "planar") for k in range(4)]
    assert {draw.fault for draw in draws} == set(FAULTS)
    assert draws[0].errors != draw_trial(text, both[text], 107, 0, "planar").errors
    assert draws[0].errors != draw_trial(other, both[other], 7, 0, "planar").errors
    twin = draw_trial(text, both[text], 7, 0, "twin")
    assert dataclasses.replace(twin, plant="planar", name=draws[0].name) == draws[0]
    for draw in draws:
        json.dumps(draw.to_dict())
        assert abs(draw.errors.payload) <= 0.2
        assert not apply_draw(both[text], draw, False).faults
        truth = apply_draw(both[text], draw, True)
        kinds = [fault.kind for fault in truth.faults]
        assert kinds == {"none": []}.get(draw.fault, ["slip" if draw.fault == "slip" else "motor"])
        assert truth.constants.control == read_robot().control


def test_scenarios_that_cannot_be_tuned_with_are_refused(tmp_path):
    for text, expected in (
        ("rig_slip", "cannot be used for tuning"),
        ("circle_8m_kinematic", "cannot be used for tuning"),
        ("ramp", "cannot be used for tuning"),
    ):
        with pytest.raises(InputError, match=expected):
            read_tuned_scenarios((text,), None)
    folder = tmp_path / "again"
    folder.mkdir()
    with pytest.raises(InputError, match="'push' occurs twice"):
        read_tuned_scenarios((scenario_file(tmp_path), scenario_file(folder)), None)
    with pytest.raises(UnknownNameError, match="nylon_patch"):
        read_tuned_scenarios(("nylon_path",), None)


def test_gains_are_chosen_by_name_or_table():
    assert select_gains(()) == GAIN_NAMES
    assert len(select_gains(("recovery",))) == 4
    assert select_gains(("recovery", CASCADE[0]))[0] == CASCADE[0]
    with pytest.raises(UnknownNameError, match=r"did you mean 'control\.speed_integral'"):
        select_gains(("control.speed_integrals",))


def test_slices_are_laid_through_the_gains_that_go_with_the_cost():
    assert most_important_pairs(np.array([0.1, 0.9, 0.5, 0.7])) == [(1, 3), (2, 0)]
    assert most_important_pairs(np.array([0.1, 0.9, 0.5])) == [(1, 2), (1, 0)]
    assert most_important_pairs(np.array([0.1, 0.9])) == [(1, 0)]
    assert most_important_pairs(np.array([0.3])) == []
    assert importance([], []).shape == (0,)


def test_no_point_of_the_front_is_beaten_and_every_other_is():
    points = np.random.default_rng(3).random((60, 2))
    front = set(front_of(points).tolist())
    for k, (slow, robust) in enumerate(points):
        beaten = np.any(
            (points[:, 0] <= slow)
            & (points[:, 1] >= robust)
            & ((points[:, 0] < slow) | (points[:, 1] > robust))
        )
        assert beaten == (k not in front)


def test_a_draw_on_the_twin_is_driven_like_one_on_the_planar_plant(tmp_path):
    text = scenario_file(tmp_path)
    (scenario,) = read_tuned_scenarios((text,), None).values()
    found = {}
    for plant in ("planar", "twin"):
        draw = draw_trial(text, scenario, 3, 0, plant)
        uses = drive_healthy(draw, {})["uses"]
        assert len(uses) == 4 and all(a <= b for wheel in uses for a, b in wheel)
        found[plant] = read_metrics(drive_trial(draw, {"control.speed_integral": 2.5}, uses))
    assert all(facts.broke is None for facts in found.values())
    assert found["twin"].path == pytest.approx(found["planar"].path, rel=0.3)
    assert found["twin"] != found["planar"]


def test_a_tuning_is_a_table_in_a_notebook_and_in_frames(tuned):
    """Escaped: a scenario's path is the user's text."""
    pyarrow = pytest.importorskip("pyarrow")
    text = tuned._repr_html_()
    for axis, value in zip(tuned.axes, tuned.values, strict=True):
        assert axis.name in text and f"{value:g}" in text
    assert "smallest phase margin" in text and f"{len(tuned.tried)} candidates" in text
    hostile = dataclasses.replace(tuned.config, scenarios=("<b>'&",))
    text = dataclasses.replace(tuned, config=hostile)._repr_html_()
    assert "&lt;b&gt;" in text and "<b>'" not in text
    frame, arrow = tuned.to_pandas(), pyarrow.table(tuned)
    assert list(frame.columns) == arrow.column_names and len(frame) == arrow.num_rows == len(tuned.tried)
    for k, axis in enumerate(tuned.axes):
        assert list(frame[axis.name]) == [one.values[k] for one in tuned.tried]
    assert frame["cost"].tolist() == arrow["cost"].to_pylist() == [one.score.cost for one in tuned.tried]
    assert {"convergence", "pareto"} <= set(tuned.plots) and len(tuned.plot("pareto").children) >= 1
