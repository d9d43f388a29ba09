"""What a way to diagnose gives and gets: it rides beside the cascade and may change what that does.

A method sees measurements only, so the same object runs in a controller, over recorded logs and on hardware.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from omnimj.signals import Array, Diagnosis


@dataclass(frozen=True, slots=True)
class Advice:
    """What recovery changes in the cascade; a method without a recovery gives None."""

    speed_per_twist: Array
    """B/r of φ̇ = B·twist/r, shape (n, 3): the inverse kinematics in use."""
    current_scale: Array
    """Factor on every set current, shape (n,): 1/(what is left of the torque constant)."""
    trusts_gyro: bool = True
    """False: the wheels say how fast the robot turns, since the gyro lies."""


class MethodState(Protocol):
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
    def advice(self) -> Advice | None:
        """For the cascade's next command."""
        ...


class Method(Protocol):
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
