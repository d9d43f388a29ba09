"""Small datasets on disk, whole or broken, for tests of their readers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from omnimj.signals import Array

RIG = """plant = "quarter_rig"
[defaults]
floor = "natural_stone"
mass = 3.9593
"""


def rig_columns(rows: int = 60) -> dict[str, Array]:
    """A carriage that is driven to and fro, with a little noise in every channel."""
    time = np.array(range(rows), float) / 100.0
    noise: Array = np.random.default_rng(3).normal(size=(5, rows)) * 0.002
    speed = np.sin(2.0 * time)
    return {
        "time": time,
        "current": np.cos(2.0 * time) + noise[0],
        "wheel_speed": 20.0 * speed + noise[1],
        "carriage_speed": speed + noise[2],
        "carriage_acceleration": 2.0 * np.cos(2.0 * time) + noise[3],
        "lateral_speed": noise[4],
    }


def robot_columns(rows: int = 60) -> dict[str, Array]:
    """A robot that turns on the spot through a full turn."""
    time = np.array(range(rows), float) / 100.0
    names = [f"{name}_{i}" for name in ("current", "wheel_speed") for i in range(1, 5)]
    rate = 2.0 * np.pi / time[-1]
    columns = {"time": time, **{name: np.sin(time + k) for k, name in enumerate(names)}}
    columns |= {"acceleration_x": np.cos(time), "acceleration_y": np.sin(3.0 * time)}
    return columns | {"yaw_rate": np.full(rows, rate), "yaw": (1.0 + rate * time) % (2.0 * np.pi)}


def axis_columns(rows: int = 60) -> dict[str, Array]:
    """A carriage on a guide."""
    time = np.array(range(rows), float) / 100.0
    return {"time": time, "force": np.sin(time), "position": np.cos(time)}


def csv_text(columns: dict[str, Array]) -> str:
    """Header and rows."""
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def write_parquet(path: Path, columns: dict[str, Array]) -> None:
    """A file as any other program would write it."""
    pq.write_table(pa.table({name: pa.array(values) for name, values in columns.items()}), path)


def write_rig(folder: Path, toml: str = RIG, **runs: dict[str, Array] | str) -> Path:
    """A dataset folder; a run is given by its columns or by the text of its file; one good run if none is."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "dataset.toml").write_text(toml, encoding="utf-8")
    for name, run in (runs or {"stone_090": rig_columns()}).items():
        text = run if isinstance(run, str) else csv_text(run)
        (folder / f"{name}.csv").write_text(text, encoding="utf-8", newline="")
    return folder
