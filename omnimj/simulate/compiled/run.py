"""A compiled run: it returns to Python for progress, decisions, and changes of the plant's conditions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from omnimj.control.records import copied, packed
from omnimj.signals import Array, Reference
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


def compiled_loop(plant: Any, controller: Any) -> Callable[..., int] | None:
    """Compiled loop that drives this plant with this controller; None if there is none."""
    methods = type(plant).step, type(plant).truth, type(controller).step
    step, truth, control = (getattr(method, "compiled_in", None) for method in methods)
    if step is None or truth != step or control is None:
        return None
    if step == "planar":  # loops are imported when they are needed: a planar run needs no MuJoCo
        from omnimj.simulate.compiled.planar import drive_planar

        return drive_planar
    from omnimj.simulate.compiled.twin import drive_twin

    return drive_twin


class CompiledRun:
    """One run of a compiled controller on a planar robot or a twin.

    Args:
      loop: From `compiled_loop`.
      plant: Reset by this call.
      controller: A `CompiledController`; receives measurements and targets, never the truth.
      reference: Reference sampled at the plant's period.
    """

    def __init__(self, loop: Callable[..., int], plant: Any, controller: Any, reference: Reference):
        self._loop, self._plant, self._controller = loop, plant, controller
        m = plant.reset()
        self._readings = np.concatenate((m.current, m.wheel_speed, m.acceleration, (m.yaw_rate, m.yaw)))
        start = controller.start(m)
        # the loop changes record and evidence in place
        self.state = start._replace(record=copied(start.record), evidence=start.evidence.copy())
        columns = np.column_stack([reference.position, reference.heading, reference.velocity])
        self._plan = Plan(columns, np.ascontiguousarray(reference.yaw_rate, float))
        self._progress = packed(Progress())
        # loads the kernels, or compiles them, before anybody's clock runs
        nothing = Output(np.empty((0, 1)), np.empty((0, 0)), 1, self._readings, 0, 0.0)
        self._finish_chunk(nothing, 0)

    @property
    def wheels(self) -> int:
        """Number of wheels."""
        return self._controller.wheels

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
        output = Output(table, poses, every, self._readings, len(self._controller.log_names), largest)
        while self.done < len(table):
            if not self._finish_chunk(output, min((self.done // CHUNK + 1) * CHUNK, len(table))):
                return
            yield self.done

    def _finish_chunk(self, output: Output, end: int) -> bool:
        """Drive until `end` rows are finished; False if the truth of one is not sound."""
        controller, plant = self._controller, self._plant
        while True:
            arrays, state = plant.arrays(), self.state
            controlled = ControllerArrays(
                controller.parameters, controller.constants, state.record, state.evidence
            )
            reason = self._loop(
                arrays, controlled, self._progress, self._plan, output, plant.next_change, end
            )
            if reason == DECISION_IS_DUE:
                self.state = controller.decide(state, int(arrays.steps[0]) * plant.period)
            elif reason == PLANT_CHANGES:
                plant.prepare_step()
            else:
                return reason == CHUNK_IS_DONE
