"""Content of a built wheel and imports of its packages, tested without building one."""

from __future__ import annotations

import ast
import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import omnimj
from omnimj import resources

PACKAGE = Path(omnimj.__file__).parent
ROOT = PACKAGE.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WHEEL = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
COMES_WITH = {"llvmlite": "numba", "OpenGL": "mujoco", "markupsafe": "jinja2"}  # installed with it
MADE_FOR = {
    "learning": "gymnasium",
    "examples": "gymnasium",
}  # folders only for those with it
FOLDERS = {"models": resources.models_folder(), "scenarios": resources.scenarios_folder()}


def output_of(script: str, *path: Path, cwd: Path | None = None, home: Path | None = None) -> str:
    """Output of a fresh Python that sees only these folders and the installed libraries."""
    before = "".join(f"sys.path.insert(0, {str(folder)!r})\n" for folder in path)
    environment = dict(os.environ)
    if home is not None:
        environment = {
            key: value for key, value in environment.items() if key not in ("OMNIMJ_CACHE", "XDG_CACHE_HOME")
        }
        environment["HOME"] = str(home)
    done = subprocess.run(
        [sys.executable, "-B", "-P", "-c", f"import sys\n{before}{script}"],
        capture_output=True,
        text=True,
        cwd=cwd,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """A folder with the package as a wheel lays it out, by the rules of pyproject.toml."""
    site = tmp_path_factory.mktemp("site")
    for package in WHEEL["packages"]:
        shutil.copytree(ROOT / package, site / package, ignore=shutil.ignore_patterns("__pycache__"))
    for source, target in WHEEL["force-include"].items():
        shutil.copytree(ROOT / source, site / target, dirs_exist_ok=True)
    return site


def test_the_wheel_carries_every_folder_of_data():
    functions = {name for name in vars(resources) if name.endswith("_folder") and not name.startswith("_")}
    assert functions == {f"{name}_folder" for name in FOLDERS}
    assert WHEEL["force-include"] == {name: f"omnimj/{name}" for name in FOLDERS}
    for name, folder in FOLDERS.items():
        assert folder == ROOT / name and any(folder.rglob("*.toml"))
        assert not (PACKAGE / name).exists(), "in a checkout the data have one home"


def test_the_wheel_carries_the_documentation(installed):
    pages = {path.name for path in (installed / "omnimj" / "docs").glob("*.md")}
    assert {"index.md", "architecture.md", "gap.md"} <= pages and (installed / "omnimj" / "py.typed").exists()


def test_data_are_found_in_the_installed_layout(installed, tmp_path):
    script = "from omnimj.resources import *; print(models_folder(), scenarios_folder())"
    expected = f"{installed}/omnimj/models {installed}/omnimj/scenarios"
    assert output_of(script, installed, cwd=tmp_path).split() == expected.split()


@pytest.mark.slow
def test_an_installed_package_lists_and_runs_and_writes_only_where_it_should(installed, tmp_path):
    for folder in ("home", "work"):
        (tmp_path / folder).mkdir()
    before = sorted(installed.rglob("*"))
    script = """
from omnimj.cli.main import main
import omnimj
print(omnimj.__file__)
assert main(["scenarios"]) == 0
assert main(["run", "circle_8m_kinematic"]) == 0
"""
    output = output_of(script, installed, cwd=tmp_path / "work", home=tmp_path / "home")
    assert output.startswith(str(installed)) and "nylon_patch" in output and "passed" in output
    assert sorted(installed.rglob("*")) == before
    assert list((tmp_path / "work").iterdir()) == []


def test_the_installed_models_have_every_file_they_name(installed, tmp_path):
    script = """
from omnimj.parameters import read_floors, read_rig, read_robot
from omnimj.plant.mujoco.assembly import load_spec, models_folder, rig_model, robot_model
floor = read_floors()["pvc"]
print(robot_model(read_robot(), floor).nv, rig_model(read_rig(), floor).nu)
for scene in sorted(models_folder().glob("*/*.xml")):
    load_spec(scene).compile()
    print(scene)
"""
    output = output_of(script, installed, cwd=tmp_path)
    assert output.startswith("86 2\n") and "obstacles.xml" in output and str(ROOT / "models") not in output


def test_control_and_physics_import_on_a_small_computer():
    script = """
import importlib, pkgutil
class Absent:
    names = ("mujoco", "rerun", "rerun_sdk", "bokeh", "pyarrow", "serial", "PIL")
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in self.names:
            raise ModuleNotFoundError(f"{name} is not there", name=name)
sys.meta_path.insert(0, Absent())
for name in ("control", "physics", "parameters", "plant"):
    package = importlib.import_module(f"omnimj.{name}")
    find = pkgutil.iter_modules if name == "plant" else pkgutil.walk_packages
    for module in find(package.__path__, f"omnimj.{name}."):
        print(importlib.import_module(module.name).__name__)
"""
    output = output_of(script, ROOT).split()
    assert {"omnimj.control.cascade.controller", "omnimj.physics.planar", "omnimj.physics.native"} <= set(
        output
    )


NEEDING_EXTRAS = {
    ("tune", "circle_8m", "--out", "gains.toml"): "tune",
    ("run", "nylon_patch", "--plant", "serial:/dev/ttyACM0"): "hardware",
    ("device", "--serial", "/dev/ttyACM0"): "hardware",
    ("evaluate", "--executor", "dask:tcp://127.0.0.1:1", "--out", "out"): "dask",
}


@pytest.mark.slow
def test_a_command_that_needs_an_extra_says_which(tmp_path):
    """One process without any extra, as after a plain installation."""
    script = f"""
import contextlib, io, json
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("cma", "serial", "distributed"):
            raise ModuleNotFoundError(f"{{name}} is not there", name=name)
sys.meta_path.insert(0, Absent())
from omnimj.cli.main import main
for argv in {[list(argv) for argv in NEEDING_EXTRAS]}:
    with contextlib.redirect_stderr(io.StringIO()) as printed:
        code = main(argv)
    print(json.dumps([code, printed.getvalue()]))
"""
    outcomes = [json.loads(line) for line in output_of(script, ROOT, cwd=tmp_path).splitlines()]
    for (code, printed), extra in zip(outcomes, NEEDING_EXTRAS.values(), strict=True):
        lines = [line for line in printed.splitlines() if not line.startswith("compiling native code")]
        assert code == 2 and len(lines) == 1
        assert lines[0].endswith(f"is not installed; pip install 'omnimj[{extra}]'")
        assert extra in PROJECT["project"]["optional-dependencies"]
    assert list(tmp_path.iterdir()) == []


def _library(requirement: str) -> str:
    return re.split(r"[<>=!~ \[]", requirement)[0].lower()


def imports_in(node: ast.AST, late: bool = False) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Imports below a node, and whether a function makes them."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child, late
        elif not isinstance(child, ast.expr):
            yield from imports_in(child, late or isinstance(child, ast.FunctionDef))


def test_every_library_that_is_imported_is_declared():
    """Those of an optional extra only where a function imports them, or in the package made for one.

    Others never meet them.
    """
    project = PROJECT["project"]
    declared = {_library(one) for one in project["dependencies"]}
    extras = {
        _library(one)
        for name, libraries in project["optional-dependencies"].items()
        if name != "dev"
        for one in libraries
    }
    installs = importlib.metadata.packages_distributions()
    for source in PACKAGE.rglob("*.py"):
        for node, late in imports_in(ast.parse(source.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and not node.level:
                names = [str(node.module)]
            for name in {name.split(".")[0] for name in names} - set(sys.stdlib_module_names) - {"omnimj"}:
                library = COMES_WITH.get(name, name)
                known = declared | extras if late or library == MADE_FOR.get(source.parent.name) else declared
                assert known & {one.lower() for one in installs.get(library, [library])}, (source, name)


def test_version_and_command_are_those_of_the_project():
    assert PROJECT["project"]["version"] == omnimj.__version__
    assert PROJECT["project"]["scripts"] == {"omnimj": "omnimj.cli.main:main"}
