"""Random truth of a trial: its faults, and the errors of the parameters that the controller assumes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType

import numpy as np

from omnimj.control.detection.detector import FaultDetector
from omnimj.effects.catalogue import base_name
from omnimj.effects.machine import with_further_effects
from omnimj.parameters import Floor, Robot
from omnimj.plant.faults import Fault
from omnimj.plant.interface import Plant
from omnimj.signals import Trace
from omnimj.simulate.driving import drive
from omnimj.simulate.run import make_diagnosing_controller
from omnimj.simulate.scenario.drive import Drive
from omnimj.simulate.scenario.scenario import Scenario

NONE, TWO = "none", "two"
CLASSES = (NONE, "motor", "slip", "locked", "free", "hard_over", "all_wheel_slip", "sensor", TWO)
"""Classes of cases: no fault, one fault of a class, or two of the eight `motor i`, `slip i`."""
WEAK = "weak"
ALL_CLASSES = (*CLASSES, WEAK)
"""All classes; `weak` is drawn only on request: a motor with a loss of a tenth from the beginning, the
smallest that should be found in a mission."""
WHEEL_FAULTS = tuple((kind, wheel) for kind in ("slip", "motor") for wheel in (1, 2, 3, 4))
"""Faults f1 … f8 of Table 5.2 in the dissertation."""
PAIRS = tuple(combinations(WHEEL_FAULTS, 2))
"""All 28 pairs of faults at two wheels, or of two kinds at one."""

_WEIGHT = {"motor": 3.0, "slip": 3.0, "sensor": 3.0, TWO: 2.0}  # weights of classes in the draw, else 1
_BRAKED = 0.25  # share of motor faults that are a second motor in parallel
_PASSING, _PASSES = 0.5, (1.0, 6.0)  # share of slips that end, and after how long [s]
_AT_ONCE, _LATER = 0.5, 3.0  # share of pairs that begin together; largest delay of the second fault else [s]
_TENTH = 0.1
_MODES = ("bias", "freeze", "drift", "noise", "scale")
_SIZES: dict[str, dict[str, tuple[float, float]]] = {
    # smallest and largest; biases and drifts have either sign
    "yaw_rate": {"bias": (0.05, 0.3), "drift": (0.005, 0.05), "noise": (0.05, 0.3)},  # rad/s
    "acceleration": {"bias": (0.5, 3.0), "drift": (0.05, 0.5), "noise": (0.5, 3.0)},  # m/s²
    "wheel_speed": {"bias": (1.0, 5.0), "drift": (0.1, 1.0), "noise": (0.5, 3.0)},  # rad/s
}
_SCALES = ((0.3, 0.8), (1.2, 2.0))


def draw_class(random: np.random.Generator, classes: Sequence[str], healthy: float) -> str:
    """Draw a fault class: none in a share `healthy` of the cases, else one of the others by weight.

    Args:
      random: Random generator.
      classes: Classes to draw from; without `none` every case has a fault.
      healthy: Share of cases without a fault, 0 … 1.
    """
    broken = [name for name in ALL_CLASSES if name in classes and name != NONE]
    lot, place = random.random(), random.random()
    if NONE in classes and (not broken or lot < healthy):
        return NONE
    weights = np.cumsum([_WEIGHT.get(name, 1.0) for name in broken])
    return broken[int(np.searchsorted(weights, place * weights[-1], side="right"))]


def draw_faults(
    random: np.random.Generator,
    kind: str,
    onsets: tuple[float, float],
    passing: bool,
    pair: int | None = None,
) -> tuple[Fault, ...]:
    """Draw the faults of one case.

    Args:
      random: Random generator.
      kind: One of `ALL_CLASSES`.
      onsets: First and last time at which the first fault may begin [s].
      passing: True if a slip may end.
      pair: Index in `PAIRS` of two faults at once; drawn when None.
    """
    onset = _to_period(random.uniform(*onsets))
    if kind == NONE:
        return ()
    if kind == TWO:
        two = PAIRS[int(random.integers(len(PAIRS))) if pair is None else pair]
        first, second = two if random.random() < 0.5 else two[::-1]
        at_once, longest = random.random() < _AT_ONCE, max(min(_LATER, onsets[1] - onset), 0.0)
        then = onset if at_once else _to_period(onset + random.uniform(0.0, longest))
        return (_wheel_fault(random, *first, onset), _wheel_fault(random, *second, then))
    if kind == "all_wheel_slip":
        return (Fault(kind, onset, numbers={"grip": float(random.uniform(0.05, 0.4))}),)
    if kind == "sensor":
        return (_sensor_fault(random, onset),)
    wheel = int(random.integers(1, 5))
    if kind == WEAK:
        return (Fault("motor", _to_period(onsets[0]), None, wheel, {"loss": _TENTH}),)
    lot, long = random.random(), random.uniform(*_PASSES)
    end = _to_period(onset + long) if kind == "slip" and passing and lot < _PASSING else None
    return (_wheel_fault(random, kind, wheel, onset, end),)


def _to_period(time: float) -> float:
    return round(float(time), 3)  # a multiple of the control period of 1 ms


def _wheel_fault(
    random: np.random.Generator, kind: str, wheel: int, onset: float, end: float | None = None
) -> Fault:
    numbers: dict[str, float | str] = {}
    if kind == "motor":
        braked = random.random() < _BRAKED
        loss, torque = float(random.uniform(0.2, 1.0)), float(random.uniform(0.005, 0.03))
        numbers = {"braking_torque": torque} if braked else {"loss": loss}
    elif kind == "slip":
        numbers = {"grip": float(random.uniform(0.0, 0.5))}
    elif kind == "hard_over":
        numbers = {"current": float(random.uniform(0.5, 1.5) * random.choice((-1.0, 1.0)))}
    return Fault(kind, onset, end, wheel, numbers)


def _sensor_fault(random: np.random.Generator, onset: float) -> Fault:
    """Draw a fault of gyro, accelerometer or encoder, all equally likely."""
    sensor = str(random.choice(tuple(_SIZES)))
    place = {
        "yaw_rate": "",
        "acceleration": f"_{random.choice(('x', 'y'))}",
        "wheel_speed": f"_{random.integers(1, 5)}",
    }[sensor]
    numbers: dict[str, float | str] = {"channel": sensor + place, "mode": str(random.choice(_MODES))}
    if numbers["mode"] == "scale":
        numbers["size"] = float(random.uniform(*_SCALES[int(random.integers(2))]))
    elif numbers["mode"] != "freeze":
        mode = str(numbers["mode"])
        sign = 1.0 if mode == "noise" else float(random.choice((-1.0, 1.0)))
        numbers["size"] = sign * float(random.uniform(*_SIZES[sensor][mode]))
    return Fault("sensor", onset, numbers=numbers)


PAYLOAD = 0.20
"""Half-width of the payload as a share of the robot's mass; negative: parts removed."""
BOUNDS: Mapping[str, float] = MappingProxyType(
    {"torque_constant": 0.03, "friction": 0.20, "mass": 0.03, "inertia": 0.05, "floor": 0.20}
)
"""Half-widths of the errors, relative to the nominal value."""
_WIDEST = 0.5  # half-width of what the data hardly determine, relative
_FRICTION = ("motor.no_load_torque", "bearing.dry", "wheel.roller_dry", "wheel.roller_viscous")
_INERTIA = ("body.yaw_inertia", "wheel.inertia", "motor.rotor_inertia")
_FLOOR = ("mu", "V_s", "sigma_0", "sigma_1", "sigma_2", "mu_cap")  # mu: both μ_c and μ_s


@dataclass(frozen=True)
class ParameterErrors:
    """True values of parameters as factors on their nominal ones."""

    constants: Mapping[str, float]
    """`table.key` of the robot's constants → factor; without the payload."""
    torque_constants: tuple[float, ...]
    """Factor per motor, n of them."""
    floor: Mapping[str, float]
    """Symbol of the floor's parameters → factor; `mu` applies to μ_c and μ_s."""
    payload: float
    """Payload at the centre as a share of the nominal mass; it may be negative."""


def draw_parameter_errors(random: np.random.Generator, robot: Robot) -> ParameterErrors:
    """Draw every factor independently and uniformly within its bounds.

    Numbers that were identified vary within their intervals; an identified mass includes the payload.
    """

    def factor(kind: str, identified: float | None = None) -> float:
        half = BOUNDS[kind] if identified is None else identified
        return 1.0 + half * float(random.uniform(-1.0, 1.0))

    constants = {name: factor("friction", _identified(robot, name)) for name in _FRICTION}
    constants |= {name: factor("inertia", _identified(robot, name)) for name in _INERTIA}
    mass = _identified(robot, "body.mass")
    constants["body.mass"] = factor("mass", mass)
    motors = tuple(
        factor("torque_constant", _identified_torque(robot, wheel))
        for wheel in range(1, robot.wheel_count + 1)
    )
    floor = {letter: factor("floor") for letter in _FLOOR}
    payload = PAYLOAD if mass is None else 0.0
    return ParameterErrors(constants, motors, floor, payload * float(random.uniform(-1.0, 1.0)))


def _identified(robot: Robot, key: str) -> float | None:
    """Half-width of an identified number's interval, relative; None if it was not identified."""
    table, _, name = key.partition(".")
    return _half_width(robot, key, float(getattr(getattr(robot, table), name)))


def _identified_torque(robot: Robot, wheel: int) -> float | None:
    """The same of a motor's torque constant, from the effects of the model file."""
    for name, values in robot.effects.items():
        if base_name(name) == "torque_constant" and values.get("wheel") == wheel:
            return _half_width(robot, f"effects.{name}.scale", float(values["scale"]))
    return None


def _half_width(robot: Robot, key: str, value: float) -> float | None:
    origin = robot.provenance.get(key)
    if origin is None or origin.source != "identified" or origin.uncertainty <= 0.0 or value == 0.0:
        return None
    return min(origin.uncertainty / abs(value), _WIDEST)


def true_robot(nominal: Robot, errors: ParameterErrors) -> Robot:
    """Return the nominal robot with errors; the payload at the centre adds no yaw inertia."""
    changed: dict[str, dict[str, float]] = {}
    for name, factor in errors.constants.items():
        table, _, key = name.partition(".")
        changed.setdefault(table, {})[key] = factor * getattr(getattr(nominal, table), key)
    changed["body"]["mass"] += errors.payload * nominal.body.mass
    tables = {
        table: dataclasses.replace(getattr(nominal, table), **values) for table, values in changed.items()
    }
    robot = dataclasses.replace(nominal, **tables)
    scales = enumerate(errors.torque_constants, start=1)
    motors = [("torque_constant", {"wheel": wheel, "scale": scale}) for wheel, scale in scales]
    return with_further_effects(robot, motors)


def true_floor(nominal: Floor, errors: ParameterErrors) -> Floor:
    """Return the nominal floor with errors; μ_c and μ_s keep their ratio."""
    numbers = {
        letter: value * errors.floor.get("mu" if letter in ("mu_c", "mu_s") else letter, 1.0)
        for letter, value in nominal.numbers.items()
    }
    return dataclasses.replace(nominal, numbers=MappingProxyType(numbers))


def with_errors(scenario: Scenario, errors: ParameterErrors, floor: str) -> Scenario:
    """Return the scenario with the true robot on the true floor, from which a plant is made."""
    nominal = scenario.constants
    assert isinstance(nominal, Robot)
    true = true_floor(scenario.floors[floor], errors)
    floors = MappingProxyType({**scenario.floors, floor: true})
    return dataclasses.replace(scenario, constants=true_robot(nominal, errors), floors=floors)


def drive_on_plant(scenario: Scenario, plant: Plant, detector: FaultDetector | None) -> Trace:
    """Drive a robot scenario on a plant with other parameters than its controller's; close the plant.

    Raises:
      KeyboardInterrupt: Ctrl-C ended the run.
    """
    assert isinstance(scenario.drive, Drive)
    try:
        trace = drive(plant, make_diagnosing_controller(scenario, detector), scenario.drive.reference)
    finally:
        plant.close()
    if trace.about["interrupted"] and not trace.about["failure"]:
        raise KeyboardInterrupt
    return trace
