"""`omnimj report-bug`: what a report needs, and nothing that is private."""

from __future__ import annotations

import json

import mujoco
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnimj
from omnimj.cli import main as command
from omnimj.cli.main import main
from omnimj.cli.report_bug import without_private_data


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("OMNIMJ_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def reported(capsys):
    capsys.readouterr()
    assert main(["report-bug", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_report_names_versions_machine_and_the_last_command(capsys):
    assert main(["scenarios"]) == 0
    found = reported(capsys)
    assert found["omnimj"] == omnimj.__version__ and found["libraries"]["mujoco"] == mujoco.__version__
    assert found["last command"] == {"command": "omnimj scenarios", "code": 0, "error": ""}
    assert found == reported(capsys), "a report does not become the last command"
    assert main(["report-bug"]) == 0
    text = capsys.readouterr().out
    assert "omnimj scenarios" in text and "exit code 0" in text and mujoco.__version__ in text


def test_an_error_is_reported_with_its_line_but_without_folders(capsys, tmp_path):
    secret = tmp_path / "alice" / "robot.toml"
    assert main(["run", "nylon_patch", "--model", str(secret)]) == 2
    found = reported(capsys)["last command"]
    assert found["command"] == "omnimj run nylon_patch --model robot.toml" and found["code"] == 2
    assert found["error"].startswith("omnimj: ") and "robot.toml" in found["error"]
    assert "alice" not in json.dumps(found) and str(tmp_path) not in json.dumps(found)


def test_a_fault_of_the_program_is_reported_with_its_kind(capsys, monkeypatch):
    def broken(given):
        raise ZeroDivisionError("in /home/alice/omnimj/thing.py")

    monkeypatch.setattr(command, "_run", broken)
    with pytest.raises(ZeroDivisionError):
        main(["scenarios"])
    assert "omnimj report-bug" in capsys.readouterr().err
    monkeypatch.undo()


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        ("run a --plant udp:robot.alice.example:9750", "run a --plant udp:HOST:9750"),
        ("run a --plant udp:[fe80::1]:9750", "run a --plant udp:HOST:9750"),
        ("tune a --executor dask:tcp://10.0.0.7:8786", "tune a --executor dask:tcp://HOST:8786"),
        ("run a --key-file ~/keys/mine", "run a --key-file FILE"),
        ("run a --plant serial:/dev/ttyACM0?baud=9600", "run a --plant serial:/dev/ttyACM0?baud=9600"),
        ("gap /home/alice/data --out=/srv/bob/out", "gap data --out=out"),
        ("gap data/alice/x --out ../bob/out", "gap x --out out"),
        (r"gap C:\Users\alice\data", "gap data"),
        ("run a --set floor=pvc --seed 3", "run a --set floor=pvc --seed 3"),
    ],
)
def test_folders_hosts_and_keys_are_left_out(words, shown):
    assert without_private_data(words.split()) == shown


@given(st.lists(st.sampled_from(["home", "alice", "..", "data-1", "ü", "x.y"]), min_size=2, max_size=6))
def test_of_a_path_only_its_last_name_is_shown(parts):
    assert without_private_data(["/" + "/".join(parts)]) == parts[-1]


@pytest.mark.parametrize("content", ["", "[1]", '{"command": 1}', "[" * 50_000, "x" * 200_000])
def test_a_damaged_note_of_the_last_command_is_as_none(capsys, own_cache, content):
    own_cache.mkdir()
    (own_cache / "last_command.json").write_text(content)
    assert reported(capsys)["last command"] is None


def test_where_nothing_can_be_written_commands_work_as_ever(capsys, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("OMNIMJ_CACHE", str(tmp_path / "file"))
    assert main(["scenarios"]) == 0
    assert reported(capsys)["last command"] is None
    assert [one.name for one in tmp_path.iterdir()] == ["file"]
