"""Records of identification and validation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnimj.display import Displayed
from omnimj.signals import Array, to_frame

PARAMETERS = ("mu_c", "mu_s", "V_s", "sigma_0", "sigma_1", "sigma_2")
"""LuGre parameters in the order of the fit."""
UNITS: Mapping[str, str] = {
    "mu_c": "1",
    "mu_s": "1",
    "V_s": "m/s",
    "sigma_0": "1/m",
    "sigma_1": "s/m",
    "sigma_2": "s/m",
}
CONFIDENCE = 0.9
"""Level of every interval and band."""


@dataclass(frozen=True)
class Estimate:
    """Parameter with its interval; an end is None if the data do not bound it."""

    name: str
    unit: str
    value: float
    low: float | None
    high: float | None

    @property
    def is_determined(self) -> bool:
        """True if the data bound the parameter on both sides."""
        return self.low is not None and self.high is not None


@dataclass(frozen=True)
class Points:
    """Block means of the measurement by Eq. (4.26), for plots."""

    slip: Array
    """V_r = r φ̇ − V, shape (n,) [m/s]."""
    ratio: Array
    """(m V̇ + F_rail + F_roll)/F_N, shape (n,) [1]."""
    model_slip: Array
    """Slip V_r of the fitted model in the same blocks, shape (n,) [m/s]."""
    model_ratio: Array
    """F/F_N of the fitted model in the same blocks, shape (n,) [1]."""


@dataclass(frozen=True)
class SteadyCurve:
    """F/F_N over V_r with a settled bristle, with its band; all arrays have shape (n,)."""

    slip: Array
    """V_r [m/s]."""
    ratio: Array
    """F/F_N [1]; `low` and `high` bound its band."""
    low: Array
    high: Array
    level: Array
    """g(V_r) [1], the curve without its viscous part; `level_low` and `level_high` bound its band."""
    level_low: Array
    level_high: Array
    covered: tuple[float, float]
    """Slip over which the runs slide with a settled bristle [m/s]; beyond it the curve is not determined."""


@dataclass(frozen=True)
class RunResidual:
    """Measured − fitted of one run in blocks."""

    run: str
    time: Array
    """Block centres, shape (m,) [s]."""
    speed: Array
    """Residual of the carriage speed, shape (m,) [m/s]; NaN where nothing is fitted."""
    acceleration: Array
    """Residual of the carriage acceleration, shape (m,) [m/s²]; NaN where nothing is fitted."""


@dataclass(frozen=True)
class IdentifiedFloor:
    """LuGre parameters of one floor, from all its runs together."""

    floor: str
    estimates: tuple[Estimate, ...]
    undetermined: tuple[str, ...]
    """One sentence for each aspect that the runs leave open."""
    curve: SteadyCurve
    points: Points
    residuals: tuple[RunResidual, ...]
    runs: tuple[str, ...]
    masses: tuple[float, ...]
    left_out: tuple[str, ...]
    """Runs in which the carriage stood, or slip never exceeded its ripple."""
    radius_scale: float
    """Rolling radius over the nominal one, fitted together with the floor."""
    rms: Mapping[str, float]
    """RMS residual of the block means of `carriage_speed` [m/s], `carriage_acceleration` [m/s²] and
    `traction_ratio` [1], the last by Eq. (4.26)."""
    samples: int
    """Number of fitted block means."""
    effective_samples: float
    """Equivalent number of independent samples."""
    clusters: int
    """Number of conditions (or stretches of runs) that count as independent."""

    def __getitem__(self, name: str) -> Estimate:
        return next(e for e in self.estimates if e.name == name)

    @property
    def numbers(self) -> dict[str, float]:
        """Parameters of the LuGre law."""
        return {e.name: e.value for e in self.estimates}


@dataclass(frozen=True)
class Identification(Displayed):
    """All floors of one dataset."""

    dataset: Path
    model: Path
    floors: tuple[IdentifiedFloor, ...]
    notes: tuple[str, ...]
    interrupted: bool = False
    """True if Ctrl-C ended the identification; `floors` are those completed until then."""

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
    """Measured run and a plant driven by its currents, at the control period."""

    run: str
    plant: str
    """`twin` or `planar`."""
    floor: str
    mass: float
    current: float
    """Set value of the run [A]."""
    lateral_speed: float
    time: Array
    """Sample times, shape (k,) [s]."""
    measured_speed: Array
    """Measured carriage speed, shape (k,) [m/s]; NaN where masked."""
    simulated_speed: Array
    """Simulated carriage speed, shape (k,) [m/s]."""
    carriage_rms: float
    """RMS error of the carriage speed [m/s]."""
    wheel_rms: float
    """RMS error of the wheel speed [rad/s]."""


@dataclass(frozen=True)
class Cell:
    """Cell of the validation table: the runs of one condition."""

    floor: str
    mass: float
    lateral_speed: float
    current: float
    runs: tuple[str, ...]
    rms: Mapping[str, float]
    """Plant → RMS error of the carriage speed over the runs [m/s]."""
    wheel_rms: Mapping[str, float]
    """Plant → RMS error of the wheel speed [rad/s]."""
    published: tuple[float, ...]
    """Values of the dissertation: Table 4.2, or Tables 4.3 and 4.4; empty without such a cell."""


@dataclass(frozen=True)
class Validation(Displayed):
    """Validation table and the runs behind it."""

    dataset: Path
    model: Path
    effects: tuple[str, ...]
    """Effects of the model."""
    plants: tuple[str, ...]
    cells: tuple[Cell, ...]
    runs: tuple[ReplayedRun, ...]
    notes: tuple[str, ...]
    interrupted: bool = False

    def mean(self, plant: str) -> float:
        """Mean of the cells' RMS errors [m/s]."""
        return sum(cell.rms[plant] for cell in self.cells) / len(self.cells)
