"""Logs of the foreign robot as a dataset on disk, and moments at which a fault can show at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from .foreign_drive import Log


def write_dataset(
    folder: Path,
    logs: Mapping[str, Log],
    floor: str = "natural_stone",
    *,
    plant: str = "uto_robot",
    description: str = "",
) -> None:
    """Writes `dataset.toml` and one Parquet table per log; nothing of the truth.

    All logs must be of one kind: with an inertial unit, or with a measured pose.
    """
    kinds = {log.pose_measured for log in logs.values()}
    if len(kinds) != 1:
        raise ValueError("a dataset has logs of one kind")
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f'plant = "{plant}"']
    if description:
        lines.append(f'description = "{description}"')
    lines += ["", "[defaults]", f'floor = "{floor}"']
    if kinds.pop():
        lines.append("pose_measured = true")
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n")
    for name, log in logs.items():
        pq.write_table(pa.table(log.columns), folder / f"{name}.parquet")


def loaded_moment(log: Log, wheel: int, grip: float, lasting: float, earliest: float) -> tuple[float, float]:
    """When a patch of low grip must lie to be felt by a wheel.

    Args:
      log: A healthy drive.
      wheel: 1 … 4.
      grip: Traction over load that the patch can carry at most.
      lasting: Length of the patch [s].
      earliest: It begins no sooner than this [s].

    Returns:
      Onset of the window in which the healthy wheel asks for more than `grip` for the longest time [s], and
      that time [s].
    """
    truth = log.truth
    asks = np.abs(truth[f"traction_{wheel}"]) > grip * truth[f"normal_{wheel}"]
    tick = truth["time"][1]
    sums = np.concatenate([[0.0], np.cumsum(asks) * tick])
    width = round(lasting / tick)
    times = sums[width:] - sums[:-width]
    times[: round(earliest / tick)] = -1.0
    best = int(np.argmax(times))
    return best * tick, float(times[best])
