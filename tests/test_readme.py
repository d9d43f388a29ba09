"""What the README shows works as it stands there."""

import re
import shlex
from pathlib import Path

import pytest
from other_robots import write_mecanum_of_the_guide

from omnimj.cli.main import make_parser
from omnimj.parameters import read_robot
from omnimj.simulate.scenario.listing import list_scenarios
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.view.readme_pictures import CLAIMS

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, flags=re.DOTALL)
COMMANDS = sorted({m.strip() for m in re.findall(r"`(omnimj [^`\n]+)`", TEXT)})


def blocks(language):
    return [code for name, code in BLOCKS if name == language]


@pytest.mark.parametrize("code", blocks("python"))
def test_python_in_the_readme_runs(code, capsys):
    exec(compile(code, "README.md", "exec"), {})
    assert capsys.readouterr().out


@pytest.mark.parametrize("code", blocks("toml"))
def test_a_scenario_in_the_readme_is_one(code, tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text(code)
    assert read_scenario(str(path)).checks


@pytest.mark.parametrize("command", [c for c in COMMANDS if not re.search(r"[A-Z]{3}", c)])
def test_commands_in_the_readme_are_commands(command):
    make_parser().parse_args(shlex.split(command)[1:])


@pytest.mark.parametrize("line", [line for code in blocks("sh")[2:] for line in code.splitlines()])
def test_lines_for_a_shell_are_commands(line):
    command = shlex.split(line.removesuffix("&"))
    assert command[0] == "omnimj"
    make_parser().parse_args(command[1:])


GUIDE = (ROOT / "models" / "README.md").read_text()


@pytest.mark.parametrize("line", [x for x in GUIDE.splitlines() if x.startswith("omnimj ")])
def test_lines_for_a_shell_in_the_guide_are_commands(line):
    make_parser().parse_args(shlex.split(line)[1:])


def test_the_mecanum_platform_of_the_guide_is_a_robot_whose_wheels_push_across_the_diagonals(tmp_path):
    mounts = read_robot(write_mecanum_of_the_guide(tmp_path / "robot.toml")).wheels
    assert [w.roller_axis[0] * w.position[0] + w.roller_axis[1] * w.position[1] for w in mounts] == (
        pytest.approx([0.0] * 4, abs=1e-12)
    )


def test_every_shipped_scenario_stands_in_the_readme():
    for name in list_scenarios():
        assert f"`{name}`" in TEXT, name


def test_links_and_pictures_of_the_readme_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (ROOT / target).exists(), target


@pytest.mark.parametrize("name", CLAIMS)
def test_every_claim_has_its_picture(name):
    assert f"](models/{name}.png)" in TEXT
    assert (ROOT / "models" / f"{name}.png").stat().st_size < 100_000


def test_ci_runs_the_readme_s_two_commands():
    ci = (ROOT / ".ci" / "run").read_text()
    install, check = (block.strip() for block in blocks("sh")[:2])
    for step in (*install.split(" && ")[2:], *check.split(" && ")):
        assert step.split(" --out")[0] in ci.replace(" --quiet --disable-pip-version-check", ""), step
