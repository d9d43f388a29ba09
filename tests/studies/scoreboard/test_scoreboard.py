"""The scoreboard of real sets: what it finds in folders, what its table holds, and what it keeps."""

from __future__ import annotations

import json
import shutil
import tarfile
from dataclasses import replace

import pytest
from inline_executor import InlineExecutor, quiet
from made_findings import rig_named, rig_unexplained
from servo_logs import SERVO, write_servo_logs

from omnimj.cli.main import main
from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.gap.sentences import effect_label
from omnimj.resources import models_folder
from omnimj.studies import workers
from omnimj.studies.scoreboard.sets import find_sets, known_sets
from omnimj.studies.scoreboard.study import ScoreboardConfig, run_scoreboard

NAMED = replace(rig_named(), heldout_total=(8.0, 2.0), seconds=90.0)
"""Finding of a search that found an effect."""
EFFECT = effect_label(NAMED.effects[0])
PARAMETER = next(iter(NAMED.effects[0].parameters))


def named(one, dataset, folder, seed, accept):
    """Search that names an effect."""
    return NAMED


def nothing(one, dataset, folder, seed, accept):
    """Search that names nothing."""
    return replace(rig_unexplained(), heldout_total=(3.0, None))


def broken(one, dataset, folder, seed, accept):
    """Search of data that are refused."""
    raise InputError(dataset, "has no runs")


def must_not_run(one, dataset, folder, seed, accept):
    """Search that a finished set needs no more."""
    raise AssertionError(one.name)


@pytest.fixture
def sets(tmp_path):
    """Two datasets, one of which states what is expected."""
    for name in ("one", "two"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "dataset.toml").write_text('plant = "quarter_rig"\n')
    expected = f'source = "planted"\n[expected."{EFFECT}"]\n{PARAMETER} = 0.5\n[expected.grade]\n'
    (tmp_path / "one" / "expected.toml").write_text(expected)
    return tmp_path / "one", tmp_path / "two"


def scored(out, search, paths, report=quiet, **more):
    return run_scoreboard(ScoreboardConfig(out, search, (), paths, **more), report, InlineExecutor())


def test_a_row_holds_named_and_expected_effects_and_the_held_out_mismatch(tmp_path, sets):
    outcome = scored(tmp_path / "out", named, sets)
    first, second = outcome.tables[0].rows
    assert first[0] == "one" and first[1].startswith(EFFECT)
    assert first[2:] == (f"{EFFECT}, grade", "1 of 2", "8", "2", "75 %", "1.5")
    assert second[2:4] == ("–", "–")
    (value,) = outcome.tables[1].rows
    assert value[:3] == ("one", EFFECT, PARAMETER) and value[5:] == ("0.5", "planted")
    written = json.loads((tmp_path / "out" / "scoreboard.json").read_text())
    assert [one["shrink"] for one in written["sets"]] == [0.75, 0.75]
    assert f"| one | {EFFECT}" in (tmp_path / "out" / "scoreboard.md").read_text()


def test_a_rival_that_the_data_do_not_exclude_counts_as_found_and_a_refused_name_does_not(tmp_path, sets):
    one = replace(NAMED.effects[0], effect="viscous", selectors={}, indistinguishable_from=("grade",))

    def rivals(*_):
        return replace(NAMED, effects=(one,))

    outcome = scored(tmp_path / "a", rivals, sets[:1])
    assert outcome.rows[0].found == ("grade",) and outcome.tables[0].rows[0][3] == "1 of 2, 1 as rival"
    outcome = scored(tmp_path / "b", nothing, sets[:1])
    assert outcome.rows[0].found == () and outcome.tables[0].rows[0][1] == "unexplained"
    assert outcome.tables[0].rows[0][4:7] == ("3", "–", "–")


def test_finished_sets_are_kept_after_ctrl_c_and_only_the_others_are_searched(tmp_path, sets):
    def stop(phrase, share):
        if phrase == "searching: 1 of 2":
            raise KeyboardInterrupt

    first = scored(tmp_path / "out", named, sets, stop)
    assert first.interrupted and [row[1] for row in first.tables[0].rows].count("not searched yet") == 1
    again = scored(tmp_path / "out", nothing, sets)
    assert {row.named for row in again.rows} == {(EFFECT,), ()}
    assert scored(tmp_path / "out", must_not_run, sets).lines == (
        "2 of 2 sets that are there were searched; 0 known ones are not there.",
    )
    with pytest.raises(InputError, match="other settings"):
        scored(tmp_path / "out", named, sets, seed=4)


def test_a_set_whose_files_changed_is_searched_again_and_one_may_be_added(tmp_path, sets):
    scored(tmp_path / "out", named, sets[:1])
    (sets[0] / "expected.toml").write_text("")  # no part of the data
    assert scored(tmp_path / "out", must_not_run, sets[:1]).rows[0].found == ()
    (sets[0] / "run.csv").write_text("time\n")
    assert [row.named for row in scored(tmp_path / "out", nothing, sets).rows] == [(), ()]


def test_a_set_that_is_refused_costs_no_other_and_is_tried_again(tmp_path, sets):
    def one_broken(one, *rest):
        return (broken if one.name == "one" else named)(one, *rest)

    outcome = scored(tmp_path / "out", one_broken, sets)
    assert outcome.failed == 1 and "has no runs" in outcome.tables[0].rows[0][1]
    assert outcome.rows[1].named == (EFFECT,)
    assert scored(tmp_path / "out", named, sets).failed == 0


def test_known_sets_are_found_in_a_folder_an_archive_and_a_path_and_missing_ones_are_named(tmp_path):
    known = known_sets()
    logs = tmp_path / "data" / "robotino" / "gray"
    logs.mkdir(parents=True)
    (logs / "exp00.csv").write_text("t\n")
    raw = tmp_path / "bam" / "xl330" / "raw"
    raw.mkdir(parents=True)
    (raw / "a.json").write_text("{}")
    with tarfile.open(tmp_path / "data" / "xl330.tar.xz", "w:xz") as archive:
        archive.add(raw.parent, "xl330")
    found, missing = find_sets((), tmp_path / "data", tmp_path / "unpacked", known)
    assert [one.name for one in found] == ["robotino_gray", "xl330"]
    assert found[1].logs == (tmp_path / "unpacked" / "xl330" / "raw" / "a.json",)
    assert [one.name for one in missing] == ["robotino_table", "robotino_green"]
    assert all(one.get.startswith("github.com/") for one in missing)
    for path in (raw.parent, raw):
        (given,), _ = find_sets((path,), None, tmp_path, known)
        assert given.name == "xl330" and len(given.logs) == 1
    both, _ = find_sets((raw,), tmp_path / "data", tmp_path / "unpacked", known)
    assert [one.name for one in both] == ["xl330", "robotino_gray"]


def test_every_known_set_has_its_mapping_and_model():
    for one in known_sets():
        files = (one.found.mapping, one.found.model, one.found.floors)
        assert all(file is None or file.is_file() for file in files), one.found.name
        assert not one.found.expected or one.found.source


def test_the_folder_of_a_machine_is_its_model_with_datasets_or_with_logs_and_a_mapping(tmp_path):
    folder = tmp_path / "crane"
    shutil.copytree(models_folder() / "servo_arm", folder)
    with pytest.raises(InputError, match="has a mapping and no logs"):
        find_sets((folder,), None, tmp_path, ())
    (folder / "logs").mkdir()
    (folder / "logs" / "a.json").write_text("{}")
    (one,), _ = find_sets((folder,), None, tmp_path, ())
    assert (one.name, one.model, [file.name for file in one.logs]) == (
        "crane",
        folder / SERVO.name,
        ["a.json"],
    )
    for name in ("slow", "fast"):
        write_servo_logs(folder / name, runs=1)
    found, _ = find_sets((folder,), None, tmp_path, ())
    assert [one.name for one in found] == ["crane_fast", "crane_slow"] and found[0].mapping is None


def test_paths_without_a_set_and_wrong_expectations_are_refused_in_one_line(tmp_path, sets, capsys):
    assert main(["gap", "--scoreboard", str(tmp_path / "nowhere"), "--out", str(tmp_path / "out")]) == 2
    assert "no such folder" in capsys.readouterr().err and not (tmp_path / "out").exists()
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"holds no set.*xl330"):
        find_sets((tmp_path / "empty",), None, tmp_path, known_sets())
    with pytest.raises(InputError, match="given twice"):
        find_sets((sets[0], sets[0]), None, tmp_path, ())
    for text, error in (
        ("[expected.grade]\n", InputError),
        ('sauce = "x"\n', UnknownNameError),
        ('source = "x"\n[expected.grade]\nslope = "steep"\n', InputError),
        ("expected = 3\n", InputError),
    ):
        (sets[0] / "expected.toml").write_text(text)
        with pytest.raises(error, match="expected"):
            find_sets(sets, None, tmp_path, ())
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "xl330.tar.xz").write_bytes(b"no archive")
    with pytest.raises(InputError, match="cannot be unpacked"):
        find_sets((), tmp_path / "data", tmp_path / "unpacked", known_sets())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--model", "a.toml"), "each set has its own"),
        (("--data", "nowhere"), "no such folder"),
        (("--benchmark",), "makes its own data"),
    ],
)
def test_options_that_do_not_belong_to_the_scoreboard_are_refused(tmp_path, capsys, options, words):
    assert main(["gap", "--scoreboard", *options, "--out", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err


def test_the_command_writes_its_page_also_when_no_set_is_missing(tmp_path, sets, monkeypatch, capsys):
    monkeypatch.setattr("omnimj.cli.scoreboard.search_and_write", named)
    monkeypatch.setattr("omnimj.studies.scoreboard.sets.known_sets", lambda: ())
    monkeypatch.setattr(workers, "ProcessPoolExecutor", lambda *given, **named: InlineExecutor())
    folder = tmp_path / "out"
    assert main(["gap", "--scoreboard", *map(str, sets), "--out", str(folder)]) == 0
    assert EFFECT in capsys.readouterr().out and EFFECT in (folder / "report.html").read_text(
        encoding="utf-8"
    )
    files = {"report.html", "results", "scoreboard.json", "scoreboard.md", "scoreboard_plan.json", "sets"}
    assert {file.name for file in folder.iterdir()} == files


def test_without_data_the_table_says_where_the_known_sets_are(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["gap", "--scoreboard"]) == 0
    shown = capsys.readouterr().out
    assert shown.count("not there") == 9 and "github.com/Rhoban/bam" in shown and "written to" not in shown
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_an_effect_that_was_planted_is_found_in_a_machines_folder(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(workers, "ProcessPoolExecutor", lambda *given, **named: InlineExecutor())
    folder, out = tmp_path / "servo", tmp_path / "out"
    folder.mkdir()
    for suffix in (".xml", ".toml"):
        shutil.copy(SERVO.with_suffix(suffix), folder)
    write_servo_logs(folder / "loaded", load_share=0.12)
    expected = 'source = "planted"\n[expected."load_friction (shaft)"]\nshare = 0.12\n'
    (folder / "expected.toml").write_text(expected)
    assert main(["gap", "--scoreboard", str(folder), "--out", str(out), "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["sets"]
    assert row["found"] == ["load_friction (shaft)"] and row["effects"][0]["label"] == row["found"][0]
    share = row["effects"][0]["parameters"]["share"]
    assert share["low"] < 0.12 < share["high"]
    assert row["after"] < 1.5 < row["before"] and row["shrink"] == pytest.approx(
        1 - row["after"] / row["before"]
    )
    assert {"gap.json", "model.xml", "report.html"} <= {
        file.name for file in (out / "sets" / "servo").iterdir()
    }
    assert "Published values" in (out / "report.html").read_text(encoding="utf-8")
