"""Compiled runs: they return to Python for progress, decisions, and changes of the plant's conditions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from omnimj.control.records import Record, copied, packed
from omnimj.signals import Array, Measurement, Reference, RigMeasurement
from omnimj.simulate.compiled.row import (
    CHUNK_IS_DONE,
    DECISION_IS_DUE,
    PLANT_CHANGES,
    ControllerArrays,
    Output,
    Plan,
    Progress,
)

CHUNK = 100
"""Rows after which the loop returns for progress and Ctrl-C."""

Loop = Callable[..., int]
"""Kernel that drives a plant until Python is needed, and returns the reason."""


def _planar_loops() -> dict[str, Loop]:
    from omnimj.simulate.compiled.planar import drive_planar, drive_planar_rig, follow_on_planar

    return {"planar": drive_planar, "planar_rig": drive_planar_rig, "follow_planar": follow_on_planar}


def _twin_loops() -> dict[str, Loop]:
    from omnimj.simulate.compiled.twin import drive_rig_twin, drive_twin, follow_on_twin

    return {"twin": drive_twin, "rig_twin": drive_rig_twin, "follow_twin": follow_on_twin}


# loops are imported when they are needed: a planar run needs no MuJoCo
_ROBOTS = {"planar": _planar_loops, "twin": _twin_loops}
_RIGS = {"planar_rig": _planar_loops, "rig_twin": _twin_loops}


def _loop_of(plant: Any, loops: dict[str, Callable[[], dict[str, Loop]]]) -> Loop | None:
    """Loop whose kernels replace both `step` and `truth` of a plant."""
    step, truth = (getattr(method, "compiled_in", None) for method in (type(plant).step, type(plant).truth))
    return loops[step]()[step] if step == truth and step in loops else None


def compiled_loop(plant: Any, controller: Any) -> Loop | None:
    """Compiled loop that drives this robot with this controller; None if there is none."""
    if getattr(type(controller).step, "compiled_in", None) is None:
        return None
    return _loop_of(plant, _ROBOTS)


def compiled_rig_loop(plant: Any) -> Loop | None:
    """Compiled loop that drives this rig by given currents; None if there is none."""
    return _loop_of(plant, _RIGS)


def following_loop(plant: Any) -> Loop:
    """Compiled loop that turns the wheels of this simulated robot at given speeds."""
    kind = type(plant).step.compiled_in
    return _ROBOTS[kind]()[f"follow_{kind}"]


class _Run:
    """Rows of a compiled loop.

    Args:
      loop: Kernel that drives the plant.
      plant: Plant that has been reset.
      readings: Its first readings, in the order of its channels.
      signals: Number of the controller's logged signals.
    """

    def __init__(self, loop: Loop, plant: Any, readings: Array, signals: int = 0):
        self._loop, self._plant = loop, plant
        self._readings, self._signals = readings, signals
        self._progress = packed(Progress())
        # load or compile the kernels before timing starts
        nothing = Output(np.empty((0, 1)), np.empty((0, 0)), 1, self._readings, 0, 0.0)
        self._finish_chunk(nothing, 0)

    @property
    def done(self) -> int:
        """Rows that are finished."""
        return int(self._progress["row"][0])

    def advance(self, table: Array, poses: Array, every: int, largest: float) -> Iterator[int]:
        """Fill the rows of a table and yield the number of finished ones after every `CHUNK`.

        Ends early, at a row whose truth is not sound.

        Args:
          table: Rows to fill, shape (rows, columns), with the columns of `loop.column_names`.
          poses: Output, a pose of the plant every `every` rows, shape (m, nq); m = 0 if none are wanted.
          every: Rows between two poses.
          largest: Largest magnitude of a sound true value.
        """
        output = Output(table, poses, every, self._readings, self._signals, largest)
        while self.done < len(table):
            if not self._finish_chunk(output, min((self.done // CHUNK + 1) * CHUNK, len(table))):
                return
            yield self.done

    def _finish_chunk(self, output: Output, end: int) -> bool:
        """Drive until `end` rows are finished; False if the truth of one is not sound."""
        plant = self._plant
        while True:
            change = plant.next_change
            reason = self._loop(plant.arrays(), self._progress, output, change, end, *self._inputs())
            if reason == DECISION_IS_DUE:
                self._decide()
            elif reason == PLANT_CHANGES:
                plant.prepare_step()
            else:
                return reason == CHUNK_IS_DONE

    def _inputs(self) -> tuple[Any, ...]:
        """Controller or drive of the plant: further arguments of the loop."""
        raise NotImplementedError

    def _decide(self) -> None:
        """Take the detector's decision that the loop waits for."""
        raise NotImplementedError


class CompiledRun(_Run):
    """One run of a compiled controller on a planar robot or a twin.

    Args:
      loop: From `compiled_loop`.
      plant: Reset by this call.
      controller: A `CompiledController`; receives measurements and targets, never the truth.
      reference: Reference sampled at the plant's period.
    """

    def __init__(self, loop: Loop, plant: Any, controller: Any, reference: Reference):
        self._controller = controller
        m = plant.reset()
        start = controller.start(m)
        if controller.detects:
            # load or compile its kernels, too; decide on a copy, so that the start state stays unchanged
            controller.decide(_copied(start), m.time)
        # the loop changes record and memory in place
        self.state = _copied(start)
        columns = np.column_stack([reference.position, reference.heading, reference.velocity])
        self._plan = Plan(columns, np.ascontiguousarray(reference.yaw_rate, float))
        super().__init__(loop, plant, _robot_readings(m), len(controller.log_names))

    @property
    def wheels(self) -> int:
        """Number of wheels."""
        return self._controller.wheels

    def _inputs(self) -> tuple[Any, ...]:
        own, state = self._controller, self.state
        return ControllerArrays(own.parameters, own.constants, state.record, state.memory), self._plan

    def _decide(self) -> None:
        steps = int(self._plant.arrays().steps[0])
        self.state = self._controller.decide(self.state, steps * self._plant.period)


class CompiledFollowing(_Run):
    """One run of a simulated robot whose wheels follow given speeds.

    Args:
      plant: Reset by this call.
      loops: From `wheel_speed_loops`, at rest.
      targets: Wheel speeds of every row, shape (rows, n) [rad/s].
    """

    def __init__(self, plant: Any, loops: Record, targets: Array):
        self._loops, self._targets = loops, np.ascontiguousarray(targets, float)
        super().__init__(following_loop(plant), plant, _robot_readings(plant.reset()))

    def _inputs(self) -> tuple[Any, ...]:
        return self._loops, self._targets


class CompiledRigRun(_Run):
    """One run of a rig under given currents.

    Args:
      loop: From `compiled_rig_loop`.
      plant: Rig that has been reset.
      measurement: Its first measurement.
      current: Set current of every row, shape (rows,) [A].
    """

    def __init__(self, loop: Loop, plant: Any, measurement: RigMeasurement, current: Array):
        m, self._current = measurement, np.ascontiguousarray(current, float)
        readings = (m.current, m.wheel_speed, m.carriage_speed, m.carriage_acceleration, m.lateral_speed)
        super().__init__(loop, plant, np.array(readings))

    def _inputs(self) -> tuple[Any, ...]:
        return (self._current,)


def _copied(state: Any) -> Any:
    """Controller's state whose record and memory may be changed in place."""
    return state._replace(record=copied(state.record), memory=copied(state.memory))


def _robot_readings(m: Measurement) -> Array:
    return np.concatenate((m.current, m.wheel_speed, m.acceleration, (m.yaw_rate, m.yaw)))
