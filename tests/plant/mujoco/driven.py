"""Wheels driven at given speeds, and machines without friction."""

import dataclasses

import mujoco
import numpy as np


def without_friction(machine):
    """The same machine with free rollers, bearings and motors, so that given speeds stay as they are."""
    return dataclasses.replace(
        machine,
        wheel=dataclasses.replace(machine.wheel, roller_dry=0.0, roller_viscous=0.0),
        bearing=dataclasses.replace(machine.bearing, dry=0.0, viscous=0.0),
        motor=dataclasses.replace(machine.motor, no_load_torque=0.0, viscous=0.0),
    )


def run(twin, speeds, steps):
    """Steps a twin while holding joint speeds {dof: rad/s or m/s}.

    Returns:
      Positions, speeds and sensor values after each step, shapes (steps, nq), (steps, nv), (steps, n).
    """
    d = twin.mj_data
    places, rates, felt = [], [], []
    dofs, values = np.array(list(speeds)), np.array(list(speeds.values()))
    for _ in range(steps):
        d.qvel[dofs] = values
        mujoco.mj_step(twin.mj_model, d)
        places.append(d.qpos.copy())
        rates.append(d.qvel.copy())
        felt.append(d.sensordata.copy())
    return np.array(places), np.array(rates), np.array(felt)


def axle(mj_model, wheel=1):
    return int(mj_model.joint(f"wheel_{wheel}_axle").dofadr[0])
