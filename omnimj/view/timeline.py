"""The one timeline of a recording: simulated time."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

Array = NDArray[np.float64]


def time_column(time: Array) -> rr.TimeColumn:
    """Simulated time [s], for the rows that are sent with it."""
    whole = np.round(1e9 * np.asarray(time)).astype("timedelta64[ns]")  # a float would be cut off, 4.0999…
    return rr.TimeColumn("time", duration=whole)
