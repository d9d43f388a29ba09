"""The compiled loops of the twins of robot and rig; arguments as in `row`."""

from __future__ import annotations

from omnimj.physics.native import kernel
from omnimj.plant.mujoco.step import (
    short_motors,
    step_rig_twin,
    step_twin,
    twin_time,
    write_rig_twin_truth,
    write_twin_truth,
)
from omnimj.simulate.compiled.row import (
    CHUNK_IS_DONE,
    DECISION_IS_DUE,
    PLANT_CHANGES,
    TRUTH_IS_BROKEN,
    control_period,
    fill_rig_row,
    finish_row,
    first_truth,
    follow_row,
    is_spent,
    keep_pose,
)


@kernel
def drive_twin(plant, progress, output, next_change, end, controller, plan):
    """Drive a robot's twin (`TwinArrays`) by its controller."""
    run, x, first = progress[0], controller.record[0], first_truth(controller, output)
    while run.row < end:
        if run.moves:
            if twin_time(plant) >= next_change or is_spent(plant.sensors):
                return PLANT_CHANGES
            short_motors(plant, x.recovery.brake)
            output.readings[:] = step_twin(plant, x.cascade.current)
            run.moves = False
        if control_period(controller, run, plan, output, plant.steps[0] * plant.period):
            return DECISION_IS_DUE
        truth = output.table[run.row, first:-5]
        write_twin_truth(plant, truth)
        keep_pose(run, output, plant.qpos)
        if not finish_row(run, output, truth):
            return TRUTH_IS_BROKEN
    return CHUNK_IS_DONE


@kernel
def follow_on_twin(plant, progress, output, next_change, end, loops, targets):
    """Turn the wheels of a robot's twin (`TwinArrays`, no poses) at given speeds."""
    run, own = progress[0], loops[0]
    while run.row < end:
        if run.moves:
            if twin_time(plant) >= next_change or is_spent(plant.sensors):
                return PLANT_CHANGES
            output.readings[:] = step_twin(plant, own.current)
            run.moves = False
        truth = follow_row(own, run, output, plant.steps[0] * plant.period, targets)
        write_twin_truth(plant, truth)
        if not finish_row(run, output, truth):
            return TRUTH_IS_BROKEN
    return CHUNK_IS_DONE


@kernel
def drive_rig_twin(plant, progress, output, next_change, end, current):
    """Drive a rig's twin (`RigTwinArrays`) by given currents."""
    run = progress[0]
    while run.row < end:
        if run.moves:
            if twin_time(plant) >= next_change or is_spent(plant.sensors):
                return PLANT_CHANGES
            output.readings[:] = step_rig_twin(plant, current[run.row - 1])
            run.moves = False
        truth = fill_rig_row(run, output, plant.steps[0] * plant.period, current)
        write_rig_twin_truth(plant, truth)
        keep_pose(run, output, plant.qpos)
        if not finish_row(run, output, truth):
            return TRUTH_IS_BROKEN
    return CHUNK_IS_DONE
