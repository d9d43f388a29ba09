"""Every command has a how-to page of the same form, and the site lists its options from the parser."""

from __future__ import annotations

import re
import shlex

import pytest

from omnimj.cli.main import GROUPS, make_parser
from omnimj.documentation.navigation import pages
from omnimj.documentation.options import HOWTO, commands_of, options_text, page_of, with_options
from omnimj.documentation.site import SiteBuild
from omnimj.documentation.staging import DOCS
from omnimj.resources import models_folder

COMMANDS = commands_of(make_parser())


def text(command: str) -> str:
    return (DOCS / page_of(command)).read_text(encoding="utf-8")


def shell_lines(page: str) -> list[str]:
    blocks = re.findall(r"^```sh\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE)
    return [line.removesuffix("&").strip() for block in blocks for line in block.splitlines()]


def test_every_command_of_the_help_has_a_page_and_every_page_a_command():
    assert {page_of(command) for command in COMMANDS} == {
        f"{HOWTO}{page.name}" for page in (DOCS / HOWTO).glob("*.md")
    }
    assert {command.name for group in GROUPS.values() for command in group} == {
        command.split()[1] for command in COMMANDS
    }


def test_every_page_is_placed_by_job_in_the_navigation():
    assert {page_of(command) for command in COMMANDS} <= set(pages())


@pytest.mark.parametrize("command", COMMANDS)
def test_a_page_has_a_job_as_its_title_a_line_on_the_command_and_its_options(command):
    page = text(command)
    title, _, first, *_ = page.splitlines()
    assert re.fullmatch(r"# [A-Z][\w ,'-]+", title) and "omnimj " not in title
    assert first.startswith(f"`{command}")
    assert page.endswith(f"\nAll options: `{command} --help`.\n")
    assert "exit code" in page or "ends with 0" in page
    assert "## See also" in page


@pytest.mark.parametrize("command", sorted(COMMANDS.keys() - {"omnimj completion"}))
def test_a_page_shows_the_command_as_it_is_typed_and_all_its_lines_are_commands(command):
    lines = shell_lines(text(command))
    assert any(f"{line} ".startswith(f"{command} ") for line in lines)
    for line in lines:
        if line.startswith("omnimj "):
            make_parser().parse_args(shlex.split(line)[1:])


@pytest.mark.parametrize("command", COMMANDS)
def test_options_on_a_page_are_those_of_a_command_that_it_names_or_links(command):
    page = text(command)
    linked = {f"{HOWTO}{name}" for name in re.findall(r"\]\((\w+\.md)\)", page)}
    named = {one for one in COMMANDS if re.search(rf"{one}[ `]", page) or page_of(one) in linked}
    known = {option for one in named for action in COMMANDS[one]._actions for option in action.option_strings}
    spoken = {
        option
        for code in re.findall(r"`([^`\n]+)`", page)
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", code)
        if not code.startswith(("python ", "openssl ", "pip "))
    }
    assert spoken - known == set()


@pytest.mark.parametrize("command", COMMANDS)
def test_the_table_of_options_has_each_option_once_with_the_words_of_the_help(command):
    table = options_text(COMMANDS[command])
    shown = re.sub(r"\s+", " ", COMMANDS[command].format_help())
    for action in COMMANDS[command]._actions:
        for option in set(action.option_strings) - {
            "-h",
            "--help",
            "-q",
            "--quiet",
            "-v",
            "--verbose",
            "--log",
        }:
            assert len(re.findall(rf"^\|.*`{option}[ `].*\|.*\|$", table, flags=re.MULTILINE)) == 1, option
            (meaning,) = re.findall(
                rf"^\|(?:[^|\\]|\\.)*`{option}[ `](?:[^|\\]|\\.)*\| (.*) \|$", table, flags=re.MULTILINE
            )
            start = meaning.replace("\\|", "|").split(" the folder `models`")[0][:40]
            assert re.sub(r"\s+", "", start) in re.sub(r"\s+", "", shown), option
    assert str(models_folder()) not in table


def test_an_unknown_command_in_the_line_of_options_is_an_error():
    with pytest.raises(KeyError, match="omnimj fly"):
        with_options("# Fly\n\nAll options: `omnimj fly --help`.\n", COMMANDS)


@pytest.mark.slow
def test_the_site_has_the_options_in_place_of_the_line(site: SiteBuild):
    for command in COMMANDS:
        built = (site.folder / page_of(command).replace(".md", ".html")).read_text(encoding="utf-8")
        assert 'id="options"' in built and "All options:" not in built
