"""What identification and validation find, as frozen records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnimj.signals import Array, to_frame

PARAMETERS = ("mu_c", "mu_s", "V_s", "sigma_0", "sigma_1", "sigma_2")
"""The LuGre parameters in the order of the fit."""
UNITS: Mapping[str, str] = {
    "mu_c": "1",
    "mu_s": "1",
    "V_s": "m/s",
    "sigma_0": "1/m",
    "sigma_1": "s/m",
    "sigma_2": "s/m",
}
CONFIDENCE = 0.9
"""Of every interval and band."""


@dataclass(frozen=True)
class Estimate:
    """One parameter with its interval; an end that the data leave open is None."""

    name: str
    unit: str
    value: float
    low: float | None
    high: float | None

    @property
    def is_determined(self) -> bool:
        """Whether the data bound it on both sides."""
        return self.low is not None and self.high is not None


@dataclass(frozen=True)
class Direction:
    """A combination of parameters along which the data say little."""

    weights: Mapping[str, float]
    """Parameter → share of a relative change, a unit vector over the logarithms."""
    relative_spread: float
    """Standard deviation along it, as a relative change (1: a factor e)."""


@dataclass(frozen=True)
class Points:
    """Block means of the measurement by Eq. (4.26), for pictures."""

    slip: Array
    """V_r = r φ̇ − V, shape (n,) [m/s]."""
    ratio: Array
    """(m V̇ + F_rail + F_roll)/F_N, shape (n,) [1]."""
    model_slip: Array
    model_ratio: Array
    """The same two of the fitted model in the same blocks."""


@dataclass(frozen=True)
class SteadyCurve:
    """F/F_N over V_r once the bristle has settled, with its band."""

    slip: Array
    """Shape (n,) [m/s]."""
    ratio: Array
    low: Array
    high: Array
    level: Array
    """g(V_r), the curve without its viscous part, with its band [1]."""
    level_low: Array
    level_high: Array
    covered: tuple[float, float]
    """Slip over which the runs slide with a settled bristle [m/s]; the curve says nothing beyond it."""


@dataclass(frozen=True)
class RunResidual:
    """Measured − fitted of one run in blocks."""

    run: str
    time: Array
    """Block centres, shape (m,) [s]."""
    speed: Array
    """Of the carriage [m/s], NaN where nothing is fitted."""
    acceleration: Array
    """[m/s²]"""


@dataclass(frozen=True)
class IdentifiedFloor:
    """One floor's LuGre parameters out of all its runs together."""

    floor: str
    estimates: tuple[Estimate, ...]
    undetermined: tuple[str, ...]
    """One sentence each: what these runs cannot tell."""
    directions: tuple[Direction, ...]
    curve: SteadyCurve
    points: Points
    residuals: tuple[RunResidual, ...]
    runs: tuple[str, ...]
    masses: tuple[float, ...]
    left_out: tuple[str, ...]
    """Runs in which the carriage stood, or slip never left its ripple."""
    radius_scale: float
    """Rolling radius over the nominal one, fitted beside the floor."""
    rms: Mapping[str, float]
    """`carriage_speed` m/s, `carriage_acceleration` m/s² of block means; `traction_ratio` 1 of Eq. 4.26."""
    samples: int
    """Block means that were fitted."""
    effective_samples: float
    """What they are worth in independent ones."""
    clusters: int
    """Conditions (or stretches of runs) that count as independent."""

    def __getitem__(self, name: str) -> Estimate:
        return next(e for e in self.estimates if e.name == name)

    @property
    def numbers(self) -> dict[str, float]:
        """The LuGre law's parameters."""
        return {e.name: e.value for e in self.estimates}


@dataclass(frozen=True)
class Identification:
    """All floors of one dataset."""

    dataset: Path
    model: Path
    floors: tuple[IdentifiedFloor, ...]
    notes: tuple[str, ...]
    interrupted: bool = False
    """Whether Ctrl-C ended it; the floors are those that were finished."""

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame` with a row per floor and parameter: value, ends of the interval, unit."""
        found = [(floor.floor, estimate) for floor in self.floors for estimate in floor.estimates]
        columns = {
            name: [getattr(estimate, name) for _, estimate in found]
            for name in ("value", "low", "high", "unit")
        }
        names = {
            "floor": [floor for floor, _ in found],
            "parameter": [estimate.name for _, estimate in found],
        }
        return to_frame(names | columns)


@dataclass(frozen=True)
class ReplayedRun:
    """One measured run and what a plant made of its currents, at the control period."""

    run: str
    plant: str
    """`twin` or `planar`."""
    floor: str
    mass: float
    current: float
    """The run's set value [A]."""
    lateral_speed: float
    time: Array
    measured_speed: Array
    simulated_speed: Array
    """Of the carriage [m/s]; NaN where it is not measured."""
    measured_rim: Array
    simulated_rim: Array
    """r φ̇ [m/s]."""
    carriage_rms: float
    """[m/s]"""
    wheel_rms: float
    """[rad/s]"""


@dataclass(frozen=True)
class Cell:
    """One cell of the table: the runs of one condition."""

    floor: str
    mass: float
    lateral_speed: float
    current: float
    runs: tuple[str, ...]
    rms: Mapping[str, float]
    """Plant → RMS error of the carriage's speed over the runs [m/s]."""
    wheel_rms: Mapping[str, float]
    """Plant → RMS error of the wheel's speed [rad/s]."""
    published: tuple[float, ...]
    """What the dissertation has for it: Table 4.2; or Tables 4.3 and 4.4; empty when it has no such cell."""


@dataclass(frozen=True)
class Validation:
    """The table and the runs behind it."""

    dataset: Path
    model: Path
    effects: tuple[str, ...]
    """Effects that the model carries."""
    plants: tuple[str, ...]
    cells: tuple[Cell, ...]
    runs: tuple[ReplayedRun, ...]
    notes: tuple[str, ...]
    interrupted: bool = False

    def mean(self, plant: str) -> float:
        """Mean of the cells' RMS errors [m/s]."""
        return sum(cell.rms[plant] for cell in self.cells) / len(self.cells)
