"""What the project says about itself is true: versions, extras, workflows, pages on extending it."""

import re
import textwrap
import tomllib
from pathlib import Path

import pytest
import yaml

import omnimj
from omnimj.simulate.scenario.scenario import read_scenario

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "omnimj" / "docs"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PAGES = sorted((DOCS / "extend").glob("*.md"))


def blocks(page, language):
    found = re.findall(r"^( *)```(\w+)\n(.*?)^\1```", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return [textwrap.dedent(code) for _, name, code in found if name == language]


def test_the_newest_entry_of_the_changelog_is_this_version():
    entries = re.findall(r"^## (\S+)", (DOCS / "changelog.md").read_text(encoding="utf-8"), flags=re.M)
    assert entries[0] == omnimj.__version__ == PROJECT["version"]
    assert f"{{{omnimj.__version__}}}" in (DOCS / "cite.md").read_text(encoding="utf-8")
    numbers = [tuple(map(int, entry.split("."))) for entry in entries]
    assert numbers == sorted(numbers, reverse=True)


def test_every_extra_is_documented_and_all_has_them_all():
    text = (DOCS / "commands.md").read_text(encoding="utf-8")
    extras = set(PROJECT["optional-dependencies"]) - {"dev"}
    assert [name for name in extras if f"`{name}`" not in text] == []
    (everything,) = PROJECT["optional-dependencies"]["all"]
    assert set(re.findall(r"[\w-]+", everything)) - {"omnimj"} == extras - {"all"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_examples_of_adding_something_run(page, capsys):
    for code in blocks(page, "python"):
        exec(compile(code, str(page), "exec"), {})
        assert capsys.readouterr().out
    assert blocks(page, "python") or blocks(page, "toml")


def test_the_scenario_to_be_added_is_one(tmp_path):
    (code,) = blocks(DOCS / "extend" / "scenario.md", "toml")
    (tmp_path / "push.toml").write_text(code)
    assert read_scenario(str(tmp_path / "push.toml")).checks


@pytest.mark.parametrize("file", sorted((ROOT / ".github").rglob("*.yml")), ids=lambda file: file.name)
def test_workflows_and_templates_are_yaml_and_name_scripts_and_folders_that_exist(file):
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    assert content
    for job in content.get("jobs", {}).values():
        for step in job["steps"]:
            for name in re.findall(r"(?<![\w/])(?:\.ci|tests)/[\w/.]+", step.get("run", "")):
                assert (ROOT / name).exists(), name
    if file.name == "ci.yml":
        versions = content["jobs"]["linux"]["strategy"]["matrix"]["python"]
        assert f">={versions[0]}" == PROJECT["requires-python"]


def test_the_guide_for_contributors_links_to_what_exists():
    guide = ROOT / ".github" / "CONTRIBUTING.md"
    text = guide.read_text(encoding="utf-8")
    assert [t for t in re.findall(r"\]\(([^)#]+)\)", text) if not (guide.parent / t).exists()] == []
    assert [t for t in re.findall(r"`(omnimj/[\w/.]+)`", text) if not (ROOT / t).exists()] == []
    assert {page.name for page in PAGES} == set(re.findall(r"extend/([\w.]+)", text))


def test_the_nightly_tables_are_those_of_the_documentation():
    """Each command of the tables on evaluation, sensitivity and soak, but for its output folder."""
    script = (ROOT / ".ci" / "tables").read_text(encoding="utf-8")
    commands = []
    for page, wanted in (
        ("evaluation.md", r"`(omnimj evaluate [^`]*--seed [^`]*)`"),
        ("threats.md", r"`(omnimj link fuzz [^`]*)`"),
        ("tuning.md", r"^(omnimj sensitivity .*)$"),
    ):
        found = re.findall(wanted, (DOCS / page).read_text(encoding="utf-8"), flags=re.M)
        assert found, page
        commands += found
    for command in commands:
        words = re.sub(r" --(out|method) \S+", "", command)
        assert words in re.sub(r" --(out|method) \S+", "", script), command
    assert ".ci/tables" in (ROOT / ".ci" / "nightly").read_text(encoding="utf-8")
