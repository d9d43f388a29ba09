"""Folders of runs are found, named shortly, and refused with one line where they are damaged."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnimj.errors import InputError
from omnimj.recording.run_folder import find_run_folders, read_run_folder, short_names

METRICS = {"scenario": "circle", "checks": [{"name": "final_speed", "value": 0.1, "ok": True}]}


def make_run(folder: Path, content: object = METRICS) -> Path:
    folder.mkdir(parents=True)
    text = content if isinstance(content, str) else json.dumps(content)
    (folder / "metrics.json").write_text(text)
    return folder


def test_runs_are_found_below_a_folder_in_the_order_of_their_paths(tmp_path):
    made = [make_run(tmp_path / name) for name in ("b", "a/two", "a/one", "a/deep/er/run")]
    make_run(tmp_path / "a/one/inside")  # part of a run
    make_run(tmp_path / "1/2/3/4/5")  # too deep
    (tmp_path / "link").symlink_to(tmp_path / "b")
    found = [run.path for run in find_run_folders(tmp_path)]
    assert found == sorted(made)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is not JSON"),
        ('{"scenario": "x"', "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[1]", "has no 'scenario'"),
        ({"scenario": 3}, "has no 'scenario'"),
        ({"scenario": "x", "checks": 5}, "'checks' is not a list"),
        ({"scenario": "x", "faults": [1]}, "'faults' is not a list"),
        ({"scenario": "x", "checks": [{"ok": True}]}, "a check without name"),
        ({"scenario": "x", "checks": [{"name": "a", "ok": 1}]}, "a check without name"),
        ({"scenario": "x", "checks": [{"name": "a", "ok": True, "value": "b"}]}, "a check without name"),
    ],
)
def test_damaged_metrics_are_refused_in_one_line(tmp_path, content, words):
    with pytest.raises(InputError, match=words) as caught:
        read_run_folder(make_run(tmp_path / "run", content))
    assert "\n" not in str(caught.value) and "metrics.json" in str(caught.value)


def test_what_is_no_run_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"has no metrics\.json"):
        read_run_folder(tmp_path)
    with pytest.raises(InputError, match="is not a folder"):
        read_run_folder(tmp_path / "nowhere")
    with pytest.raises(InputError, match="holds no run"):
        find_run_folders(tmp_path)
    os.mkfifo(tmp_path / "metrics.json")
    with pytest.raises(InputError, match="not a regular file"):
        read_run_folder(tmp_path)


@settings(max_examples=50)
@given(st.lists(st.tuples(*[st.sampled_from("ab")] * 3), unique=True, min_size=1, max_size=8))
def test_short_names_differ_and_are_the_ends_of_their_paths(parts):
    paths = [Path("/", *own) for own in parts]
    names = short_names(paths)
    assert len(set(names)) == len(paths)
    assert all(str(path).endswith(name) for path, name in zip(paths, names, strict=True))
    lengths = {name.count("/") for name in names}
    assert len(lengths) == 1
    (length,) = lengths
    if length:  # a shorter end would not tell them apart
        assert len({own[len(own) - length :] for own in parts}) < len(paths)
