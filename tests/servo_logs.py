"""Logs of a servo that swings a weight, from equations written by hand and integrated in fine steps."""

from pathlib import Path

import numpy as np

from omnimj.physics.native import kernel
from omnimj.recording.dataset import Run
from omnimj.recording.write_dataset import write_dataset
from omnimj.resources import models_folder

SERVO = models_folder() / "servo_arm" / "servo_arm.xml"
STEP, PERIOD = 5e-5, 0.005
ARMATURE = 0.0005
INERTIA = 0.48 * 0.1**2 + 0.48 * 0.025**2 / 2 + 0.01 * 0.05**2 + 0.01 * 0.1**2 / 12
WEIGHT = 9.81 * (0.48 * 0.1 + 0.01 * 0.05)


@kernel
def swing(goal, rate, constant, resistance, viscous, dry, load_share, offset, fading, efficiency, rows):
    """Fill position and voltage of a servo with the weight of SERVO, under a PD law."""
    inertia = INERTIA + ARMATURE
    place, speed, acceleration = 0.0, 0.0, 0.0
    voltage = 0.0
    for k in range(len(goal)):
        if k % 20 == 0:
            voltage = 12.0 * (goal[k] - place) + 0.5 * (rate[k] - speed) + 8.0 * np.sin(place) * WEIGHT
            voltage = min(max(voltage, -7.4), 7.4)
        rows[k, 0], rows[k, 1] = place, voltage
        torque = constant * (voltage - constant * speed) / resistance
        torque /= 1.0 + fading * abs(torque)
        torque = torque / efficiency if torque * speed < 0.0 else torque
        pull = WEIGHT * np.sin(place)
        friction = dry + load_share * abs(pull + INERTIA * acceleration)
        free = speed + STEP * (torque - pull - viscous * speed + offset) / inertia
        held = STEP * friction / inertia
        after = max(free - held, 0.0) if free > 0.0 else min(free + held, 0.0)
        acceleration, speed = (after - speed) / STEP, after
        place += STEP * speed


def write_servo_logs(
    folder: Path,
    load_share: float = 0.0,
    offset: float = 0.0,
    runs: int = 6,
    sign: float = 1.0,
    fading: float = 0.0,
    efficiency: float = 1.0,
) -> None:
    """Write a dataset of a servo whose constants lie within the uncertainty of its model."""
    generator, made = np.random.default_rng(3), []
    for k in range(runs):
        time = np.arange(int(8.0 / STEP)) * STEP
        reach, slow, fast = generator.uniform([0.5, 0.3, 1.2], [1.4, 0.9, 2.5])
        goal = reach * np.sin(2.0 * np.pi * slow * time) + 0.25 * np.sin(2.0 * np.pi * fast * time + k)
        rows = np.empty((len(time), 2))
        drive = (load_share, offset, fading, efficiency)
        swing(goal, np.gradient(goal, STEP), 0.52, 4.8, 0.012, 0.025, *drive, rows)
        rows = rows[:: round(PERIOD / STEP)]
        noisy = rows + generator.standard_normal(rows.shape) * [2e-4, 0.01]
        columns = {"time": time[:: round(PERIOD / STEP)], "position:shaft": noisy[:, 0]}
        made.append(Run(f"run_{k}", {**columns, "control:motor": sign * noisy[:, 1]}, {}, {}))
    write_dataset(folder, "mjcf", {}, made)
