"""Numbers that no logger can have measured are refused in one line, and changing rates are reported."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path

import made_datasets as made
import numpy as np
import pytest

from omnimj.errors import InputError
from omnimj.parameters.reading import MAX_TOML_SIZE, read_toml
from omnimj.recording.dataset import Run
from omnimj.recording.importing.source import read_source
from omnimj.recording.read_dataset import LARGEST, LONGEST_PAUSE, MOST_STEPS, read_dataset
from omnimj.recording.write_dataset import write_dataset

DEFAULTS = {"floor": "natural_stone", "mass": 3.9593}
Columns = dict[str, np.ndarray]


def written(folder: Path, change: Callable[[Columns], None]) -> Path:
    columns = {name: np.array(values, float) for name, values in made.rig_columns().items()}
    change(columns)
    write_dataset(folder, "quarter_rig", DEFAULTS, [Run("a", columns, {}, {})])
    return folder


def last_stamp(columns: Columns) -> None:
    columns["time"][-1] = 1e12


def jump(columns: Columns) -> None:
    columns["time"][20:] += LONGEST_PAUSE + 1.0


def endless(columns: Columns) -> None:
    steps = np.full(len(columns["time"]), 1e-6)
    steps[::3] = 0.9 * LONGEST_PAUSE
    columns["time"] = np.cumsum(steps)


def astronomical(columns: Columns) -> None:
    columns["carriage_speed"][7:9] = 4.6e19


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (last_stamp, ("column 'time'", "found 1e+12 after", f"at most {LONGEST_PAUSE:g} s", "two runs")),
        (jump, ("row 21", "column 'time'", "two runs")),
        (endless, ("lasts", f"at most {MOST_STEPS} steps")),
        (astronomical, ("row 8", "column 'carriage_speed'", "found 4.6e+19", f"more than {LARGEST:g}")),
    ],
)
def test_what_no_logger_measures_is_refused_with_its_place(tmp_path, change, words):
    with pytest.raises(InputError) as caught:
        read_dataset(written(tmp_path, change))
    message = str(caught.value)
    assert "\n" not in message and "a.parquet" in message
    for word in words:
        assert word in message


def test_times_since_an_epoch_and_pauses_are_no_nonsense(tmp_path):
    def since_1970(columns: Columns) -> None:
        columns["time"] += 1.79e9
        columns["time"][30:] += 0.9 * LONGEST_PAUSE

    (run,) = read_dataset(written(tmp_path, since_1970)).runs
    assert run.time[0] > 1e9


def test_a_rate_that_changes_within_a_run_is_reported(tmp_path):
    def slower(columns: Columns) -> None:
        half = len(columns["time"]) // 2
        columns["time"][half:] = columns["time"][half - 1] + 0.1 * np.arange(
            1, 1 + len(columns["time"]) - half
        )

    notes = read_dataset(written(tmp_path / "mixed", slower)).notes
    assert any("the sampling rate changes, between 10 and 100 samples per second" in note for note in notes)
    even = read_dataset(written(tmp_path / "even", lambda columns: None)).notes
    assert not any("rate changes" in note for note in even)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("read", [read_toml, read_source], ids=["TOML", "table"])
def test_a_pipe_or_a_device_is_refused_instead_of_waited_for(tmp_path, read):
    pipe = tmp_path / ("dataset.toml" if read is read_toml else "log.csv")
    os.mkfifo(pipe)
    found: list[Exception] = []

    def attempt() -> None:
        try:
            read(pipe)
        except InputError as error:
            found.append(error)

    reader = threading.Thread(target=attempt, daemon=True)
    reader.start()
    reader.join(10.0)
    assert not reader.is_alive() and "is a pipe or a device; a regular file is needed" in str(found[0])
    if read is read_toml and Path("/dev/zero").exists():
        with pytest.raises(InputError, match="is a pipe or a device"):
            read_toml(Path("/dev/zero"))


def test_a_toml_file_of_unreasonable_size_is_refused_before_it_is_read(tmp_path):
    huge = tmp_path / "huge.toml"
    with huge.open("wb") as file:
        file.truncate(MAX_TOML_SIZE + 1)  # sparse: it takes no room
    with pytest.raises(InputError, match=f"at most {MAX_TOML_SIZE} are read"):
        read_toml(huge)
