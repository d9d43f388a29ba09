"""The timelines of recordings: simulated time; one per run where a recording holds several."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

Array = NDArray[np.float64]


def time_column(time: Array, timeline: str = "time") -> rr.TimeColumn:
    """Simulated time [s], for the rows that are sent with it, on the timeline of that name."""
    whole = np.round(1e9 * np.asarray(time)).astype("timedelta64[ns]")  # a float would be cut off, 4.0999…
    return rr.TimeColumn(timeline, duration=whole)
