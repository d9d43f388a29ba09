"""When the disk is full, every writer reports path and reason, and no partial file has a final name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
import rerun as rr
from full_disk import no_file_beyond

from omnimj.errors import OutputError
from omnimj.recording.dataset import Run
from omnimj.recording.json_files import write_json, write_text
from omnimj.recording.read_dataset import read_dataset
from omnimj.recording.traces import write_trace
from omnimj.recording.write_dataset import DatasetWriter
from omnimj.signals import Trace
from omnimj.studies.gap_benchmark.seal import seal
from omnimj.studies.runner import TrialFolder
from omnimj.view.rerun.scene import recording_file

LIMIT = 1000
RANDOM = np.random.default_rng(0).random(4000)
COLUMNS = {
    "time": np.arange(4000) * 1e-3,
    "current": RANDOM,
    "wheel_speed": RANDOM,
    "carriage_speed": RANDOM,
    "carriage_acceleration": RANDOM,
}
STONE = {"floor": "natural_stone", "mass": 3.96}


def run(name: str) -> Run:
    return Run(name, COLUMNS, MappingProxyType({}), MappingProxyType(STONE))


def add_run(folder: Path, table_format: str) -> None:
    DatasetWriter(folder, "quarter_rig", STONE, table_format=table_format).add(run("one"))


def record_points(path: Path) -> None:
    with recording_file(path, "test") as stream:
        stream.log("points", rr.Points3D(RANDOM[:3000].reshape(-1, 3)))


WRITERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "text": ("a.txt", lambda path: write_text(path, "x" * 5000)),
    "JSON": ("a.json", lambda path: write_json(path, RANDOM.tolist())),
    "trace": ("trace.parquet", lambda path: write_trace(path, Trace(COLUMNS))),
    "run as CSV": ("one.csv", lambda path: add_run(path.parent, "csv")),
    "run as Parquet": ("one.parquet", lambda path: add_run(path.parent, "parquet")),
    "trial": ("one.json", lambda path: TrialFolder(path.parent).write("one", {"values": RANDOM.tolist()})),
    "seal": ("labels.sealed", lambda path: seal(path.parent, [{"x": x} for x in RANDOM.tolist()])),
    "recording": ("run.rrd", record_points),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_a_file_that_does_not_fit_is_reported_with_path_and_reason_and_leaves_nothing(kind, tmp_path):
    name, write = WRITERS[kind]
    with no_file_beyond(LIMIT), pytest.raises(OutputError) as caught:
        write(tmp_path / name)
    message = str(caught.value)
    assert message.startswith(str(tmp_path)) and "cannot be written, file too large" in message
    assert "\n" not in message
    left = {file.name for file in tmp_path.iterdir()}
    assert left <= {"labels.key"}, "nothing partial, under whatever name"


@pytest.mark.parametrize("kind", WRITERS)
def test_the_same_files_are_written_where_there_is_room(kind, tmp_path):
    name, write = WRITERS[kind]
    with no_file_beyond(10**7):
        write(tmp_path / name)
    assert (tmp_path / name).stat().st_size > LIMIT, "the limit of the other test cuts it"


def test_an_earlier_file_survives_when_its_successor_does_not_fit(tmp_path):
    write_text(tmp_path / "a.txt", "earlier")
    with no_file_beyond(LIMIT), pytest.raises(OutputError):
        write_text(tmp_path / "a.txt", "x" * 5000)
    assert (tmp_path / "a.txt").read_text() == "earlier"


def test_a_dataset_whose_disk_fills_up_keeps_its_runs_and_says_that_it_is_incomplete(tmp_path):
    writer = DatasetWriter(tmp_path, "quarter_rig", STONE, planned=3)
    writer.add(run("one"))
    with no_file_beyond(LIMIT), pytest.raises(OutputError):
        writer.add(run("two"))
    found = read_dataset(tmp_path)
    assert [one.name for one in found.runs] == ["one"]
    assert found.notes[0] == "the dataset is incomplete: 1 of 3 planned runs were recorded"
    writer.add(run("two"))
    writer.add(run("three"))
    assert not any("incomplete" in note for note in read_dataset(tmp_path).notes)
