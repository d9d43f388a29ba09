"""Records of an identified robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from omnimj.display import Displayed
from omnimj.estimate.robot.fit import RobotFit
from omnimj.parameters import Robot
from omnimj.signals import Array

NOT_EXCITED = 0.7
"""Ratio of posterior to prior standard deviation from which the drive has not excited a number."""
MOSTLY_PRIOR = 0.5
"""The same from which a number rests on the prior as much as on the data."""


@dataclass(frozen=True)
class RobotEstimate:
    """One identified number with its 90 % interval."""

    name: str
    """`torque_constant_1`, `mass`, …, as in `identification.json`."""
    words: str
    """Description of the number."""
    unit: str
    value: float
    low: float
    high: float
    nominal: float
    """Value of the model file that the identification began with."""
    left_of_prior: float
    """Ratio of posterior to prior standard deviation, 0 … 1."""

    @property
    def source(self) -> str:
        """`data`, `data and prior` or `prior`: what determines the value."""
        if self.left_of_prior > NOT_EXCITED:
            return "prior"
        return "data and prior" if self.left_of_prior > MOSTLY_PRIOR else "data"


@dataclass(frozen=True)
class Unexcited:
    """A number that the drive did not excite, and the manoeuvre that would be most informative about it."""

    estimate: RobotEstimate
    manoeuvre: str
    """In words; empty if no manoeuvre tells more than half of what the prior leaves open."""
    left_after: float
    """Deviation over that of the prior once the manoeuvre has been driven."""


@dataclass(frozen=True)
class CreepForm:
    """One form of the law between traction and slip, fitted to a floor's runs."""

    name: str
    """`slip speed`, `slip speed, saturating`, `creep ratio` or `creep ratio, saturating`."""
    numbers: Mapping[str, float]
    """`slope` [s/m] or [1] at no slip, `ceiling` [1] where it saturates, `load_exponent` [1]."""
    held_out: float
    """RMS error of the slip in runs that were not fitted [m/s]."""


@dataclass(frozen=True)
class FloorCreep:
    """Creep of the wheels on one floor."""

    floor: str
    chosen: CreepForm
    forms: tuple[CreepForm, ...]
    """All forms, best first."""
    intervals: Mapping[str, tuple[float, float]]
    """Ends of the 90 % intervals of the chosen form's numbers."""
    covered: float
    """Slip below which 98 % of the samples lie [m/s]."""
    moves: int
    """Drives from rest to rest that were used."""
    runs: tuple[str, ...]


@dataclass(frozen=True)
class RobotIdentification(Displayed):
    """Identification of a robot from its logs."""

    dataset: Path
    robot: Robot
    """The robot of the model file that the identification began with."""
    fit: RobotFit
    estimates: tuple[RobotEstimate, ...]
    unexcited: tuple[Unexcited, ...]
    floors: tuple[FloorCreep, ...]
    without_creep: tuple[str, ...]
    """Sentences on floors whose creep cannot be identified, one each."""
    noise: Mapping[str, float]
    """Noise and biases of the sensors as seen in the logs, by name with unit."""
    seconds: float
    """Duration of the runs [s]."""
    residual: Array
    """RMS misfit of the accelerations: a_x, a_y [m/s²], ω̇ [rad/s²]."""
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> RobotEstimate:
        return next(one for one in self.estimates if one.name == name)

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs."""
        return tuple(run.name for run in self.fit.runs)
