"""`omnimj gap`: files, tables, exit codes and errors; the search itself is replaced by made-up findings."""

from __future__ import annotations

import json
import sys
import types
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from called_commands import called
from made_findings import FINDINGS, rig_named, rig_unexplained

from omnimj.cli.progress import ProgressBar
from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.gap.files import new_model_files
from omnimj.estimate.gap.find import held_out_conditions
from omnimj.estimate.gap.records import Refitted
from omnimj.parameters import read_floors, read_rig
from omnimj.recording.dataset import Run

SCHEMA = json.loads((Path(__file__).parent.parent / "schema" / "gap.json").read_text(encoding="utf-8"))
WRITTEN = ["before_after.rrd", "gap.json", "model.toml", "report.html"]


@pytest.fixture
def search(monkeypatch):
    """Puts a search with a given finding in the place of the real one; keeps its arguments."""
    calls: list[tuple] = []

    def install(finding) -> list[tuple]:
        def find_gap(*given, **named):
            calls.append((given, named))
            if isinstance(finding, BaseException):
                raise finding
            given[3]("trying rail_viscous", 0.5)
            return finding

        engine = types.ModuleType("omnimj.estimate.gap.find")
        engine.find_gap = find_gap
        monkeypatch.setitem(sys.modules, "omnimj.estimate.gap.find", engine)
        return calls

    return install


@pytest.fixture
def plain_views(monkeypatch):
    """Report and recording are empty: they take seconds, and others test what is in them."""

    def touch(path: Path, *_: object) -> None:
        path.touch()

    monkeypatch.setattr("omnimj.view.report.gap.write_gap_report", touch)
    monkeypatch.setattr("omnimj.view.rerun.before_after.write_before_after", touch)


@pytest.fixture
def few_figures(monkeypatch, undrawn):
    """Figures of one run on the report: they take most of its time, and others test what is in them."""
    monkeypatch.setattr("omnimj.view.report.gap.MOST_FIGURES", 1)


def refused(capsys, *argv: str) -> str:
    code, out, err = called(capsys, *argv)
    assert (code, out, err.count("\n")) == (2, "", 1), (code, out, err)
    return err


def test_a_search_leaves_model_digest_report_and_recording(capsys, tmp_path, search, few_figures):
    calls = search(rig_named())
    argv = ("gap", "data", "--holdout", "i090_m35, slow", "--seed", "5", "--out", str(tmp_path / "out"))
    code, _, err = called(capsys, *argv)
    assert (code, err) == (0, "")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == WRITTEN
    assert all(path.stat().st_size > 500 for path in (tmp_path / "out").iterdir())
    ((given, named),) = calls
    assert (
        given[:3] == (Path("data"), None, ("i090_m35", "slow"))
        and given[4:] == (5, None)
        and named == {"accept": False}
    )
    content = json.loads((tmp_path / "out" / "gap.json").read_text(encoding="utf-8"))
    jsonschema.validate(content, SCHEMA)
    assert content["model"] == "model.toml" and content["command"].startswith("omnimj gap data --holdout")


@pytest.mark.parametrize("name", FINDINGS)
def test_every_verdict_is_printed_with_its_numbers_and_exits_with_0(
    capsys, tmp_path, search, plain_views, name
):
    finding = FINDINGS[name]()
    search(finding)
    code, out, _ = called(capsys, "gap", "data", "--out", str(tmp_path / "out"))
    assert code == (130 if finding.failure else 0)
    assert "\x1b" not in out
    for effect in finding.effects:
        assert effect.effect in out
        for rival in effect.indistinguishable_from:
            assert rival in out
    for channel, gap in finding.heldout.items():
        assert channel in out and f"{gap.before:.3g}" in out
    for place in finding.where:
        assert place.regime in out
    assert "next: " in out and str(tmp_path / "out") in out


def test_json_is_the_content_of_gap_json(capsys, tmp_path, search, plain_views):
    search(rig_named())
    code, out, _ = called(capsys, "gap", "data", "--json", "--out", str(tmp_path / "out"))
    assert code == 0
    assert json.loads(out) == json.loads((tmp_path / "out" / "gap.json").read_text(encoding="utf-8"))


def test_the_new_model_holds_the_effect_and_the_refitted_values(capsys, tmp_path, search, plain_views):
    finding = rig_named()
    search(finding)
    called(capsys, "gap", "data", "--out", str(tmp_path / "out"))
    rig = read_rig(tmp_path / "out" / "model.toml")
    fitted = {name: value.value for name, value in finding.effects[0].parameters.items()}
    assert {name: rig.effects["lateral_coupling"][name] for name in fitted} == pytest.approx(fitted)
    assert rig.rig.rail_friction == pytest.approx(finding.refitted[0].fitted)


def test_floors_that_were_refitted_lie_beside_and_carry_their_new_numbers(
    capsys, tmp_path, search, plain_views
):
    grip = Refitted("pvc.mu_c", "1", 1.0, 0.95, 1.05, 1.04, False)
    search(replace(rig_named(), refitted=(grip,)))
    _, out, _ = called(capsys, "gap", "data", "--out", str(tmp_path / "out"))
    (pvc,) = read_floors(tmp_path / "out" / "floors.toml").values()
    shipped = read_floors()["pvc"]
    assert pvc.numbers["mu_c"] == pytest.approx(1.04 * shipped.numbers["mu_c"], rel=1e-5)
    assert pvc.numbers["sigma_0"] == pytest.approx(shipped.numbers["sigma_0"])
    content = json.loads((tmp_path / "out" / "gap.json").read_text(encoding="utf-8"))
    assert content["floors"] == "floors.toml" and "floors.toml" in out


def test_floors_of_an_earlier_search_do_not_stay_beside_a_new_one(capsys, tmp_path, search, plain_views):
    grip = Refitted("pvc.mu_c", "1", 1.0, 0.95, 1.05, 1.04, False)
    search(replace(rig_named(), refitted=(grip,)))
    called(capsys, "gap", "data", "--out", str(tmp_path / "out"))
    search(rig_unexplained())
    called(capsys, "gap", "data", "--force", "--out", str(tmp_path / "out"))
    assert not (tmp_path / "out" / "floors.toml").exists()
    assert not (tmp_path / "out" / "model.toml").exists()


def test_an_effect_that_the_model_has_already_comes_on_top(tmp_path):
    text = new_model_files(rig_named())["model.toml"]
    (tmp_path / "first.toml").write_text(text, encoding="utf-8")
    again = new_model_files(rig_named(), tmp_path / "first.toml")["model.toml"]
    (tmp_path / "second.toml").write_text(again, encoding="utf-8")
    assert set(read_rig(tmp_path / "second.toml").effects) == {"lateral_coupling", "lateral_coupling_2"}


def test_without_a_name_there_is_no_new_model(capsys, tmp_path, search, plain_views):
    search(rig_unexplained())
    code, _, _ = called(capsys, "gap", "data", "--out", str(tmp_path / "out"))
    content = json.loads((tmp_path / "out" / "gap.json").read_text(encoding="utf-8"))
    assert code == 0 and content["model"] is None and content["effects"] == []
    assert not (tmp_path / "out" / "model.toml").exists()


def test_a_search_that_was_interrupted_keeps_what_it_found(capsys, tmp_path, search, plain_views):
    search(FINDINGS["interrupted"]())
    code, out, _ = called(capsys, "gap", "data", "--out", str(tmp_path / "out"))
    assert code == 130 and "interrupted" in out
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == WRITTEN
    content = json.loads((tmp_path / "out" / "gap.json").read_text(encoding="utf-8"))
    assert content["failure"] == "interrupted"


def test_ctrl_c_before_anything_was_found_leaves_no_folder(capsys, tmp_path, search):
    search(KeyboardInterrupt())
    assert called(capsys, "gap", "data", "--out", str(tmp_path / "out"))[0] == 130
    assert not (tmp_path / "out").exists()


def test_a_search_that_broke_down_is_reported_in_one_line_and_the_rest_is_kept(
    capsys, tmp_path, search, plain_views
):
    search(replace(rig_named(), failure="at 0.3 s: wheel_speed is nan"))
    code, out, err = called(capsys, "gap", "data", "--out", str(tmp_path / "out"))
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "wheel_speed is nan" in err and str(tmp_path / "out") in err
    assert (tmp_path / "out" / "gap.json").exists()


def test_an_error_in_the_data_is_one_line_and_leaves_no_folder(capsys, tmp_path, search):
    search(InputError("data/a.csv: row 7", "found 'x' in wheel_speed", "must be a number"))
    line = refused(capsys, "gap", "data", "--out", str(tmp_path / "out"))
    assert "row 7" in line and not (tmp_path / "out").exists()


def test_a_folder_that_holds_something_is_refused_before_the_search(capsys, tmp_path, search):
    calls = search(rig_named())
    (tmp_path / "mine.txt").write_text("precious")
    assert "is not empty" in refused(capsys, "gap", "data", "--out", str(tmp_path))
    (tmp_path / "gap.json").mkdir()
    assert "has a folder gap.json" in refused(capsys, "gap", "data", "--force", "--out", str(tmp_path))
    assert not calls


def test_force_replaces_an_earlier_search_and_nothing_else(capsys, tmp_path, search, plain_views):
    (tmp_path / "mine.txt").write_text("precious")
    (tmp_path / "model.toml").write_text("of an earlier search")
    search(rig_unexplained())
    assert called(capsys, "gap", "data", "--force", "--out", str(tmp_path))[0] == 0
    assert (tmp_path / "mine.txt").read_text() == "precious"
    assert not (tmp_path / "model.toml").exists()


@pytest.mark.parametrize(
    "argv, words",
    [
        (("gap", "data"), "--out"),
        (("gap", "--out", "x"), "dataset"),
        (("gap", "data", "--holdout", "a,,b", "--out", "x"), "found 'a,,b'"),
        (("gap", "data", "--seed", "-1", "--out", "x"), "whole number"),
        (("gap", "data", "--sede", "1", "--out", "x"), "did you mean '--seed'"),
    ],
)
def test_wrong_arguments_are_named_in_one_line(capsys, monkeypatch, tmp_path, search, argv, words):
    monkeypatch.chdir(tmp_path)
    search(rig_named())
    assert words.lower() in refused(capsys, *argv).lower()


def made_runs() -> list[Run]:
    time = {"time": np.arange(3.0)}
    return [
        Run(name, time, {}, {}, repeat_of)
        for name, repeat_of in (("a_1", "a"), ("a_2", "a"), ("b", None), ("c", None))
    ]


def test_a_repeat_is_held_out_with_its_condition():
    assert held_out_conditions(["a_2"], made_runs()) == ("a",)
    assert held_out_conditions(["c", "a"], made_runs()) == ("a", "c")
    assert held_out_conditions([], made_runs()) == ()


def test_an_unknown_name_lists_the_choices():
    with pytest.raises(UnknownNameError, match=r"unknown run or condition 'd'.*choices: a, a_1, a_2, b, c"):
        held_out_conditions(["d"], made_runs())


def test_something_must_be_left_to_fit_to():
    with pytest.raises(InputError, match="holds out all 4 runs"):
        held_out_conditions(["a", "b", "c"], made_runs())


class Terminal:
    def __init__(self) -> None:
        self.text = ""

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> None:
        self.text += text

    def flush(self) -> None: ...


def test_the_bar_names_the_phase_and_draws_when_it_changes():
    stream = Terminal()
    with ProgressBar(stream) as bar:  # pyright: ignore[reportArgumentType]
        bar.show(1, 2, "refitting")
        bar.show(1, 2, "refitting")
        bar.show(1, 2, "judging")
    assert stream.text.count("50 %  refitting") == 1 and stream.text.count("50 %  judging") == 1
    assert all(len(line) < 110 for line in stream.text.split("\r"))
