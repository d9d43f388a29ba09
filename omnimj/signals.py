"""Signals between plant and controller: frozen records, arrays of n wheels, SI units.

Wheels are numbered 1…n in files and messages, 0…n−1 in arrays.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnimj.display import Displayed
from omnimj.errors import MissingLibrary

Array = NDArray[np.float64]


RIG_CHANNELS = ("current", "wheel_speed", "carriage_speed", "carriage_acceleration", "lateral_speed")
"""Measured channels of the test rig, as recordings and sensor faults name them: A, rad/s, m/s, m/s², m/s."""


def robot_channels(wheels: int) -> tuple[str, ...]:
    """Measured channels of a robot with n wheels, as recordings and sensor faults name them.

    Currents (n) [A], wheel speeds (n) [rad/s], acceleration x and y [m/s²], yaw rate [rad/s], yaw [rad].
    """
    per_wheel = [f"{name}_{i}" for name in ("current", "wheel_speed") for i in range(1, wheels + 1)]
    return (*per_wheel, "acceleration_x", "acceleration_y", "yaw_rate", "yaw")


@dataclass(frozen=True, slots=True)
class Measurement:
    """Readings of the robot's sensors at one instant; a controller sees nothing else."""

    time: float
    """Time of the sample [s]."""
    current: Array
    """Motor currents from the amplifiers' monitors, shape (n,) [A]."""
    wheel_speed: Array
    """Wheel speeds after the gear, shape (n,) [rad/s]."""
    acceleration: Array
    """Body-frame acceleration at the centre, x and y, shape (2,) [m/s²]."""
    yaw_rate: float
    """Gyro [rad/s]."""
    yaw: float
    """Heading from the converter, wrapped to [0, 2π) [rad]."""


@dataclass(frozen=True, slots=True)
class RigMeasurement:
    """Readings of the test rig's sensors at one instant."""

    time: float
    """Time of the sample [s]."""
    current: float
    """Motor current monitor [A]."""
    wheel_speed: float
    """Wheel speed after the gear [rad/s]."""
    carriage_speed: float
    """Speed along the rail from the rail wheel's encoder [m/s]."""
    carriage_acceleration: float
    """Accelerometer along the rail [m/s²]."""
    lateral_speed: float
    """Speed of the gantry sideways [m/s]."""


@dataclass(frozen=True, slots=True)
class CurrentCommand:
    """Current set values for the amplifiers."""

    current: Array
    """Shape (n,) [A]."""
    brake: tuple[int, ...] = ()
    """Wheels 1…n whose motor a relay takes from its amplifier and shorts."""


def compiled_in(loop: str) -> Callable[[Any], Any]:
    """Decorator of a method that a compiled loop of this name replaces by its kernel.

    A subclass or a test that overrides the method has no such mark, and is driven step by step.
    """

    def mark(method: Any) -> Any:
        method.compiled_in = loop
        return method

    return mark


KINDS_OF_DIAGNOSIS = ("slip", "motor", "locked", "free", "hard_over", "all_wheel_slip", "sensor")
"""Kinds of faults that a diagnosis can name."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """One diagnosed fault, since its decision."""

    time: float
    """Time of the decision [s]."""
    kind: str
    """One of `KINDS_OF_DIAGNOSIS`."""
    wheels: tuple[int, ...]
    """Its wheels 1…n; empty for sensors of the body and for all wheels at once."""
    confidence: float
    """0…1; its scale is the method's own."""
    ambiguous_with: tuple[str, ...] = ()
    """Other faults with the same evidence, as `motor 3`."""
    effectiveness: float | None = None
    """Share 0…1 of the wheel's drive or grip that is left; None: unknown."""
    cleared: float | None = None
    """Time of its withdrawal [s]; None: active."""
    channel: str = ""
    """The sensor channel, for kind `sensor`."""
    test: str = ""
    """The test that decided, one of the method's own; empty: the method has one test per kind."""
    statistic: float | None = None
    """Value of the test's statistic at the decision, in its unit; None: unknown."""
    threshold: float | None = None
    """Value from which the test decides, in the same unit; None: unknown."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Planned motion, sampled at every control step (k samples).

    Velocities and positions are in the world frame, since a person plans there.
    """

    time: Array
    """Shape (k,) [s]."""
    velocity: Array
    """Shape (k, 2) [m/s]."""
    yaw_rate: Array
    """Shape (k,) [rad/s]."""
    heading: Array
    """Planned heading, unwrapped, shape (k,) [rad]."""
    position: Array
    """Planned position of the centre, shape (k, 2) [m]."""
    is_path: bool = False
    """Whether `position` is a path that must be followed (its error is then judged)."""


@dataclass(frozen=True, slots=True)
class Trace(Displayed):
    """One run as columns, one row per control step (the columns of `trace.parquet`).

    `trace["x"]` and `trace.wheels("current")` are NumPy arrays; `plot("x", "current")` draws columns.
    Libraries that read Arrow take a trace as it is: `polars.DataFrame(trace)`, `pyarrow.table(trace)`.
    """

    columns: Mapping[str, Array]
    """Column name to array of shape (k,)."""
    about: Mapping[str, Any] = field(default_factory=dict)
    """Description of the run: scenario, plant, method, seed, floor, realtime_factor, …"""

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def wheels(self, name: str) -> Array:
        """Columns `name_1 … name_n` stacked, shape (k, n)."""
        found = []
        while f"{name}_{len(found) + 1}" in self.columns:
            found.append(self.columns[f"{name}_{len(found) + 1}"])
        if not found:
            raise KeyError(name)
        return np.stack(found, axis=1)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def to_arrow(self) -> Any:
        """A `pyarrow.Table` of the columns, without a copy, with `about` as JSON in its metadata."""
        import pyarrow

        metadata = {"omnimj": json.dumps(dict(self.about))}
        return pyarrow.table(dict(self.columns), metadata=metadata)

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        """Arrow's interface between libraries, by which they read a trace."""
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame` of the columns, indexed by `time`.

        Raises:
          MissingLibrary: pandas is not installed.
        """
        return to_frame(self.columns)

    def to_polars(self) -> Any:
        """A `polars.DataFrame` of the columns.

        Raises:
          MissingLibrary: polars is not installed.
        """
        return to_polars(self.to_arrow())


def true_stretches(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """First row and row after the last of each stretch in which a mask of shape (k,) holds, shape (m, 2)."""
    return np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))).reshape(-1, 2)


def equal_stretches(values: NDArray[Any]) -> NDArray[np.intp]:
    """First row of each stretch of equal values of a signal of shape (k,), shape (m,)."""
    return np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1))


def to_frame(columns: Mapping[str, Any]) -> Any:
    """A `pandas.DataFrame` of columns of equal length, indexed by `time` where there is such a column.

    Raises:
      MissingLibrary: pandas is not installed.
    """
    try:
        import pandas
    except ModuleNotFoundError:
        raise MissingLibrary("to_pandas", "pandas", "pandas") from None
    frame = pandas.DataFrame(dict(columns))
    return frame.set_index("time") if "time" in frame else frame


def to_polars(table: Any) -> Any:
    """A `polars.DataFrame` of a `pyarrow.Table`.

    Raises:
      MissingLibrary: polars is not installed.
    """
    try:
        import polars
    except ModuleNotFoundError:
        raise MissingLibrary("to_polars", "polars", "polars") from None
    return polars.from_arrow(table)


@dataclass(frozen=True, slots=True)
class Target:
    """Demanded motion in the world frame, held for one control step."""

    velocity: Array
    """Shape (2,) [m/s]."""
    yaw_rate: float
    """Counter-clockwise [rad/s]."""
    heading: float
    """Planned heading [rad]."""


def target_at(reference: Reference, step: int) -> Target:
    """Sample of the reference for one control step; past its end the target is to stand still.

    Args:
      reference: The planned motion, k samples.
      step: Number of the control step, 0 at the start.
    """
    last = len(reference.time) - 1
    if step > last:
        return Target(reference.velocity[last] * 0.0, 0.0, float(reference.heading[last]))
    return Target(reference.velocity[step], float(reference.yaw_rate[step]), float(reference.heading[step]))
