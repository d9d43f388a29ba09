"""Faults and effects over time, written into a compiled model and removed from it again.

Every change starts from the nominal model, so that conditions never accumulate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np

from omnimj.effects import AppliedEffects
from omnimj.physics.motor import MOTOR_SIZE
from omnimj.plant.faults import Conditions, Fault, conditions_at, conditions_with_effects, event_times
from omnimj.plant.mujoco import slots

_DECK = 0.129  # [m] height above the axles of the upper deck, which carries the payload
_FIELDS = (
    "actuator_user",
    "body_mass",
    "body_inertia",
    "body_ipos",
    "body_iquat",
    "body_pos",
    "body_quat",
    "geom_size",
    "geom_rbound",
    "geom_aabb",
    "dof_M0",
)


class NominalModel:
    """Arrays of the nominal model, from which every condition is built."""

    def __init__(self, mj_model: mujoco.MjModel, carrier: str):
        self._mj_model = mj_model
        self._carrier = mj_model.body(carrier).id
        self._arrays = {name: getattr(mj_model, name).copy() for name in _FIELDS}
        self._gravity = mj_model.opt.gravity.copy()

    def apply(self, conditions: Conditions) -> None:
        """Write conditions into the model without changing the state."""
        m = self._mj_model
        for name, array in self._arrays.items():
            getattr(m, name)[:] = array
        wheels = len(conditions.grip)
        for i in range(wheels):
            row = m.actuator_user[i]
            row[slots.MOTOR : slots.MOTOR + MOTOR_SIZE] = conditions.motors[i]
            row[slots.GRIP] = conditions.grip[i]
            floor = conditions.floors[i]
            row[slots.FLOOR_OVERRIDE] = -1 if floor is None else m.geom(f"floor_{floor}").id
            if conditions.misalignment[i]:
                self._turn_wheel(int(row[slots.WHEEL_BODY]), conditions.misalignment[i])
            if conditions.radius_scale[i] != 1.0:
                self._scale_wheel(i, conditions.radius_scale[i])
        if conditions.payload[0]:
            self._load(*conditions.payload)
        angle, direction = conditions.slope
        g, down = float(np.linalg.norm(self._gravity)), math.sin(angle)
        m.opt.gravity[:] = (
            g * down * math.cos(direction),
            g * down * math.sin(direction),
            -g * math.cos(angle),
        )

    def _turn_wheel(self, body: int, angle: float) -> None:
        """Turn an axle about the vertical [rad]."""
        turn = np.array([math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)])
        mujoco.mju_mulQuat(self._mj_model.body_quat[body], turn, self._arrays["body_quat"][body])

    def _scale_wheel(self, wheel: int, scale: float) -> None:
        """Scale a wheel and keep its rollers, which move outward and become slightly longer."""
        m = self._mj_model
        row = m.actuator_user[wheel]
        row[slots.RADIUS] *= scale
        first = int(row[slots.FIRST_ROLLER_DOF])
        for body in m.dof_bodyid[first : first + int(row[slots.ROLLER_COUNT])]:
            geom = int(m.body_geomadr[body])
            thick = m.geom_size[geom, 1]
            nominal = float(self._arrays["actuator_user"][wheel, slots.RADIUS])
            outward = (nominal * scale - thick) / (nominal - thick)
            m.body_pos[body] *= (outward, 1.0, outward)
            half = math.sqrt(nominal * scale * thick) / row[slots.ROLLER_SIN]
            m.geom_size[geom, 0] = m.geom_rbound[geom] = m.geom_aabb[geom, 3] = half

    def _load(self, mass: float, x: float, y: float) -> None:
        """Add a point mass on the deck to the carrier: mass, centre and inertia tensor."""
        m, body = self._mj_model, self._carrier
        old_mass, old_centre = m.body_mass[body], m.body_ipos[body].copy()
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, m.body_iquat[body])
        turn = turn.reshape(3, 3)
        place = np.array([x, y, _DECK])
        away = place - old_centre
        tensor = turn @ np.diag(m.body_inertia[body]) @ turn.T
        tensor += old_mass * mass / (old_mass + mass) * (away @ away * np.eye(3) - np.outer(away, away))
        principal, axes = np.linalg.eigh(tensor)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0
        m.body_mass[body] = old_mass + mass
        m.body_ipos[body] = (old_mass * old_centre + mass * place) / (old_mass + mass)
        m.body_inertia[body] = principal
        mujoco.mju_mat2Quat(m.body_iquat[body], axes.ravel())


def fault_floors(faults: Sequence[Fault]) -> tuple[str, ...]:
    """Names of the floors that faults put under wheels."""
    return tuple(str(f.numbers["floor"]) for f in faults if "floor" in f.numbers)


class ConditionSchedule:
    """Conditions of a run over time; `next_change` is the time of the next change."""

    def __init__(
        self, faults: Sequence[Fault], effects: AppliedEffects, measured_current: bool, nominal: NominalModel
    ):
        self._faults, self._effects, self._measured = faults, effects, measured_current
        self._nominal, self._times = nominal, event_times(faults)
        self.next_change = math.inf

    def start(self) -> None:
        """Apply the conditions at time 0."""
        self.apply(0.0)

    def apply(self, time: float) -> None:
        """Apply the conditions at a time [s] and note when they change next."""
        effects = self._effects
        now = conditions_at(self._faults, time, effects.machine.motor, len(effects.terms))
        self._nominal.apply(conditions_with_effects(now, effects, self._measured))
        later = [t for t in self._times if t > time + 1e-9]
        self.next_change = min(later, default=math.inf)
