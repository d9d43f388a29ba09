"""Logs of the linear axis along its test plan, with or without current and tachometer."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from omnimj.effects.parts import ACTUATOR, BODY, JOINT
from omnimj.plant.mujoco.machine import Machine, with_part_effects
from omnimj.recording.dataset import Run
from omnimj.simulate.machine.drive import declared_values, logged_run, machine_loop, simulated_rows
from omnimj.simulate.machine.linear_axis import as_axis_log, read_axis
from omnimj.simulate.machine.truth import machine_truth
from omnimj.simulate.suites.machine import MachineMotion, plan_axis_motions

AXIS = read_axis()
DRIVE_MASS = AXIS.values[JOINT, "carriage", "armature"]
MASS = AXIS.values[BODY, "carriage", "mass"] + DRIVE_MASS
COULOMB, VISCOUS = (AXIS.values[JOINT, "carriage", key] for key in ("frictionloss", "damping"))
FORCE_CONSTANT = AXIS.values[ACTUATOR, "drive", "gain"]
FORCE_NOISE = 1.0
"""Of the force monitor, RMS [N]."""


def axis_moves(
    effects: Mapping[str, Mapping[str, Any]] | None = None,
    seed: int = 0,
    *,
    seconds: float = 12.0,
    count: int | None = None,
    current: bool = False,
    velocity: bool = False,
    axis: Machine = AXIS,
    true: Mapping[str, float] | None = None,
) -> list[Run]:
    """Drive the motions of the plan and return the runs as a logger would record them.

    Args:
      effects: Effects of the true axis.
      seed: Seed of the plan and of the sensor noise.
      seconds: Duration of one run [s].
      count: Number of runs; a run of every motion when None.
      current: Whether the log has `current` instead of `force`.
      velocity: Whether the axis has a tachometer.
      axis: Axis of the model file, assumed by the controller.
      true: True values of its uncertain constants: `mass`, `coulomb`, `viscous`.

    Returns:
      Runs, each of a condition of its own; the mass is declared where it differs from that of the model.
    """
    loop = machine_loop(axis, float(axis.mj_model.opt.timestep))
    hidden = with_part_effects(axis, effects or {})
    runs = []
    for k, condition in enumerate(plan_axis_motions(axis, seed)[:count]):
        wanted: MachineMotion = condition.drive
        truth = machine_truth(hidden, {**declared_values(axis), **(true or {})})
        part = (BODY, "carriage", "mass")
        truth = replace(truth, masses={**truth.masses, part: truth.masses[part] + wanted.added})
        plan = loop.plan(wanted.seed, wanted.motion._replace(seconds=seconds))
        rows = simulated_rows(truth, loop.loop, plan)
        run = as_axis_log(logged_run(condition.name, truth, rows, 100 * seed + k, loop.period, velocity))
        columns = dict(run.columns)
        if current:
            columns["current"] = columns.pop("force") / FORCE_CONSTANT
        runs.append(replace(run, columns=columns, conditions=condition.conditions, repeat_of=condition.name))
    return runs
