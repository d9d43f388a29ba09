"""What README and documentation show works as it stands there."""

import re
import shlex
from pathlib import Path

import pytest
from other_robots import write_mecanum_of_the_guide

import omnimj
from omnimj.cli.main import make_parser
from omnimj.parameters import read_robot
from omnimj.simulate.scenario.listing import list_scenarios
from omnimj.simulate.scenario.scenario import read_scenario

ROOT = Path(__file__).parent.parent
DOCS = Path(omnimj.__file__).parent / "docs"
README = ROOT / "README.md"
HOWTO = sorted((DOCS / "howto").glob("*.md"))
PAGES = [README, ROOT / "models" / "README.md", *sorted(DOCS.glob("*.md")), *HOWTO]
TEXT = {page: page.read_text(encoding="utf-8") for page in PAGES}
BLOCKS = [
    (page.name, language, code)
    for page, text in TEXT.items()
    for language, code in re.findall(r"```(\w+)\n(.*?)```", text, flags=re.DOTALL)
]


def blocks(language):
    return [
        pytest.param(code, id=f"{page}-{k}")
        for k, (page, name, code) in enumerate(BLOCKS)
        if name == language
    ]


def commands():
    """Commands in backticks and lines for a shell, but for those with a placeholder in capitals or dots."""
    inline = {m.strip() for text in TEXT.values() for m in re.findall(r"`(omnimj [^`\n]+)`", text)}
    shell = "\n".join(code for _, name, code in BLOCKS if name == "sh")
    lines = {line.removesuffix("&").strip() for line in shell.splitlines()}
    whole = {line for line in inline | lines if line.startswith("omnimj ")}
    return sorted(line for line in whole if not re.search(r"\b[A-Z]{3,}\b|…", line))


@pytest.mark.parametrize("code", blocks("python"))
def test_python_in_the_documentation_runs(code, capsys):
    exec(compile(code, "documentation", "exec"), {})
    assert capsys.readouterr().out


@pytest.mark.parametrize("code", [p for p in blocks("toml") if "[checks]" in str(p.values[0])])
def test_a_scenario_in_the_documentation_is_one(code, tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text(code)
    assert read_scenario(str(path)).checks


@pytest.mark.parametrize("command", commands())
def test_commands_in_the_documentation_are_commands(command, capsys):
    words = shlex.split(command)[1:]
    named_only = "-" not in command and not {"run", "link", "docs"}.isdisjoint(words[:1])
    if named_only or len(words) == 1 or words[-1] == "--help":
        with pytest.raises(SystemExit, match=r"^0$"):
            make_parser().parse_args([*(word for word in words if word != "--help"), "--help"])
    else:
        make_parser().parse_args(words)


def test_the_mecanum_platform_of_the_guide_is_a_robot_whose_wheels_push_across_the_diagonals(tmp_path):
    mounts = read_robot(write_mecanum_of_the_guide(tmp_path / "robot.toml")).wheels
    assert [w.roller_axis[0] * w.position[0] + w.roller_axis[1] * w.position[1] for w in mounts] == (
        pytest.approx([0.0] * 4, abs=1e-12)
    )


def test_every_shipped_scenario_is_documented():
    text = (DOCS / "scenarios.md").read_text(encoding="utf-8")
    assert [name for name in list_scenarios() if f"`{name}`" not in text] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_pictures_and_files_named_in_a_page_exist(page):
    targets = re.findall(r"\]\(([^)#]+)\)", TEXT[page])
    assert [t for t in targets if not t.startswith("http") and not (page.parent / t).exists()] == []
    named = re.findall(r"`((?:omnimj|tests|models|scenarios)/[\w./]+)`", TEXT[page])
    assert [name for name in named if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("picture", sorted((DOCS / "pictures").iterdir()), ids=lambda picture: picture.name)
def test_every_picture_is_shown_and_small(picture):
    assert any(f"pictures/{picture.name})" in text for text in TEXT.values())
    assert picture.stat().st_size < 600_000


def test_every_page_is_listed_in_the_index():
    index = TEXT[DOCS / "index.md"]
    names = {page.name for page in DOCS.glob("*.md")} - {"index.md"}
    assert [name for name in sorted(names) if f"]({name})" not in index] == []


def test_every_how_to_page_is_listed_with_its_command():
    index = TEXT[DOCS / "commands.md"]
    assert [
        page.name for page in HOWTO if not re.search(rf"\[`omnimj [^`]+`\]\(howto/{page.name}\)", index)
    ] == []


def test_the_front_page_is_one():
    lines = TEXT[README].splitlines()
    assert len(lines) <= 150 and max(map(len, lines)) <= 120


def test_ci_runs_the_two_commands_of_the_front_page():
    ci = (ROOT / ".ci" / "run").read_text().replace(" --quiet --disable-pip-version-check", "")
    install, check = [code.strip() for page, name, code in BLOCKS if page == "README.md" and name == "sh"][:2]
    for step in (*install.split(" && ")[2:], *check.split(" && ")):
        assert step.split(" --out")[0] in ci, step
