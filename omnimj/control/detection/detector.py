"""Interface of a fault detector: its options, its state, and the fault estimate that recovery acts upon.

A detector sees measurements only, so the same object runs in a controller, over recorded logs and on
hardware.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from omnimj.control.cascade.controller import Reconfiguration
from omnimj.control.records import Record, copied, opened
from omnimj.signals import Array, Diagnosis

VARIANTS = ("repaired", "printed")
THRESHOLD_SETS = ("fault_free", "printed")
OPTION_FLAGS = ("recovery", "self_test", "dither")
"""Names of the options that are true or false."""


class FaultEstimate(NamedTuple):
    """Present faults of a robot with n wheels, for recovery to act upon."""

    losses: Array
    """Lost share of the torque constant of diagnosed motors; 0 for others. Shape (n,)."""
    dead: NDArray[np.bool_]
    """Motors without torque, shape (n,)."""
    runaway: NDArray[np.bool_]
    """Motors that do not follow their set currents, shape (n,)."""
    held: NDArray[np.bool_]
    """Wheels that do not turn, shape (n,)."""
    slipping: NDArray[np.bool_]
    """Slipping wheels, shape (n,); all of them when the whole floor gives way."""
    velocity: Array
    """Body velocity in the body frame, shape (2,) [m/s]."""
    force: Array
    """Traction of the wheels from their motors, shape (n,) [N]."""
    decided: float
    """Time of the newest decision [s]; −∞: none."""
    trusts_gyro: bool = True
    """False: the gyro is faulty."""

    @classmethod
    def unpack(cls, record: Record) -> FaultEstimate:
        """Copy of a packed estimate."""
        fields = opened(copied(record), cls)
        masks = ("dead", "runaway", "held", "slipping")
        return fields._replace(
            decided=float(fields.decided),
            trusts_gyro=bool(fields.trusts_gyro),
            **{name: getattr(fields, name).astype(bool) for name in masks},
        )

    @property
    def available(self) -> NDArray[np.bool_]:
        """Mask of the wheels whose motors follow their set currents, shape (n,)."""
        return ~(self.dead | self.runaway | self.held)

    @property
    def is_healthy(self) -> bool:
        """True if there is nothing to recover from."""
        wrong = self.dead | self.runaway | self.held | self.slipping | (self.losses != 0.0)
        return self.trusts_gyro and not wrong.any()

    def same_faults_as(self, other: FaultEstimate) -> bool:
        """True if the same parts have the same kinds of faults, whatever their sizes."""
        return self._kinds() == other._kinds()

    def _kinds(self) -> tuple[object, ...]:
        """Parts that have faults, by kind of fault."""
        masks = (self.losses != 0.0, self.dead, self.runaway, self.held, self.slipping)
        return (self.trusts_gyro, *(mask.tolist() for mask in masks))


class DetectorState(Protocol):
    """State of a detector between two steps."""

    @property
    def log(self) -> Array:
        """Signals of the last step by the detector's `log_names`, shape (len(log_names),)."""
        ...

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Everything decided since the start, in that order; a withdrawn diagnosis has its `cleared`."""
        ...

    @property
    def reconfiguration(self) -> Reconfiguration | None:
        """Change of the cascade's next command by a detector that recovers by itself; None without one."""
        ...

    @property
    def fault_estimate(self) -> FaultEstimate | None:
        """Estimate for a recovery beside the detector; None if the detector recovers by itself."""
        ...


class FaultDetector(Protocol):
    """Detector beside a controller: state goes in and comes out; no good measurement raises an exception."""

    @property
    def log_names(self) -> tuple[str, ...]:
        """Columns of the trace: `residual_…`, `threshold_…`, `effectiveness_1…n`, `mode`, ….

        A residual has its threshold beside it under the same ending: `residual_force_x`, `threshold_force_x`.
        """
        ...

    def start(self, measurement: Any) -> Any:
        """State before the first step of a machine at rest.

        Args:
          measurement: The first; it may be bad.
        """
        ...

    def step(
        self,
        state: Any,
        measurement: Any,
        command: Array | None = None,
        bias: float = 0.0,
    ) -> Any:
        """State after a measurement.

        Args:
          state: From the step before.
          measurement: The newest: a `Measurement` of a robot, checked by `is_good`, or a `RigMeasurement`.
          command: Set currents of the period that it ends, shape (n,) [A]; None: unknown.
          bias: Reading of the gyro at rest [rad/s].
        """
        ...


class RecordingDetector(FaultDetector, Protocol):
    """Detector that also runs over recordings, which begin in motion and have gaps."""

    def begin(self, measurement: Any, bias: float = 0.0) -> Any:
        """State before the first step of a machine that may already be moving.

        Args:
          measurement: The first, good.
          bias: Reading of the gyro at rest [rad/s].
        """
        ...

    def resume(self, state: Any, measurement: Any, bias: float, is_long: bool) -> Any:
        """State after a gap in the recording.

        Args:
          state: Before the gap.
          measurement: The first after it, good.
          bias: Reading of the gyro at rest [rad/s].
          is_long: Whether the gap is too long for filters to reach across it.
        """
        ...

    def cannot_judge(self, state: Any) -> bool:
        """True if the last measurements reveal nothing about faults."""
        ...


@dataclass(frozen=True, slots=True)
class DetectorOptions:
    """Form of a detector and of its recovery."""

    variant: str = VARIANTS[0]
    """Published detector: `repaired`, or `printed` with the signs as in the text."""
    thresholds: str = THRESHOLD_SETS[0]
    """Published detector: `fault_free`, from runs of the twin, or `printed`, those of the author's
    machines."""
    recovery: bool = True
    """True if the robot recovers from faults: by the weights of chapter 6, or by `control.recovery`. Without
    it the detector only watches, as in the tests of chapter 5."""
    self_test: bool = False
    """Robust detector: wheels are driven against each other before the plan begins, which waits for it."""
    dither: bool = True
    """Robust detector: wheels are driven against each other, less, while a slow robot excites its motors too
    little."""
    floor: str | None = None
    """Robust detector: name of the floor that it expects under the wheels; an empty name: none. None: that of
    the feed-forward of creep, where there is one."""

    @property
    def printed(self) -> bool:
        """True if the equations are as printed."""
        return self.variant == "printed"
