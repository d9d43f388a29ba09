"""Records of a robot's measured drives and their simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from omnimj.display import Displayed
from omnimj.signals import Array


@dataclass(frozen=True)
class Motion:
    """Motion of a robot with n wheels at k samples of a run."""

    pose: Array
    """x, y [m] and unwrapped heading [rad], shape (k, 3); NaN where unknown."""
    currents: Array
    """Shape (k, n) [A]; NaN where unknown."""


@dataclass(frozen=True)
class DrivenRun:
    """Measured run and a plant whose wheels turned alike."""

    run: str
    plant: str
    """`twin`, `planar` or `rolling`."""
    floor: str
    time: Array
    """Sample times, shape (k,) [s]."""
    wheel_speed: Array
    """Wheel speeds that the plant followed, shape (k, n) [rad/s]."""
    measured: Motion
    simulated: Motion
    """As camera and monitors of the model show it, from the measured start on."""
    counted_from: float
    """Time from which means are taken [s]."""


@dataclass(frozen=True)
class RunNumbers:
    """Differences between a measured run and its simulation."""

    run: str
    plant: str
    floor: str
    wheel_rolling: float
    """Mean speed of the body by its wheels without slip [m/s]."""
    measured: Array
    """Mean velocity ahead and to the left [m/s], and yaw rate [rad/s], shape (3,)."""
    simulated: Array
    """The same, simulated, shape (3,)."""
    measured_currents: Array
    """Mean currents, shape (n,) [A]; NaN for wheels that hardly turned."""
    simulated_currents: Array
    """The same, simulated, shape (n,); NaN where the plant has no motors."""
    path: float
    """Length of the measured path [m]."""
    end_by_measured_heading: float
    """Distance of the ends of measured path and simulated velocities along the measured heading [m]."""
    end_by_own_heading: float
    """Distance of the ends of the measured and the simulated path [m]."""


@dataclass(frozen=True)
class Group:
    """Runs on one floor at one speed, with one plant."""

    floor: str
    plant: str
    runs: tuple[str, ...]
    wheel_rolling: float
    """Mean speed of the body by its wheels without slip [m/s]."""
    measured_speed: float
    """Mean over the runs [m/s]."""
    simulated_speed: float
    velocity_error: float
    """RMS over runs of the vector error of a run's mean velocity, over the mean measured speed [1]; NaN for
    turning on the spot."""
    current_error: Array
    """RMS over runs of the error of a run's mean current, shape (n,) [A]; NaN where unknown."""
    measured_current: Array
    """RMS over runs of the measured mean current, shape (n,) [A]."""
    measured_yaw_rate: float
    """RMS over runs of the measured mean yaw rate [rad/s]."""
    yaw_rate_error: float
    """RMS over runs of its error [rad/s]."""
    end_by_measured_heading: float
    """Median over runs, over the length of the path [1]."""
    end_by_own_heading: float
    """Median over runs, over the length of the path [1]."""


@dataclass(frozen=True)
class DriveValidation(Displayed):
    """Measured drives of a robot and their simulation."""

    dataset: Path
    model: Path
    effects: tuple[str, ...]
    """Effects of the model."""
    plants: tuple[str, ...]
    """Simulated plants, then `rolling`."""
    groups: tuple[Group, ...]
    numbers: tuple[RunNumbers, ...]
    runs: tuple[DrivenRun, ...]
    marker: Mapping[str, Mapping[str, float | None]]
    """Plant → floor → angle by which the marker is turned on the robot [rad]; None where runs are too few to
    tell it."""
    marker_notes: tuple[str, ...]
    """Sentences on these angles, one for each floor."""
    notes: tuple[str, ...]
    """Sentences on masked samples."""
    interrupted: bool = False
    """True if Ctrl-C ended the work; `runs` are those completed until then."""
