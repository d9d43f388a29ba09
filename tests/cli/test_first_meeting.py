"""`omnimj` alone, and its help: what a newcomer meets, at once."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys

import pytest

from omnimj.cli.main import GROUPS, main, make_parser

HEAVY = "{'mujoco', 'numba', 'rerun', 'bokeh', 'pyarrow', 'scipy', 'numpy', 'shtab'}"


def commands() -> list[str]:
    return list(next(action.choices for action in make_parser()._actions if action.dest == "command") or ())


def test_the_command_alone_prints_its_purpose_and_where_to_begin(capsys):
    assert main([]) == 0
    out, err = capsys.readouterr()
    assert err == "" and out.startswith("omnimj ") and "twin" in out.splitlines()[0]
    assert all(len(line) <= 80 for line in out.splitlines())
    shown = re.findall(r"^  (omnimj .+)$", out, flags=re.MULTILINE)
    assert [shlex.split(line)[1] for line in shown] == ["run", "scenarios", "gap"]
    for line in (*shown, *re.findall(r"`(omnimj [^`]+)`", out)):
        make_parser().parse_args(shlex.split(line)[1:])
    assert "omnimj --help" in out


def test_the_help_lists_every_command_once_under_what_it_is_for(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    out = capsys.readouterr().out
    assert ended.value.code == 0
    for name in commands():
        assert len(re.findall(rf"^    {name}\b", out, flags=re.MULTILINE)) == 1, name
    headings = [line.strip() for line in out.splitlines() if re.fullmatch(r"  \S[^-]*", line)]
    assert [heading for heading in headings if heading in GROUPS] == list(GROUPS)


def test_every_command_is_in_one_group():
    grouped = [command.name for group in GROUPS.values() for command in group]
    assert len(grouped) == len(set(grouped)) and set(commands()) == set(grouped)


@pytest.mark.parametrize("command", [command for group in GROUPS.values() for command in group])
def test_every_example_of_a_command_is_one_of_its_own_and_parses(command):
    examples = [line for line in command.epilog.splitlines() if line.startswith("  omnimj ")]
    assert any(shlex.split(line)[1] == command.name for line in examples)
    for line in examples:
        make_parser().parse_args(shlex.split(line.partition(" > ")[0])[1:])


@pytest.mark.parametrize("argv", ["[]", "['--help']"])
def test_neither_loads_what_takes_time(argv):
    script = f"import sys; from omnimj.cli.main import main\ntry: main({argv})\nexcept SystemExit: pass\n"
    script += f"print({HEAVY} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"


def test_an_option_without_a_command_is_still_one_line(refused):
    assert "the following arguments are required: COMMAND" in refused("--")
