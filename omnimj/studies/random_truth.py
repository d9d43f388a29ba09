"""The faults that an evaluation's cases have, drawn at random."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType

import numpy as np

from omnimj.effects import with_effects
from omnimj.parameters import Floor, Robot
from omnimj.plant.faults import Fault

NONE, TWO = "none", "two"
CLASSES = (NONE, "motor", "slip", "locked", "free", "hard_over", "all_wheel_slip", "sensor", TWO)
"""What can be wrong in a case: nothing, one fault of a class, or two of the eight `motor i`, `slip i`."""
WEAK = "weak"
ALL_CLASSES = (*CLASSES, WEAK)
"""And what is drawn only when asked for: a motor that lacks a tenth from the beginning, the smallest loss
that is to be found in a mission."""
WHEEL_FAULTS = tuple((kind, wheel) for kind in ("slip", "motor") for wheel in (1, 2, 3, 4))
"""f1 … f8 of the source's Table 5.2."""
PAIRS = tuple(combinations(WHEEL_FAULTS, 2))
"""All 28 of them."""

_WEIGHT = {"motor": 3.0, "slip": 3.0, "sensor": 3.0, TWO: 2.0}  # how often a class is drawn; 1 else
_BRAKED = 0.25  # share of motor faults that are a second motor in parallel
_PASSING, _PASSES = 0.5, (1.0, 6.0)  # share of slips that end, and after how long [s]
_AT_ONCE, _LATER = 0.5, 3.0  # share of pairs that begin together, else within so long [s]
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
    """One of the classes: nothing in a share `healthy` of the cases (if asked for), else by weight."""
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
    """The faults of one case.

    Args:
      random: Random numbers.
      kind: One of `ALL_CLASSES`.
      onsets: First and last time at which the first fault may begin [s].
      passing: Whether a slip may end.
      pair: Which of `PAIRS` two faults at once are; any when None.
    """
    onset = _rounded(random.uniform(*onsets))
    if kind == NONE:
        return ()
    if kind == TWO:
        two = PAIRS[int(random.integers(len(PAIRS))) if pair is None else pair]
        first, second = two if random.random() < 0.5 else two[::-1]
        at_once, longest = random.random() < _AT_ONCE, max(min(_LATER, onsets[1] - onset), 0.0)
        then = onset if at_once else _rounded(onset + random.uniform(0.0, longest))
        return (_on_wheel(random, *first, onset), _on_wheel(random, *second, then))
    if kind == "all_wheel_slip":
        return (Fault(kind, onset, numbers={"grip": float(random.uniform(0.05, 0.4))}),)
    if kind == "sensor":
        return (_of_sensor(random, onset),)
    wheel = int(random.integers(1, 5))
    if kind == WEAK:
        return (Fault("motor", _rounded(onsets[0]), None, wheel, {"loss": _TENTH}),)
    lot, long = random.random(), random.uniform(*_PASSES)
    end = _rounded(onset + long) if kind == "slip" and passing and lot < _PASSING else None
    return (_on_wheel(random, kind, wheel, onset, end),)


def _rounded(time: float) -> float:
    return round(float(time), 3)  # the control period


def _on_wheel(
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


def _of_sensor(random: np.random.Generator, onset: float) -> Fault:
    """Gyro, accelerometer or encoder, one as likely as the other."""
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


# The robot as it really is: its constants off those that the controller believes in, and its payload.

PAYLOAD = 0.20
"""Half-width of the payload, as a share of the robot's mass; negative: parts were taken off."""
BOUNDS: Mapping[str, float] = MappingProxyType(
    {"torque_constant": 0.03, "friction": 0.20, "mass": 0.03, "inertia": 0.05, "floor": 0.20}
)
"""Half-widths of the errors, relative to the nominal value."""
_FRICTION = ("motor.no_load_torque", "bearing.dry", "wheel.roller_dry", "wheel.roller_viscous")
_INERTIA = ("body.yaw_inertia", "wheel.inertia", "motor.rotor_inertia")
_FLOOR = ("mu", "V_s", "sigma_0", "sigma_1", "sigma_2", "mu_cap")  # mu: both μ_c and μ_s


@dataclass(frozen=True)
class ParameterErrors:
    """Factors on nominal values."""

    constants: Mapping[str, float]
    """`table.key` of the robot's constants → factor; without the payload."""
    torque_constants: tuple[float, ...]
    """Factor per motor."""
    floor: Mapping[str, float]
    """Letter of the floor's numbers → factor; `mu` is of μ_c and μ_s."""
    payload: float
    """Carried at the centre, as a share of the nominal mass; it may be negative."""


def draw_parameter_errors(random: np.random.Generator, wheels: int) -> ParameterErrors:
    """Every factor on its own, evenly inside its bounds."""

    def factor(kind: str) -> float:
        return 1.0 + BOUNDS[kind] * float(random.uniform(-1.0, 1.0))

    constants = {name: factor("friction") for name in _FRICTION}
    constants |= {name: factor("inertia") for name in _INERTIA}
    constants["body.mass"] = factor("mass")
    motors = tuple(factor("torque_constant") for _ in range(wheels))
    floor = {letter: factor("floor") for letter in _FLOOR}
    return ParameterErrors(constants, motors, floor, PAYLOAD * float(random.uniform(-1.0, 1.0)))


def true_robot(nominal: Robot, errors: ParameterErrors) -> Robot:
    """The nominal robot with the errors in it; the payload adds no yaw inertia, it sits at the centre."""
    changed: dict[str, dict[str, float]] = {}
    for name, factor in errors.constants.items():
        table, _, key = name.partition(".")
        changed.setdefault(table, {})[key] = factor * getattr(getattr(nominal, table), key)
    changed["body"]["mass"] += errors.payload * nominal.body.mass
    tables = {
        table: dataclasses.replace(getattr(nominal, table), **values) for table, values in changed.items()
    }
    robot = dataclasses.replace(nominal, **tables)
    motors = {
        "torque_constant" if wheel == 1 else f"torque_constant_{wheel}": {"wheel": wheel, "scale": scale}
        for wheel, scale in enumerate(errors.torque_constants, start=1)
    }
    return with_effects(robot, motors)


def true_floor(nominal: Floor, errors: ParameterErrors) -> Floor:
    """The nominal floor with the errors in it; μ_c and μ_s keep their ratio."""
    numbers = {
        letter: value * errors.floor.get("mu" if letter in ("mu_c", "mu_s") else letter, 1.0)
        for letter, value in nominal.numbers.items()
    }
    return dataclasses.replace(nominal, numbers=MappingProxyType(numbers))
