"""`omnimj docs`: arguments, exit codes, and what it says without its generator."""

from __future__ import annotations

import importlib.util

import pytest

from omnimj.cli.main import main
from omnimj.documentation import site as publishing
from omnimj.documentation.site import SiteBuild, require_generator


@pytest.fixture
def built(monkeypatch):
    """Records what is to be built, in place of building it."""
    asked = []

    def build(folder, parser, execute, report):
        folder.mkdir()
        (folder / "index.html").write_text("<p>home</p>")
        asked.append(execute)
        return SiteBuild(folder, ("index.md", "gap.md"))

    monkeypatch.setattr(publishing, "build_site", build)
    return asked


def test_build_executes_the_tutorials_unless_they_are_to_stay_plain(built, tmp_path, capsys):
    assert main(["docs", "build", "--out", str(tmp_path / "a")]) == 0
    assert main(["docs", "build", "--out", str(tmp_path / "b"), "--tutorials", "plain"]) == 0
    assert built == [True, False]
    assert capsys.readouterr().out.splitlines()[0] == f"2 pages; open {tmp_path / 'a' / 'index.html'}"


def test_a_folder_that_is_not_empty_is_refused_without_force(built, tmp_path, capsys):
    (tmp_path / "kept.txt").write_text("mine")
    assert main(["docs", "build", "--out", str(tmp_path)]) == 2
    assert "is not empty; choose another folder, or --force" in capsys.readouterr().err
    assert built == [] and [path.name for path in tmp_path.iterdir()] == ["kept.txt"]


@pytest.mark.parametrize("package", ["mkdocs", "material", "mkdocstrings", "jupytext", "nbclient"])
def test_without_the_generator_one_line_says_which_extra_to_install(package, monkeypatch, refused):
    def find(name, *_):
        return None if name == package else importlib.util.spec_from_loader(name, None)

    monkeypatch.setattr(importlib.util, "find_spec", find)
    line = refused("docs", "build", "--out", "site")
    assert line == (f"omnimj docs: {package} is not installed; pip install 'omnimj[docs]'")


def test_all_programs_of_the_extra_are_looked_for():
    require_generator()


@pytest.mark.parametrize(
    "words, said",
    [
        (("docs",), "the following arguments are required: COMMAND"),
        (("docs", "build"), "the following arguments are required: --out"),
        (("docs", "build", "--out", "a", "--tutorials", "some"), "choices: executed, plain"),
        (("docs", "serve", "--port", "99999"), "at most 65535"),
        (("docs", "serve", "--host", "0.0.0.0"), "unknown option '--host'"),
    ],
)
def test_wrong_arguments_are_said_in_one_line(words, said, refused):
    assert said in refused(*words)
