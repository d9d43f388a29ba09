"""What a way to diagnose gives and gets: it rides beside the cascade and may change what that does.

A method sees measurements only, so the same object runs in a controller, over recorded logs and on hardware.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from omnimj.errors import InputError, UnknownNameError
from omnimj.signals import Array, Diagnosis


@dataclass(frozen=True, slots=True)
class Reconfiguration:
    """What recovery changes in the cascade: φ̇_target = clip(B·twist/r + offset, lowest, highest)."""

    speed_per_twist: Array
    """B/r, shape (n, 3): the inverse kinematics in use."""
    current_scale: Array
    """Factor on every set current, shape (n,): 1/(what is left of the torque constant); 0 gives a motor
    up."""
    offset: Array
    """Shape (n,) [rad/s]."""
    lowest: Array
    """Shape (n,) [rad/s]."""
    highest: Array
    """Shape (n,) [rad/s]."""
    trusts_gyro: bool = True
    """False: the wheels say how fast the robot turns, since the gyro lies."""
    holds_heading: bool = False
    """The heading is held, whether the scenario asked for it or not."""
    brake: tuple[int, ...] = ()
    """Wheels 1…n whose motors are shorted."""


def nominal_reconfiguration(speed_per_twist: Array) -> Reconfiguration:
    """Nothing but an inverse kinematics B/r, shape (n, 3)."""
    n = len(speed_per_twist)
    endless = np.full(n, np.inf)
    return Reconfiguration(speed_per_twist, np.ones(n), np.zeros(n), -endless, endless)


@dataclass(frozen=True, slots=True)
class FaultEstimate:
    """What a method holds for true of the robot now, for recovery to act upon; n wheels."""

    losses: Array
    """Share of the torque constant that is gone, of motors that are diagnosed; 0 of others. Shape (n,)."""
    dead: NDArray[np.bool_]
    """Motors that give nothing, shape (n,)."""
    runaway: NDArray[np.bool_]
    """Motors that push as they please, shape (n,)."""
    held: NDArray[np.bool_]
    """Wheels that do not turn, shape (n,)."""
    slipping: NDArray[np.bool_]
    """Shape (n,); all of them when the whole floor gives way."""
    velocity: Array
    """Of the body, in the body frame, shape (2,) [m/s]."""
    force: Array
    """Traction of the wheels as their motors tell, shape (n,) [N]."""
    decided: float
    """Time of the newest decision [s]; −∞: none."""
    trusts_gyro: bool = True
    """False: the gyro lies."""

    @property
    def available(self) -> NDArray[np.bool_]:
        """Wheels whose motors can be counted upon, shape (n,)."""
        return ~(self.dead | self.runaway | self.held)

    @property
    def is_healthy(self) -> bool:
        """Whether there is nothing to recover from."""
        wrong = self.dead | self.runaway | self.held | self.slipping | (self.losses != 0.0)
        return self.trusts_gyro and not wrong.any()

    def same_faults_as(self, other: FaultEstimate) -> bool:
        """Whether both hold the same parts for broken in the same way, whatever the sizes."""
        return bool(
            self.trusts_gyro == other.trusts_gyro
            and np.array_equal(self.dead, other.dead)
            and np.array_equal(self.runaway, other.runaway)
            and np.array_equal(self.held, other.held)
            and np.array_equal(self.slipping, other.slipping)
            and np.array_equal(self.losses != 0.0, other.losses != 0.0)
        )


class DetectorState(Protocol):
    """What a method carries from one step to the next."""

    @property
    def log(self) -> Array:
        """Numbers of the last step, aligned with the method's `log_names`."""
        ...

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Everything decided since the start, in that order; what was taken back has its `cleared`."""
        ...

    @property
    def reconfiguration(self) -> Reconfiguration | None:
        """For the cascade's next command, of a method that recovers by itself."""
        ...

    @property
    def fault_estimate(self) -> FaultEstimate | None:
        """For a recovery beside the method; None: the method leaves nothing to it."""
        ...


class FaultDetector(Protocol):
    """State goes in and comes out; never an exception, whatever the sensors say."""

    @property
    def log_names(self) -> tuple[str, ...]:
        """Columns of the trace: `residual_…`, `threshold_…`, `effectiveness_1…n`, `mode`, ….

        A residual has its threshold beside it under the same ending: `residual_force_x`, `threshold_force_x`.
        """
        ...

    def start(self, measurement: Any) -> Any:
        """The state before the first step; `measurement` is the first one."""
        ...

    def step(
        self,
        state: Any,
        measurement: Any,
        command: Array | None = None,
        bias: float = 0.0,
    ) -> Any:
        """The state after a measurement.

        Args:
          state: From the step before.
          measurement: The newest: `Measurement` of a robot, `RigMeasurement` of the rig.
          command: Set currents of the period that it ends, shape (n,) [A]; None where nobody knows.
          bias: What the gyro is believed to read at rest [rad/s].
        """
        ...


# Which form of a method: equations and thresholds of the published one, what the robust one may do.

VARIANTS = ("repaired", "printed")
THRESHOLD_SETS = ("fault_free", "printed")


@dataclass(frozen=True, slots=True)
class DetectorOptions:
    """The form of a method."""

    variant: str = VARIANTS[0]
    """`repaired`, or `printed`: with the signs as in the text."""
    thresholds: str = THRESHOLD_SETS[0]
    """`fault_free`, from runs of the twin, or `printed`: those of the author's machines."""

    recovery: bool = True
    """Whether anything is done about a fault: the weights of chapter 6, or `control.recovery`. Without it the
    method only watches, as in the tests of chapter 5."""
    self_test: bool = False
    """Robust: wheels are driven against each other before the plan begins, which waits for it."""
    dither: bool = True
    """Robust: the same, less, while a slow robot tells nothing about its motors."""

    @property
    def printed(self) -> bool:
        """Whether the equations are as printed."""
        return self.variant == "printed"


OPTION_FLAGS = ("recovery", "self_test", "dither")
"""Keys that are true or false."""


def checked_options(
    variant: object, thresholds: object, flags: Mapping[str, object], place: str
) -> DetectorOptions:
    """A choice as a file has it.

    Args:
      variant: Of `VARIANTS`.
      thresholds: Of `THRESHOLD_SETS`.
      flags: Some of `OPTION_FLAGS`.
      place: Where they stand, for messages.

    Raises:
      UnknownNameError: No such variant or set of thresholds.
      InputError: A flag is neither true nor false.
    """
    if variant not in VARIANTS:
        raise UnknownNameError(f"{place}.variant", "variant", variant, VARIANTS)
    if thresholds not in THRESHOLD_SETS:
        raise UnknownNameError(f"{place}.thresholds", "set of thresholds", thresholds, THRESHOLD_SETS)
    for name, value in flags.items():
        if not isinstance(value, bool):
            raise InputError(f"{place}.{name}", f"found {value!r}", "must be true or false")
    return DetectorOptions(
        str(variant), str(thresholds), **{name: bool(value) for name, value in flags.items()}
    )
