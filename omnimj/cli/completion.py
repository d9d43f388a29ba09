"""`omnimj completion`: shell scripts that complete commands, options, names and files."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from omnimj.cli.arguments import Command

SHELLS = ("bash", "zsh", "fish")

_TOML = ("model", "floors", "thresholds", "gains", "mapping")  # options whose file is TOML
_SCENARIO, _FILES = "_omnimj_scenario_or_file", "*.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj completion`."""
    own = Path(os.environ.get("SHELL", "")).name
    words = f"{', '.join(SHELLS)} (default: your shell)"
    parser.add_argument(
        "shell",
        metavar="SHELL",
        nargs="?",
        default=own if own in SHELLS else SHELLS[0],
        choices=SHELLS,
        help=words,
    )


def run(arguments: Any) -> int:
    """Print the completion script."""
    from omnimj.cli.main import make_parser

    print(completion_script(make_parser(), arguments.shell))
    return 0


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Make the completion script for a shell; the parser is annotated for it and can no longer parse."""
    import shtab

    for command, action in _actions(parser):
        _complete(command, action)
    return shtab.complete(parser, shell)


def _actions(parser: argparse.ArgumentParser, command: str = "") -> Iterator[tuple[str, argparse.Action]]:
    """Yield every argument that takes a value, with its command, such as `link check`."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, one in action.choices.items():
                yield from _actions(one, f"{command} {name}".strip())
        elif action.nargs != 0:
            yield command, action


def _complete(command: str, action: Any) -> None:
    """Annotate an argument with its completions; one without known values is left as it is."""
    import shtab

    if action.choices is not None:
        return
    words = _words(command, action.dest)
    if words:
        action.choices = words
    elif action.dest == "scenario":
        action.complete = _scenarios()
    elif action.dest in _TOML or (action.metavar == "FILE" and action.dest == "out"):
        action.complete = shtab.glob(_FILES)
    elif action.metavar == "FILE":
        action.complete = shtab.FILE
    elif action.dest in ("dataset", "out"):
        action.complete = shtab.DIRECTORY


def _words(command: str, argument: str) -> tuple[str, ...]:
    """List the names that an argument accepts; empty for an argument that is not a name."""
    from omnimj.parameters import read_floors
    from omnimj.parameters.reading import SOURCES
    from omnimj.recording.importing.mapping import PLANTS
    from omnimj.recording.write_dataset import FORMATS
    from omnimj.simulate.detectors import METHODS
    from omnimj.simulate.plants import PLANT_NAMES
    from omnimj.simulate.suites.catalogue import SUITES as PLANS
    from omnimj.studies.evaluation.cases import SUITES
    from omnimj.studies.random_structure import STRUCTURES
    from omnimj.studies.random_truth import ALL_CLASSES

    known = {
        "plant": (*PLANT_NAMES, *(("both",) if command == "validate" else ())),
        "method": METHODS,
        "floor": tuple(read_floors()),
        "faults": tuple(ALL_CLASSES),
        "source": SOURCES,
        "structure": STRUCTURES,
        "suite": tuple(PLANS if command == "record" else SUITES),
        "table_format": FORMATS,
        "kind": PLANTS,
    }
    return () if command.startswith("link") else tuple(known.get(argument, ()))


def _scenarios() -> dict[str, Any]:
    """Return the completion of a scenario: a shipped name, or any TOML file."""
    from omnimj.simulate.scenario.listing import scenario_names

    names = " ".join(scenario_names())
    bash = f"""
{_SCENARIO}() {{
  compgen -W "{names}" -- "$1"
  compgen -f -X '!{_FILES}' -- "$1"
  compgen -d -- "$1"
}}"""
    zsh = f"""
{_SCENARIO}() {{
  _alternative 'scenarios:scenario:({names})' 'files:file:_files -g "{_FILES}"'
}}"""
    fish = f"""
function {_SCENARIO}
  printf '%s\\n' {names}
  for found in (__fish_complete_path (commandline -ct))
    if string match -q -r '(/|\\.toml)(\\t|$)' -- "$found"
      printf '%s\\n' "$found"
    end
  end
end"""
    return {
        "bash": _SCENARIO,
        "zsh": _SCENARIO,
        "fish": f"({_SCENARIO})",
        "preamble": {"bash": bash, "zsh": zsh, "fish": fish},
    }


COMPLETION = Command(
    "completion",
    "print a script for your shell that completes commands, options, scenarios and files",
    """examples:
  omnimj completion bash > ~/.local/share/bash-completion/completions/omnimj
  omnimj completion zsh > ~/.zfunc/_omnimj
  omnimj completion fish > ~/.config/fish/completions/omnimj.fish

A new shell then completes `omnimj run nyl` to nylon_patch with the tabulator. For bash without the package
bash-completion: `source` the file in ~/.bashrc. For zsh: `fpath+=~/.zfunc` before `compinit` in ~/.zshrc.""",
    add_arguments,
    run,
)
