"""The public interface: what `import omnimj` offers and costs, and that type checkers see the same names."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import pydoc
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import omnimj
from omnimj.recording.dataset import Run

HEAVY = "{'mujoco', 'numba', 'rerun', 'bokeh', 'pyarrow', 'scipy', 'numpy'}"


def output_of(script: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    ).stdout.strip()


def test_importing_it_takes_no_time_and_loads_no_library():
    script = f"""
import sys, time
began = time.perf_counter()
import omnimj
print(time.perf_counter() - began, {HEAVY} & set(sys.modules))
"""
    seconds, loaded = min(output_of(script).split(maxsplit=1) for _ in range(3))
    assert float(seconds) < 0.3 and loaded == "set()"


@pytest.mark.parametrize("name", omnimj.__all__)
def test_every_name_is_there_and_documented(name):
    found = getattr(omnimj, name)
    assert name == "__version__" or inspect.getdoc(found)
    assert name in dir(omnimj)


def test_type_checkers_see_the_same_names_in_the_same_places():
    tree = ast.parse(Path(omnimj.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {
        (alias.name, node.module)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == set(omnimj._HOME.items())
    assert (Path(omnimj.__file__).parent / "py.typed").exists()


def test_help_describes_the_interface_and_every_name():
    text = pydoc.render_doc(omnimj, renderer=pydoc.plaintext)
    assert "public interface" in text and "find_gap(" in text
    for name in omnimj.__all__:
        assert name in text


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'omnimj' has no attribute 'run_away'"):
        _ = omnimj.run_away
    assert not hasattr(omnimj, "_private")


def test_the_module_is_the_command():
    assert output_of(
        "import runpy, sys; sys.argv[1:] = ['--version']; runpy.run_module('omnimj', run_name='__main__')"
    )


def test_a_scenario_is_driven_by_its_name_or_as_a_record():
    by_name = omnimj.run("rig_slip", "planar", overrides=("duration=0.5",), seed=3)
    scenario = omnimj.read_scenario("rig_slip", ("duration=0.5",))
    again = omnimj.run(scenario, "planar", seed=3)
    assert by_name.metrics["method"] == "published" and by_name.metrics["plant"] == "planar"
    np.testing.assert_array_equal(by_name.trace["current"], again.trace["current"])


def test_a_dataset_is_recorded_and_read_back_diagnosed_and_identified(tmp_path):
    pytest.importorskip("pandas")
    dataset = omnimj.record("rig_currents", tmp_path / "data", repeats=1, plant="planar")
    assert dataset.plant == "quarter_rig" and len(dataset.runs) > 3
    few = dataclasses.replace(dataset, runs=[run for run in dataset.runs if run.name.startswith("pvc")][-2:])
    runs = omnimj.diagnose(few)
    diagnosed, _ = runs
    assert diagnosed.name == few.runs[0].name and len(diagnosed.trace["time"]) == len(few.runs[0].time)
    identified = omnimj.identify(few)
    frame = identified.to_pandas()
    assert set(frame["floor"]) == {"pvc"} and "sigma_0" in set(frame["parameter"])
    validated = omnimj.validate(few, plants=("planar",))
    assert validated.cells[0].rms["planar"] < 0.05
    for record, words in (
        (runs, ("Diagnosed runs", diagnosed.name)),
        (diagnosed, (f"Run {diagnosed.name}", "nothing found")),
        (identified, ("Floors of data", "bristle stiffness")),
        (validated, ("Validation on data", "RMS error, planar")),
    ):
        assert all(word in record._repr_html_() for word in words)
    for record in (diagnosed, identified, validated):
        assert record.plots and len(record.plot(*record.plots[:2]).children) >= 1
    assert "pvc-level" in identified.plots and runs.plots == ()


def test_records_become_frames():
    pandas = pytest.importorskip("pandas")
    columns = {"time": np.arange(3.0), "current_1": np.ones(3)}
    for record in (omnimj.Trace(columns), Run("a", columns, {}, {})):
        frame = record.to_pandas()
        assert isinstance(frame, pandas.DataFrame) and list(frame.index) == [0.0, 1.0, 2.0]
        assert list(frame.columns) == ["current_1"]
