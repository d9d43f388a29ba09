"""The truth about faults for `metrics.json`: those by time from the scenario, those by place from the run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from omnimj.plant.patches import Patch
from omnimj.signals import Array, Trace


def patch_records(
    trace: Trace, patches: Sequence[Patch], floor: str, wheel_positions: Array
) -> list[dict[str, Any]]:
    """When each wheel's contact was on another floor than the scenario's, as slip faults.

    The contact of wheel i lies at (x, y) + R(heading) p_i. Where patches overlap, the last one counts.

    Args:
      trace: With the truth columns `x`, `y`, `heading`; without them there is no telling, and no record.
      patches: As in the scenario.
      floor: The scenario's own floor; a patch of the same floor is no fault.
      wheel_positions: p_i, shape (n, 2) [m].

    Returns:
      `{kind: "slip", wheel, onset, end, floor}` per stay on a patch, by onset; `end` is None when the run
      ends on it.
    """
    if not patches or not {"x", "y", "heading"} <= set(trace.columns):
        return []
    time = trace["time"]
    cos, sin = np.cos(trace["heading"]), np.sin(trace["heading"])
    names = [floor, *(patch.floor for patch in patches)]
    records = []
    for wheel, (p_x, p_y) in enumerate(wheel_positions, start=1):
        contact = np.column_stack(
            [trace["x"] + cos * p_x - sin * p_y, trace["y"] + sin * p_x + cos * p_y],
        )
        under = np.zeros(len(time), int)
        for patch in patches:
            under[patch.covers(contact)] = names.index(patch.floor) if patch.floor != floor else 0
        for value, first, last in _stays(under):
            if value:
                end = float(time[last + 1]) if last + 1 < len(time) else None
                onset = float(time[first])
                records.append(
                    {"kind": "slip", "wheel": wheel, "onset": onset, "end": end, "floor": names[value]}
                )
    return sorted(records, key=lambda record: (record["onset"], record["wheel"]))


def _stays(values: Array) -> list[tuple[int, int, int]]:
    """Runs of equal values as (value, first row, last row)."""
    if not len(values):
        return []
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    ends = np.concatenate([starts[1:], [len(values)]]) - 1
    return [(int(values[a]), int(a), int(b)) for a, b in zip(starts, ends, strict=True)]
