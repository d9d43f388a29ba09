"""An evaluation as a whole: what it drives, keeps, counts and refuses."""

from __future__ import annotations

import dataclasses
import html
import json
import re
from functools import partial
from pathlib import Path

import pytest
from inline_executor import InlineExecutor, quiet
from made_methods import DELAY, crying_wolf, perfect

from omnimj.cli.main import main
from omnimj.errors import InputError, UnknownNameError
from omnimj.plant.interface import robot_channels
from omnimj.recording.read_dataset import read_dataset
from omnimj.studies import workers
from omnimj.studies.evaluation import study, trial
from omnimj.studies.evaluation.cases import CasePopulation
from omnimj.studies.evaluation.study import EvaluationConfig, EvaluationResult, run_evaluation
from omnimj.view.plots.evaluation import confusion_picture

SHORT = CasePopulation("manoeuvres", 100)


def substitute_method(patched, make):
    """Puts a made-up method, which knows the case, in the place of every name but `off`."""
    current = []
    drive_case = trial.drive_case

    def drive_noted(case, method, settings, *_):
        current[:] = [case]
        return drive_case(case, method, settings)

    def make_method(name, *_, **__):
        return None if name == "off" else make(current[0])

    patched.setattr(study, "drive_case", drive_noted)
    patched.setattr(study, "require_known_method", lambda name: None)
    patched.setattr(trial, "make_detector", make_method)


def names(executor: InlineExecutor) -> list[str]:
    """Cases that were driven."""
    return [case.name for case, *_ in executor.arguments]


def numbers(folder: Path) -> dict:
    found = json.loads((folder / "evaluation.json").read_text(encoding="utf-8"))
    return {key: value for key, value in found.items() if key != "interrupted"}


def test_recordings_are_a_dataset_of_channels_and_floor_and_nothing_else(tmp_path):
    order = EvaluationConfig(tmp_path / "out", SHORT, trials=2, records=True)
    run_evaluation(order, quiet, InlineExecutor())
    found = read_dataset(tmp_path / "out" / "recordings")
    assert found.plant == "uto_robot" and [run.name for run in found.runs] == ["case_00000", "case_00001"]
    assert all(set(run.conditions) == {"floor"} for run in found.runs)
    own = {"time", *robot_channels(4), *(f"current_target_{i}" for i in range(1, 5))}
    assert all(set(run.columns) == own for run in found.runs)
    again = InlineExecutor()
    (tmp_path / "out" / "recordings" / "case_00001.parquet").unlink()
    run_evaluation(order, quiet, again)
    assert names(again) == ["case_00001"], "what is missing is driven again"


@pytest.mark.slow
def test_a_perfect_method_gets_everything_right(tmp_path, monkeypatch):
    substitute_method(monkeypatch, perfect)
    order = EvaluationConfig(tmp_path / "out", SHORT, "perfect", trials=24)
    outcome = run_evaluation(order, quiet, InlineExecutor())
    summary = outcome.summary
    assert outcome.failed == 0 and summary.cases == 24
    assert summary.alarms.events == summary.alarms_before.events == 0
    assert all(set(row) == {truth} for truth, row in summary.confusion.items())
    for group in summary.classes:
        assert group.isolated.value in (1.0, None) and group.found.value in (1.0, None)
        if group.cases > group.unused:
            assert group.delay.median == pytest.approx(DELAY, abs=2e-3)
            assert group.delay_in_use.p95 is not None and group.delay_in_use.p95 <= DELAY + 2e-3
    assert summary.heading.median == summary.heading.worst == 1.0  # it recovers nothing and harms nothing


@pytest.mark.slow
def test_a_perfect_estimate_has_no_error(tmp_path, monkeypatch):
    substitute_method(monkeypatch, perfect)
    monkeypatch.setattr(trial, "time_after_use", partial(trial.time_after_use, seconds=0.5))
    choice = CasePopulation("missions", 100, faults=("motor",), duration=10.0)
    summary = run_evaluation(
        EvaluationConfig(tmp_path / "out", choice, "perfect", trials=3), quiet, InlineExecutor()
    ).summary
    assert summary.estimate.count > 0
    assert summary.estimate.p95 == pytest.approx(0.0, abs=1e-12)


@pytest.fixture(scope="module")
def wolf(tmp_path_factory) -> EvaluationResult:
    """An evaluation of a method that raises an alarm in every case."""
    choice = dataclasses.replace(SHORT, faults=("none", "slip", "motor"))
    order = EvaluationConfig(tmp_path_factory.mktemp("wolf") / "out", choice, "wolf", trials=12)
    with pytest.MonkeyPatch.context() as patched:
        substitute_method(patched, crying_wolf)
        return run_evaluation(order, quiet, InlineExecutor())


@pytest.mark.slow
def test_false_alarms_of_a_method_are_counted(wolf):
    summary = wolf.summary
    healthy = sum(summary.confusion["none"].values())
    assert summary.confusion["none"] == {"motor 1": healthy}
    assert summary.alarms.events == healthy and summary.cases_with_alarms.value == 1.0
    rate, upper = summary.alarms.per_hour, summary.alarms.upper
    assert rate is not None and upper is not None and upper > rate
    assert rate == pytest.approx(3600.0 / 5.0)
    assert summary.alarms_before.events == 12
    slips = [s for s in wolf.scores if s.fault == "slip"]
    assert slips and not any(s.isolated for s in slips)


@pytest.mark.slow
def test_rows_of_the_confusion_matrix_sum_to_the_cases(wolf):
    rows = wolf.summary.confusion
    assert sum(sum(row.values()) for row in rows.values()) == 12
    for truth, row in rows.items():
        assert sum(row.values()) == sum(score.truth == truth for score in wolf.scores)
    (table,) = (t for t in wolf.tables if t.title.startswith("Truth"))
    assert sum(int(row[-1]) for row in table.rows) == 12
    assert all(sum(int(cell or 0) for cell in row[1:-1]) == int(row[-1]) for row in table.rows)


@pytest.mark.slow
def test_one_that_was_broken_off_goes_on_where_it_stood_and_ends_with_the_same_numbers(tmp_path):
    choice = dataclasses.replace(SHORT, duration=3.0)
    whole = EvaluationConfig(tmp_path / "whole", choice, trials=6)
    assert not run_evaluation(whole, quiet, InlineExecutor()).interrupted

    def stop(phrase: str, share: float) -> None:
        if phrase == "driving: 2 of 6":
            raise KeyboardInterrupt

    order = dataclasses.replace(whole, out=tmp_path / "parts")
    first = run_evaluation(order, stop, InlineExecutor())
    assert first.interrupted and first.summary.cases == 2
    kept = sorted((tmp_path / "parts" / "cases").iterdir())
    kept[0].write_text('{"error": "broke"}', encoding="utf-8")
    again = InlineExecutor()
    assert not run_evaluation(order, quiet, again).interrupted
    assert sorted(names(again)) == [f"case_0000{k}" for k in range(6) if f"case_0000{k}" != kept[1].stem]
    assert numbers(tmp_path / "parts") == numbers(tmp_path / "whole")
    more = InlineExecutor()
    run_evaluation(dataclasses.replace(order, trials=7), quiet, more)
    assert names(more) == ["case_00006"]


def test_a_folder_with_another_evaluation_is_replaced_with_force_only(tmp_path):
    choice = dataclasses.replace(SHORT, duration=2.5)
    run_evaluation(EvaluationConfig(tmp_path, choice, trials=1), quiet, InlineExecutor())
    other = EvaluationConfig(tmp_path, dataclasses.replace(choice, seed=101), trials=1)
    with pytest.raises(InputError, match="other settings"):
        run_evaluation(other, quiet, InlineExecutor())
    forced = InlineExecutor()
    run_evaluation(dataclasses.replace(other, force=True), quiet, forced)
    assert names(forced) == ["case_00000"]
    file = tmp_path / "cases" / "case_00000.json"
    file.write_text(file.read_text().replace('"payload": ', '"payload": 1'))
    with pytest.raises(InputError, match="another case than this seed draws"):
        run_evaluation(other, quiet, InlineExecutor())


def test_the_structure_is_stated_everywhere_and_a_folder_holds_one(tmp_path):
    choice = dataclasses.replace(SHORT, duration=2.5, faults=("none",))
    for structure, words in (("nominal", "physics of the controller's model"), ("drawn", "gear efficiency")):
        out = tmp_path / structure
        order = EvaluationConfig(out, dataclasses.replace(choice, structure=structure), trials=1)
        outcome = run_evaluation(order, quiet, InlineExecutor())
        text = (out / "evaluation.md").read_text(encoding="utf-8")
        assert outcome.heading.endswith(f"structure {structure}")
        assert outcome.heading in text and words in text
        for name in ("evaluation.json", "evaluation_plan.json"):
            found = json.loads((out / name).read_text(encoding="utf-8"))
            assert found.get("plan", found)["structure"] == structure
        case = json.loads((out / "cases" / "case_00000.json").read_text(encoding="utf-8"))["case"]
        assert (case["structure"] is None) == (structure == "nominal")
        other = "drawn" if structure == "nominal" else "nominal"
        with pytest.raises(InputError, match="holds an evaluation with other settings"):
            again = dataclasses.replace(order, population=dataclasses.replace(choice, structure=other))
            run_evaluation(again, quiet, InlineExecutor())


@pytest.mark.slow
def test_a_case_that_breaks_is_counted_and_takes_no_other_with_it(tmp_path, monkeypatch):
    whole = trial.excursions

    def broken(trace, onset):
        raise ZeroDivisionError("once")

    monkeypatch.setattr(trial, "excursions", broken)
    choice = dataclasses.replace(SHORT, duration=2.5, faults=("none", "slip"))
    order = EvaluationConfig(tmp_path, choice, trials=8)
    outcome = run_evaluation(order, quiet, InlineExecutor())
    assert 0 < outcome.failed < 8 and outcome.failed + outcome.summary.cases == 8
    assert "failed" in outcome.lines[-1]
    monkeypatch.setattr(trial, "excursions", whole)
    assert run_evaluation(order, quiet, InlineExecutor()).failed == 0


def test_a_training_seed_is_reported_as_unfit_for_judging(tmp_path):
    choice = dataclasses.replace(SHORT, seed=99, duration=2.5, faults=("none",))
    outcome = run_evaluation(EvaluationConfig(tmp_path, choice, trials=1), quiet, InlineExecutor())
    assert "do not judge" in outcome.lines[0]
    assert json.loads((tmp_path / "evaluation.json").read_text())["judged"] is False
    assert "**these numbers do not judge it**" in (tmp_path / "evaluation.md").read_text()


def test_names_that_do_not_exist_are_refused_with_the_choices(tmp_path):
    for choice, expected in (
        (CasePopulation("mission"), "did you mean 'missions'"),
        (CasePopulation(plants=("real",)), "planar, twin"),
        (CasePopulation(floors=("lava",)), "natural_stone_capped"),
        (CasePopulation(faults=("gremlins",)), "all_wheel_slip"),
        (CasePopulation(structure="random"), "drawn, nominal"),
    ):
        with pytest.raises(UnknownNameError, match=expected):
            run_evaluation(EvaluationConfig(tmp_path / "out", choice), quiet, InlineExecutor())
    assert not (tmp_path / "out").exists()


def test_the_command_prints_tables_or_json_and_writes_a_page(tmp_path, monkeypatch, capsys, undrawn):
    monkeypatch.setattr(workers, "ProcessPoolExecutor", lambda *given, **named: InlineExecutor())
    substitute_method(monkeypatch, perfect)
    argv = ["evaluate", "--suite", "manoeuvres", "--method", "perfect", "--trials", "4", "--faults"]
    argv += ["none,motor,slip", "--out", str(tmp_path)]
    assert main(argv) == 0
    printed = capsys.readouterr().out
    assert "Groups with a goal" in printed and "written to" in printed
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("class='plot'") == 5 + 4 and "http" not in page.replace("http-equiv", "")
    assert main([*argv, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["plan"]["trials"] == 4
    measures = [one["measure"] for one in found["goals"] if one["goal"] and one["count"]]
    idle = [one["measure"] for one in found["goals"] if not one["count"]]
    assert idle and not any(measure in text for measure in idle for text in (printed, html.unescape(page)))
    assert measures and all(
        measure in text for measure in measures for text in (printed, html.unescape(page))
    )


def test_the_confusion_matrix_tells_the_cases_of_each_cell_and_marks_the_correct_ones():
    confusion = {"none": {"none": 3}, "motor 1": {"several": 1, "motor 1": 2, "none": 1}}
    (panel,) = confusion_picture(confusion).panels
    cells, correct = (renderer.data_source.data for renderer in panel.plot.renderers)
    corners = dict(zip(cells["name"], zip(cells["left"], cells["bottom"], strict=True), strict=True))
    assert len(corners) == 6
    assert corners["truth none, diagnosed none: 3 of 3 cases"] == (-0.5, -0.5)
    place = corners["truth motor 1, diagnosed motor 1: 2 of 4 cases"]
    assert list(zip(correct["left"], correct["bottom"], strict=True)) == [(-0.5, -0.5), place]
    assert "truth none, diagnosed several: 0 of 3 cases" in corners
    words = {(mark.x, mark.y): mark.text for mark in panel.plot.center if mark.kind == "Label"}
    assert words == {(0, 0): "3", (0, 1): "1", (1, 1): "2", (2, 1): "1"}


@pytest.mark.slow
def test_an_evaluation_is_a_table_in_a_notebook_and_in_frames(wolf):
    pyarrow = pytest.importorskip("pyarrow")
    text = wolf._repr_html_()
    assert f"{len(wolf.scores)} cases" in text and "**" not in text
    cells = {html.unescape(cell) for cell in re.findall(r"<td[^>]*>([^<]*)</td>", text)}
    rows = [row for one in wolf.tables for row in one.rows]
    assert rows and all(row[-1] in cells or not row[-1] for row in rows)
    hostile = dataclasses.replace(wolf, heading="<b>'&", lines=("<i>",))._repr_html_()
    assert "&lt;b&gt;" in hostile and "&lt;i&gt;" in hostile and "<b>'" not in hostile
    frame, arrow = wolf.to_pandas(), pyarrow.table(wolf)
    assert list(frame.columns) == arrow.column_names and len(frame) == arrow.num_rows == len(wolf.scores)
    assert frame["name"].tolist() == arrow["name"].to_pylist() == [score.name for score in wolf.scores]
    assert "confusion" in wolf.plots and len(wolf.plot("confusion").children) >= 1
