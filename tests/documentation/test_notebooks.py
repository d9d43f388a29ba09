"""Tutorials are notebooks without results, say what they show, and run to their end."""

from __future__ import annotations

import re
import shlex
import sys
import tomllib

import jupytext
import pytest

from omnimj.cli.main import make_parser
from omnimj.cli.terminal import ended_by_signals
from omnimj.documentation.navigation import NAVIGATION
from omnimj.documentation.notebooks import execute_notebook, notebook_page, read_notebook
from omnimj.documentation.staging import DOCS
from omnimj.errors import SimulationError

TUTORIALS = sorted((DOCS / "tutorials").glob("*.md"))
QUICK = ("drive_and_break", "own_wheel")
"""Tutorials of a few seconds; the others are left to the nightly run."""
_HEADER = """---
jupyter:
  kernelspec:
    name: python3
    display_name: Python 3
    language: python
---

"""


def by_name(paths):
    return [pytest.param(path, id=path.stem) for path in paths]


def timed(path):
    return pytest.param(path, id=path.stem, marks=() if path.stem in QUICK else pytest.mark.slow)


@pytest.fixture
def tutorial(tmp_path):
    """Writes a small tutorial."""

    def write(text: str):
        file = tmp_path / "small.md"
        file.write_text(_HEADER + text, encoding="utf-8")
        return file

    return write


def test_all_six_tutorials_are_there_in_the_order_of_the_navigation():
    (tutorials,) = (section["Tutorials"] for section in NAVIGATION if "Tutorials" in section)
    assert {f"tutorials/{path.name}" for path in TUTORIALS} == set(tutorials)


@pytest.mark.parametrize("path", by_name(TUTORIALS))
def test_a_tutorial_is_a_notebook_without_results_that_begins_with_its_title(path):
    text = path.read_text(encoding="utf-8")
    assert text.startswith(_HEADER + "# ") and text.count("\n# ") == 1
    notebook = read_notebook(path)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len(code) >= 5 and all(not cell.outputs and cell.execution_count is None for cell in code)
    assert list(DOCS.rglob("*.ipynb")) == []


@pytest.mark.parametrize("path", by_name(TUTORIALS))
def test_code_of_a_tutorial_is_python_and_its_commands_are_commands(path):
    for cell in read_notebook(path).cells:
        if cell.cell_type != "code":
            continue
        if not cell.source.startswith("%%"):
            compile(cell.source, path.name, "exec")
            continue
        for line in cell.source.splitlines():
            command = re.split(r" (?:\||\|\||&&|>|2>) ?", line.strip())[0]
            if command.startswith("omnimj "):
                make_parser().parse_args(shlex.split(command)[1:])


@pytest.mark.parametrize("path", by_name(TUTORIALS))
def test_tables_in_a_tutorial_are_toml(path):
    for code in re.findall(r"```toml\n(.*?)```", path.read_text(encoding="utf-8"), flags=re.DOTALL):
        tomllib.loads(code)


@pytest.mark.slow
@pytest.mark.parametrize("path", [timed(path) for path in TUTORIALS])
def test_a_tutorial_runs_to_its_end_and_shows_results(path):
    cells = [cell for cell in execute_notebook(path).cells if cell.cell_type == "code"]
    assert all(cell.execution_count for cell in cells)
    shown = [cell for cell in cells if any(one.get("name") != "stderr" for one in cell.outputs)]
    assert len(shown) >= 4


@pytest.mark.slow
def test_results_stand_below_their_code_and_notes_on_standard_error_do_not(tutorial):
    file = tutorial(
        "# Small\n\n```python\nimport sys\nprint('six', file=sys.stderr)\nprint(2 * 3)\n```\n\n"
        "```bash\necho $((6 * 7))\n```\n\n```python\nprint('```')\n'last'\n```\n\n"
        "```python\nimport matplotlib.pyplot as plt\nplt.plot([0, 1])\nplt.show()\n```\n"
    )
    page = notebook_page(file, execute=True)
    assert re.sub(r"\s+", " ", page).startswith("# Small ```python import sys")
    assert "```text\n6\n```" in page and "```bash\necho $((6 * 7))\n```" in page
    assert "```text\n42\n```" in page and "'last'" in page and "\nsix\n" not in page
    assert "````text\n```\n````" in page, "a fence in an output does not end its block"
    (name,) = re.findall(r"\]\((small_\w+\.png)\)", page)
    assert file.with_name(name).read_bytes().startswith(b"\x89PNG")


def test_without_execution_a_page_is_the_text_and_code_alone(tutorial):
    assert notebook_page(tutorial("# Small\n\n```python\n1 / 0\n```\n"), execute=False) == (
        "# Small\n\n```python\n1 / 0\n```\n"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "code, said",
    [
        ("```python\n1 / 0\n```\n", "cell '1 / 0': ZeroDivisionError"),
        ("```bash\necho 'no such scenario' >&2; exit 2\n```\n", "no such scenario"),
    ],
    ids=["python", "bash"],
)
def test_a_cell_that_fails_is_named_with_its_reason(tutorial, code, said):
    with pytest.raises(SimulationError, match=r"^tutorial small.md: cell ") as error:
        execute_notebook(tutorial(f"# Small\n\n{code}"))
    assert said in str(error.value) and "\n" not in str(error.value)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="a process cannot send this signal to another there")
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
def test_a_signal_in_the_middle_of_a_cell_ends_the_tutorial_like_ctrl_c(tutorial, number):
    signal_and_wait = f"import os, signal, time\nos.kill(os.getppid(), signal.{number})\ntime.sleep(600)"
    with pytest.raises(KeyboardInterrupt), ended_by_signals():
        execute_notebook(tutorial(f"# Small\n\n```python\n{signal_and_wait}\n```\n"))


def test_jupytext_reads_a_tutorial_as_it_was_written():
    for path in TUTORIALS:
        notebook = read_notebook(path)
        again = jupytext.reads(jupytext.writes(notebook, fmt="md"), fmt="md")
        assert [cell.source for cell in again.cells] == [cell.source for cell in notebook.cells]
