"""Test plans of the rig: the dissertation's three and a compact mixed one; no run overshoots the rail."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.parameters import Rig
from omnimj.plant.interface import RIG_CHANNELS
from omnimj.plant.planar_rig import PlanarRig
from omnimj.signals import Array, CurrentCommand
from omnimj.simulate.driving import drive_rig
from omnimj.simulate.loop import Callbacks, require_complete
from omnimj.simulate.plants import make_simulated
from omnimj.simulate.suites.suite import Condition, RunConfig

RAIL_MARGIN = 0.03
"""Distance to the end of rail or gantry at which a run ends [m]."""

_REST = 0.2  # [s] of rest before and after, in which the accelerometer shows its offset
_REST_SIDEWAYS = 0.05  # [s] the same for a moving gantry, whose travel is short
_LONGEST = 2.5  # [s] of a constant current
_SLOWEST = 3.0  # [s] after which a stroke that does not reach its position is ended
_STANDSTILL = 0.02  # [m/s]

FLOORS = ("natural_stone", "pvc", "paperboard")
"""Floors of the dissertation."""
LATERAL_SPEEDS = (0.20, 0.35, 0.50, 0.65, -0.20, -0.35, -0.50, -0.65)
"""Lateral speeds of section 4.4 [m/s]."""


@dataclass(frozen=True)
class RigExcitation:
    """Current over time, and constant lateral speed of the gantry."""

    current: Array
    """Set values of the current, one per sample period, shape (k,) [A]."""
    lateral_speed: float = 0.0
    """Lateral speed of the gantry [m/s]."""


@dataclass(frozen=True)
class Stroke:
    """Stroke of the carriage: drive to a position, coast, brake to standstill."""

    current: float
    """Driving current, positive away from the rail's start, negative back [A]."""
    place: float
    """Position at which the current ends, from the start [m]."""
    coast: float = 0.0
    """Time without current [s]."""
    brake: float = 0.0
    """Magnitude of the braking current [A]; 0: the next stroke begins at once."""


def constant_current(rig: Rig, current: float, lateral_speed: float = 0.0) -> RigExcitation:
    """Return an excitation of rest, then a constant current until the rail ends, as in sections 4.2-4.4.

    Args:
      rig: Gives the sample rate.
      current: Set current after the rest [A].
      lateral_speed: Speed of the gantry [m/s]; if it moves, the rest is shorter.
    """
    rest = _REST_SIDEWAYS if lateral_speed else _REST
    rate = rig.sensors.sample_rate
    values = np.zeros(round((rest + _LONGEST) * rate) + 1)
    values[round(rest * rate) :] = current
    return RigExcitation(values, lateral_speed)


def stroke_currents(
    rig: Rig, floor: str, mass: float, plan: tuple[Stroke, ...], lateral_speed: float = 0.0
) -> RigExcitation:
    """Convert strokes back and forth to currents over time.

    The switching times come from one trial run of the nominal planar model, so that all repeats are equal.

    Args:
      rig: The nominal rig.
      floor: Name of the floor.
      mass: Mass m_T of the quarter body [kg].
      plan: Consecutive strokes.
      lateral_speed: Lateral speed of the gantry [m/s].
    """
    trial = _TrialRun(rig, floor, mass, lateral_speed)
    trial.hold(0.0, _REST_SIDEWAYS if lateral_speed else _REST)
    for stroke in plan:
        way = 1.0 if stroke.current > 0.0 else -1.0
        trial.hold(stroke.current, _SLOWEST, lambda x, v, s=stroke, w=way: w * (x - s.place) >= 0.0)
        trial.hold(0.0, stroke.coast, lambda x, v, w=way: w * v <= _STANDSTILL)
        if stroke.brake:
            trial.hold(-way * stroke.brake, _SLOWEST, lambda x, v, w=way: w * v <= 0.0)
    trial.hold(0.0, _REST)
    return RigExcitation(np.array(trial.currents), lateral_speed)


def samples_on_rail(rig: Rig, position: Array, lateral_position: Array) -> int:
    """Number of samples before the carriage or the gantry reaches the end of its travel.

    Args:
      rig: The rig.
      position: Position of the carriage from its start, shape (n,) [m].
      lateral_position: Position of the gantry from its start, shape (n,) [m].
    """
    body = rig.rig
    low = -max(body.start_position - RAIL_MARGIN, RAIL_MARGIN)
    high = body.rail_length - body.start_position - RAIL_MARGIN
    beyond = (
        (position < low) | (position > high) | (np.abs(lateral_position) > body.lateral_travel - RAIL_MARGIN)
    )
    return int(np.argmax(beyond)) if beyond.any() else len(position)


class _TrialRun:
    """Trial run of the nominal rig that records the currents."""

    def __init__(self, rig: Rig, floor: str, mass: float, lateral_speed: float):
        self._plant = PlanarRig(rig, floor, mass=mass, lateral_speed=lateral_speed, ideal_sensors=True)
        self._plant.reset()
        self.currents: list[float] = []

    def hold(
        self, current: float, seconds: float, until: Callable[[float, float], bool] | None = None
    ) -> None:
        """Hold a current until a condition on position [m] and speed [m/s] is met, or the time is over."""
        command = CurrentCommand(np.array([current]))
        for _ in range(round(seconds / self._plant.period)):
            position, speed = self._plant.truth()[:2].tolist()
            if until is not None and until(position, speed):
                return
            self.currents.append(current)
            self._plant.step(command)


_CREEP = (
    Stroke(0.34, 0.15, coast=0.5, brake=0.30),
    Stroke(-0.34, 0.25, brake=0.30),
    Stroke(0.45, 0.28),
    Stroke(-0.45, 0.28),
    Stroke(0.38, 0.45, coast=0.3, brake=0.20),
    Stroke(-0.38, 0.45, coast=0.4, brake=0.25),
)
_TO_AND_FRO = (
    Stroke(0.80, 0.60, coast=0.2, brake=0.6),
    Stroke(-0.60, 0.60, coast=0.2, brake=0.5),
    Stroke(0.95, 0.70, brake=0.8),
    Stroke(-0.80, 0.60),
    Stroke(0.50, 0.70, coast=0.4, brake=0.3),
)
_DASH = (
    Stroke(1.50, 0.80, coast=0.1, brake=1.2),
    Stroke(-1.35, 0.60, brake=1.05),
    Stroke(1.20, 0.70),
    Stroke(-1.50, 0.40, coast=0.1, brake=0.9),
)
_LONG = (Stroke(1.05, 1.10, coast=0.1, brake=1.35), Stroke(-0.70, 0.60, coast=0.3, brake=0.5))


def plan_currents(rig: Rig, seed: int) -> list[Condition]:
    """Identification plan, section 4.2: 0.15 … 1.5 A on three floors with the full mass."""
    return [
        _constant(rig, floor, rig.rig.masses[0], current)
        for floor in FLOORS
        for current in _hundredths(15, 150, 15)
    ]


def plan_validation(rig: Rig, seed: int) -> list[Condition]:
    """Validation plan, section 4.3: 0.45 … 1.5 A on three floors with every mass."""
    return [
        _constant(rig, floor, mass, current)
        for mass in rig.rig.masses
        for floor in FLOORS
        for current in _hundredths(45, 150, 15)
    ]


def plan_lateral(rig: Rig, seed: int) -> list[Condition]:
    """Plan of sideways motion, section 4.4: four currents at eight lateral speeds on natural stone."""
    return [
        _constant(rig, FLOORS[0], rig.rig.masses[0], current, lateral)
        for lateral in LATERAL_SPEEDS
        for current in (0.6, 0.9, 1.2, 1.5)
    ]


def plan_mixed(rig: Rig, seed: int) -> list[Condition]:
    """Plan of 24 runs with reversals, coasting and braking, slow and fast, straight and sideways.

    Constant currents alone hide effects at reversal, near standstill or at one position of the rail.
    """
    full, middle, least = rig.rig.masses[0], rig.rig.masses[len(rig.rig.masses) // 2], rig.rig.masses[-1]
    found = []
    for floor in FLOORS:
        found += [
            _strokes(rig, floor, full, "creep", _CREEP, repeats=2),
            _strokes(rig, floor, full, "dash", _DASH, repeats=2),
            _strokes(rig, floor, middle, "to_and_fro", _TO_AND_FRO),
            _strokes(rig, floor, least, "long", _LONG),
        ]
    for floor, lateral, kind, plan in (
        (FLOORS[0], 0.20, "to_and_fro", _TO_AND_FRO),
        (FLOORS[0], -0.20, "to_and_fro", _TO_AND_FRO),
        (FLOORS[0], 0.40, "dash", _DASH),
        (FLOORS[0], -0.40, "dash", _DASH),
        (FLOORS[1], 0.25, "creep", _CREEP),
        (FLOORS[2], -0.25, "long", _LONG),
    ):
        found.append(_strokes(rig, floor, full, kind, plan, lateral))
    return found


def record_rig(rig: Rig, nominal: Rig, condition: Condition, config: RunConfig) -> Mapping[str, Array]:
    """Record measurements and set current of a `RigExcitation` up to the end of the rail.

    A `RecordRun`; nothing is controlled, so that the nominal rig is not used.
    """
    drive: RigExcitation = condition.drive
    floor, mass = str(condition.conditions["floor"]), float(condition.conditions["mass"])
    options = {"mass": mass, "lateral_speed": drive.lateral_speed, "seed": config.seed}
    plant = make_simulated(config.plant, rig, floor, config.floors, **options)
    try:
        trace = drive_rig(plant, drive.current, Callbacks(config.progress))
    finally:
        plant.close()
    require_complete(trace, f"run {condition.name}")
    rows = samples_on_rail(rig, trace["carriage_position"], trace["lateral_position"])
    return {name: trace[name][:rows] for name in ("time", *RIG_CHANNELS, "current_target")}


def _hundredths(first: int, last: int, step: int) -> Sequence[float]:
    return [k / 100.0 for k in range(first, last + 1, step)]


def _name(rig: Rig, floor: str, mass: float, kind: str, lateral: float) -> str:
    """Name such as `stone_2959g_060_p35`: floor, mass unless full, kind, lateral speed if any."""
    parts = [floor.removeprefix("natural_")]
    if mass != rig.rig.masses[0]:
        parts.append(f"{1000.0 * mass:.0f}g")
    parts.append(kind)
    if lateral:
        parts.append(f"{'p' if lateral > 0.0 else 'm'}{100.0 * abs(lateral):02.0f}")
    return "_".join(parts)


def _constant(rig: Rig, floor: str, mass: float, current: float, lateral: float = 0.0) -> Condition:
    name = _name(rig, floor, mass, f"{np.rint(100.0 * current):03.0f}", lateral)
    return Condition(name, {"floor": floor, "mass": mass}, constant_current(rig, current, lateral))


def _strokes(
    rig: Rig,
    floor: str,
    mass: float,
    kind: str,
    plan: tuple[Stroke, ...],
    lateral: float = 0.0,
    repeats: int | None = None,
) -> Condition:
    name = _name(rig, floor, mass, kind, lateral)
    drive = stroke_currents(rig, floor, mass, plan, lateral)
    return Condition(name, {"floor": floor, "mass": mass}, drive, repeats)
