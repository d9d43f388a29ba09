"""Mutated files of every kind: read, or refused in one line; never a traceback, and never endlessly."""

from __future__ import annotations

import faulthandler
import json
import random
import time
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType

import made_datasets as made
import numpy as np
import pytest
import scipy.io
from key_files import make_key_file

from omnimj.control.detection.robust.thresholds import THRESHOLD_UNITS, Thresholds, read_thresholds
from omnimj.control.gains import read_gains
from omnimj.errors import OmnimjError
from omnimj.link.codec.frames import encode
from omnimj.link.codec.key import read_key
from omnimj.link.codec.messages import Frame, Ping
from omnimj.link.host.frame_log import FRAMES_FILE, FrameLog, FrameRecording
from omnimj.parameters import read_floors, read_rig, read_robot
from omnimj.parameters.floor import all_floors
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.dataset import Run
from omnimj.recording.importing.mapping import read_mapping
from omnimj.recording.importing.source import read_source
from omnimj.recording.read_dataset import read_dataset
from omnimj.recording.traces import read_trace, write_trace
from omnimj.recording.write_dataset import write_dataset
from omnimj.resources import models_folder, scenarios_folder
from omnimj.signals import Trace
from omnimj.simulate.machine.linear_axis import read_axis
from omnimj.simulate.scenario.scenario import read_scenario

LONGEST = 10.0
"""Time in which every file is read or refused [s]."""
COLUMNS = {name: np.array(values, float) for name, values in made.rig_columns().items()}
STONE = {"floor": "natural_stone", "mass": 3.9593}
_TOKENS = (*b"nan inf -1 1e999 0 [] {} true [[ ; =".split(), b'"x"', b"\0", b"\xff")


def dataset(folder: Path, kind: str) -> Path:
    write_dataset(
        folder, "quarter_rig", STONE, [Run("a", COLUMNS, MappingProxyType({}), {})], table_format=kind
    )
    return folder / f"a.{kind}"


def copy_of(source: Path) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        file = folder / source.name
        file.write_bytes(source.read_bytes())
        return file

    return make


def text_file(name: str, text: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        (folder / name).write_text(text, encoding="utf-8")
        return folder / name

    return make


def matlab(folder: Path) -> Path:
    scipy.io.savemat(folder / "log.mat", {"log": COLUMNS})
    return folder / "log.mat"


def trace(folder: Path) -> Path:
    write_trace(folder / "trace.parquet", Trace(COLUMNS, {"seed": 1}))
    return folder / "trace.parquet"


def frames(folder: Path) -> Path:
    log = FrameLog(folder / FRAMES_FILE, {"robot": "uto_robot"})
    for k in range(40):
        log.sent(0.01 * k, encode(Frame(Ping(k), 1, k, 0)))
    log.close()
    return folder / FRAMES_FILE


def key(folder: Path) -> Path:
    make_key_file(folder / "link.key")
    return folder / "link.key"


_USUAL = Thresholds()._asdict()
THRESHOLDS = "[thresholds]\n" + "\n".join(
    f'{name} = {{ value = {_USUAL[name]}, unit = "{unit}", source = "tuned" }}'
    for name, unit in THRESHOLD_UNITS.items()
)
GAINS = '[control]\nyaw_rate_proportional = { value = 2.0, unit = "1", source = "tuned" }\n'
MAPPING = 'plant = "quarter_rig"\n[columns]\ntime = { from = "t" }\ncurrent = { from = "I", scale = 1.0 }\n'
MODELS = models_folder()
KINDS: dict[str, tuple[Callable[[Path], Path], Callable[[Path], object]]] = {
    "CSV run": (lambda folder: dataset(folder, "csv"), lambda file: read_dataset(file.parent)),
    "Parquet run": (lambda folder: dataset(folder, "parquet"), lambda file: read_dataset(file.parent)),
    "dataset.toml": (
        lambda folder: dataset(folder, "parquet").with_name("dataset.toml"),
        lambda file: read_dataset(file.parent),
    ),
    "trace": (trace, read_trace),
    "CSV log": (text_file("log.csv", made.csv_text(COLUMNS).replace(",", ";")), read_source),
    "JSON log": (text_file("log.json", json.dumps({k: v.tolist() for k, v in COLUMNS.items()})), read_source),
    "MATLAB log": (matlab, read_source),
    "mapping": (text_file("mapping.toml", MAPPING), read_mapping),
    "robot": (copy_of(MODELS / "uto_robot" / "robot.toml"), read_robot),
    "rig": (copy_of(MODELS / "quarter_rig" / "rig.toml"), read_rig),
    "axis": (copy_of(MODELS / "linear_axis" / "axis.toml"), read_axis),
    "floors": (copy_of(MODELS / "floors.toml"), read_floors),
    "more floors": (copy_of(MODELS / "floors.toml"), all_floors),
    "scenario": (copy_of(scenarios_folder() / "nylon_patch.toml"), lambda file: read_scenario(str(file))),
    "rig scenario": (copy_of(scenarios_folder() / "rig_slip.toml"), lambda file: read_scenario(str(file))),
    "thresholds": (text_file("t.toml", THRESHOLDS), read_thresholds),
    "gains": (text_file("g.toml", GAINS), lambda file: read_gains(file, read_robot().control)),
    "frames": (frames, lambda file: list(FrameRecording(file))),
    "key": (key, read_key),
    "machine": (copy_of(MODELS / "servo_arm" / "servo_arm.xml"), read_machine_file),
}  # fmt: skip


def mutated(rng: random.Random, content: bytes) -> bytes:
    """The content with one to four mistakes."""
    found = bytearray(content)
    for _ in range(rng.randint(1, 4)):
        at, size = rng.randrange(len(found) + 1), rng.choice((1, 4, 30, 300))
        kind = rng.randrange(6)
        if kind == 0 and found:
            found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
        elif kind == 1:
            del found[at:]
        elif kind == 2:
            del found[at : at + size]
        elif kind == 3:
            found[at:at] = rng.randbytes(size)
        elif kind == 4:
            found[at:at] = found[:size]
        else:
            found[at : at + rng.choice((0, 1, 3))] = rng.choice(_TOKENS)
    return bytes(found)


def read_mutations(kind: str, folder: Path, count: int, seed: int) -> int:
    """Read so many mutations of one kind of file; how many of them were refused."""
    make, read = KINDS[kind]
    rng, refused = random.Random(f"{kind} {seed}"), 0
    file = make(folder)
    good, beside = file.read_bytes(), sorted(folder.iterdir())
    for _ in range(count):
        content = mutated(rng, good)
        file.write_bytes(content)
        begin = time.monotonic()
        faulthandler.dump_traceback_later(2.0 * LONGEST, exit=True)
        try:
            read(file)
        except OmnimjError as error:
            refused += 1
            assert "\n" not in str(error) and len(str(error)) < 1500, content
        except Exception as error:
            error.add_note(f"{kind}: {content!r}")
            raise
        finally:
            faulthandler.cancel_dump_traceback_later()
        assert time.monotonic() - begin < LONGEST, content
        assert sorted(folder.iterdir()) == beside, "reading writes nothing"
    return refused


@pytest.mark.parametrize("kind", KINDS)
def test_a_mutated_file_is_read_or_refused_in_one_line(kind, tmp_path):
    assert read_mutations(kind, tmp_path, 12, 1) > 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_five_thousand_mutated_files(kind, tmp_path):
    count = 5000 // len(KINDS)
    assert read_mutations(kind, tmp_path, count, 2) > 0


@pytest.mark.parametrize("kind", KINDS)
def test_the_file_that_is_mutated_is_sound(kind, tmp_path):
    make, read = KINDS[kind]
    read(make(tmp_path))
