"""The compiled loop of the robot's twin under a policy."""

from __future__ import annotations

from omnimj.learning.period import account, observe, set_currents
from omnimj.physics.native import kernel
from omnimj.plant.mujoco.step import step_twin, twin_time, write_twin_truth
from omnimj.simulate.compiled.row import CHUNK_IS_DONE, PLANT_CHANGES, TRUTH_IS_BROKEN, is_spent


@kernel
def act_on_twin(plant, setup, episode, plan, next_change):
    """Drive until the end of the decision or until Python is needed; observe at the end.

    Arguments as in `period.act_on_planar`, with `TwinArrays` as the plant.

    Returns:
      The reason for which the loop returns.
    """
    p, e = setup[0], episode[0]
    while e.period < e.end:
        if twin_time(plant) >= next_change or is_spent(plant.sensors):
            return PLANT_CHANGES
        set_currents(p, e, plan, plant.steps[0] * plant.period)
        e.readings[:] = step_twin(plant, e.cascade.current)
        write_twin_truth(plant, e.truth)
        if not account(p, e, plan, plant.values):
            return TRUTH_IS_BROKEN
    observe(p, e, plan)
    return CHUNK_IS_DONE
