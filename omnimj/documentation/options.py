"""How-to pages of the commands: which page belongs to which command, and the tables of their options."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator

from omnimj.documentation.reference import table
from omnimj.resources import models_folder

HOWTO = "howto/"
"""Folder of the how-to pages, one for each command."""
_MARK = re.compile(r"^All options: `(omnimj [a-z -]+) --help`\.$", re.MULTILINE)
"""The line of a page in whose place the site has the table of options."""
_LISTED_ELSEWHERE = ("messages",)
"""Groups of options that every command has; `commands.md` explains them."""
_MESSAGES = "[`-q`, `-v` and `--log FILE`](../commands.md#what-a-command-says-while-it-works) as everywhere."


def commands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """All commands that have no sub-commands, as they are typed: `omnimj link check` → its parser."""
    return dict(_leaves(parser))


def page_of(command: str) -> str:
    """The how-to page of a command: `omnimj link check` → `howto/link_check.md`."""
    return f"{HOWTO}{'_'.join(command.replace('-', '_').split()[1:])}.md"


def with_options(page: str, commands: dict[str, argparse.ArgumentParser]) -> str:
    """The page with a table of options in place of the line that names `--help`.

    Raises:
      KeyError: The line names an unknown command.
    """
    return _MARK.sub(lambda match: f"## Options\n\n{options_text(commands[match[1]])}", page)


def options_text(parser: argparse.ArgumentParser) -> str:
    """Arguments and options of a command as Markdown, a table for each group of them."""
    parts = []
    for group in parser._action_groups:
        rows = [
            (_name(action), _meaning(parser, action))
            for action in group._group_actions
            if action.help is not argparse.SUPPRESS and not isinstance(action, argparse._HelpAction)
        ]
        if not rows or group.title in _LISTED_ELSEWHERE:
            continue
        kind = "argument" if group.title == "positional arguments" else "option"
        if kind == "option" and group.title != "options":
            words = str(group.title)
            parts.append(f"{words[0].upper()}{words[1:]}{_described(group.description)}:")
        parts.append(table((kind, "meaning"), rows))
    return "\n\n".join((*parts, _MESSAGES))


def _leaves(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    below = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not below:
        yield parser.prog, parser
    for action in below:
        for one in action.choices.values():
            yield from _leaves(one)


def _described(text: str | None) -> str:
    return f" ({text})" if text else ""


def _name(action: argparse.Action) -> str:
    """An option as it is typed, with its value: `-q`, `--quiet`; a needed one is marked."""
    if not action.option_strings:
        return f"`{str(action.metavar or action.dest).upper()}{'…' if action.nargs in ('+', '*') else ''}`"
    value = "" if action.nargs == 0 else f" {action.metavar or action.dest.upper()}".replace("|", " or ")
    many = "…" if action.nargs in ("+", "*") else ""
    name = ", ".join(f"`{option}{value}{many}`" for option in action.option_strings)
    return f"{name}, needed" if action.required else name


def _meaning(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    """The help of an option, without the path of this installation."""
    words = parser._get_formatter()._expand_help(action) if action.help else ""
    return words.replace(str(models_folder()), "the folder `models` of the package")
