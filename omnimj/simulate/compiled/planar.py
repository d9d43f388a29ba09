"""The compiled loops of the plants without MuJoCo: the planar robot and the rig; arguments as in `row`."""

from __future__ import annotations

from omnimj.physics.native import kernel
from omnimj.plant.planar import short_planar_motors, step_planar, write_planar_truth
from omnimj.plant.planar_rig import step_planar_rig, write_planar_rig_truth
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
)


@kernel
def drive_planar(plant, progress, output, next_change, end, controller, plan):
    """Drive a planar robot (`PlanarArrays`, no poses) by its controller."""
    run, x, first = progress[0], controller.record[0], first_truth(controller, output)
    while run.row < end:
        if run.moves:
            if plant.steps[0] * plant.period >= next_change or is_spent(plant.sensors):
                return PLANT_CHANGES
            short_planar_motors(plant, x.recovery.brake)
            output.readings[:] = step_planar(plant, x.cascade.current)
            run.moves = False
        if control_period(controller, run, plan, output, plant.steps[0] * plant.period):
            return DECISION_IS_DUE
        truth = output.table[run.row, first:-5]
        write_planar_truth(plant, truth)
        if not finish_row(run, output, truth):
            return TRUTH_IS_BROKEN
    return CHUNK_IS_DONE


@kernel
def follow_on_planar(plant, progress, output, next_change, end, loops, targets):
    """Turn the wheels of a planar robot (`PlanarArrays`, no poses) at given speeds."""
    run, own = progress[0], loops[0]
    while run.row < end:
        if run.moves:
            if plant.steps[0] * plant.period >= next_change or is_spent(plant.sensors):
                return PLANT_CHANGES
            output.readings[:] = step_planar(plant, own.current)
            run.moves = False
        truth = follow_row(own, run, output, plant.steps[0] * plant.period, targets)
        write_planar_truth(plant, truth)
        if not finish_row(run, output, truth):
            return TRUTH_IS_BROKEN
    return CHUNK_IS_DONE


@kernel
def drive_planar_rig(plant, progress, output, next_change, end, current):
    """Drive a planar rig (`PlanarRigArrays`, no poses) by given currents."""
    run = progress[0]
    while run.row < end:
        if run.moves:
            if plant.steps[0] * plant.period >= next_change or is_spent(plant.sensors):
                return PLANT_CHANGES
            output.readings[:] = step_planar_rig(plant, current[run.row - 1])
            run.moves = False
        truth = fill_rig_row(run, output, plant.steps[0] * plant.period, current)
        write_planar_rig_truth(plant, truth)
        if not finish_row(run, output, truth):
            return TRUTH_IS_BROKEN
    return CHUNK_IS_DONE
