"""Completion in shells: the scripts are the shells' own, and complete what there is."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from omnimj.cli.completion import SHELLS, completion_script
from omnimj.cli.main import main, make_parser
from omnimj.resources import models_folder
from omnimj.simulate.scenario.listing import scenario_names

BASH = completion_script(make_parser(), "bash")
needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")


@pytest.mark.parametrize("shell", SHELLS)
def test_the_shell_takes_its_script(shell, tmp_path):
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    script = tmp_path / f"omnimj.{shell}"
    script.write_text(completion_script(make_parser(), shell), encoding="utf-8")
    done = subprocess.run([shell, "-n", str(script)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_s_script_has_every_command_and_every_scenario(shell):
    script = completion_script(make_parser(), shell)
    commands = next(action.choices for action in make_parser()._actions if action.dest == "command")
    for name in (*(commands or ()), *scenario_names()):
        assert name in script, name


def completed(words: str, folder: Path) -> set[str]:
    """What a real bash offers for a line whose last word is being typed."""
    line = words.split(" ")
    quoted = " ".join(f"'{word}'" for word in line)
    ask = f"COMP_WORDS=({quoted}); COMP_CWORD={len(line) - 1}; _shtab_omnimj\n"
    ask += "printf '%s\\n' \"${COMPREPLY[@]}\""
    done = subprocess.run(
        ["bash", "--norc", "-c", f"{BASH}\n{ask}"], cwd=folder, capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


@needs_bash
@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("omnimj sc", {"scenarios"}),
        ("omnimj link ", {"check", "fuzz"}),
        ("omnimj run nyl", {"nylon_patch"}),
        ("omnimj sensitivity nyl", {"nylon_patch"}),
        ("omnimj device --scenario nyl", {"nylon_patch"}),
        ("omnimj run uto_robot/", {"uto_robot/robot.toml", "uto_robot/chosen_gains.toml"}),
        ("omnimj run nylon_patch --plan", {"--plant"}),
        ("omnimj run nylon_patch --plant ", {"twin", "planar"}),
        ("omnimj validate data --plant ", {"twin", "planar", "both"}),
        ("omnimj run nylon_patch --method ", {"robust", "published", "off"}),
        ("omnimj run nylon_patch --set floor=pvc --seed 3 --vi", {"--view"}),
        ("omnimj run nylon_patch --floors fl", {"floors.toml"}),
        ("omnimj run nylon_patch --out quar", {"quarter_rig"}),
        ("omnimj gap quar", {"quarter_rig"}),
        ("omnimj record robot", {"robot_missions"}),
        ("omnimj evaluate --suite ", {"missions", "manoeuvres"}),
        ("omnimj completion ", set(SHELLS)),
    ],
)
def test_bash_completes(words, offered):
    assert completed(words, models_folder()) == offered


@needs_bash
def test_bash_offers_all_scenarios_and_no_file_that_is_none(tmp_path):
    (tmp_path / "mine.toml").touch()
    (tmp_path / "notes.txt").touch()
    assert completed("omnimj run ", tmp_path) == {*scenario_names(), "mine.toml"}


@pytest.mark.skipif(shutil.which("fish") is None, reason="no fish here")
@pytest.mark.parametrize(("words", "offered"), [("run nyl", "nylon_patch"), ("run x --method rob", "robust")])
def test_fish_completes(words, offered, tmp_path):
    (tmp_path / "omnimj.fish").write_text(completion_script(make_parser(), "fish"), encoding="utf-8")
    ask = f"source omnimj.fish; complete -C 'omnimj {words}'"
    done = subprocess.run(["fish", "-N", "-c", ask], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert [line.split("\t")[0] for line in done.stdout.splitlines()] == [offered]


def test_what_has_a_script_is_printed_and_what_has_none_is_refused(capsys, refused):
    assert main(["completion", "bash"]) == 0
    assert capsys.readouterr().out == BASH + "\n"
    assert "unknown shell 'tcl'; choices: bash, fish, zsh" in refused("completion", "tcl")
