"""The faults that an evaluation's cases have, drawn at random."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from omnimj.plant.conditions import Fault

NONE, TWO = "none", "two"
CLASSES = (NONE, "motor", "slip", "locked", "free", "hard_over", "all_wheel_slip", "sensor", TWO)
"""What can be wrong in a case: nothing, one fault of a class, or two of the eight `motor i`, `slip i`."""
WEAK = "weak"
SPECIAL = (*CLASSES, WEAK)
"""And what is drawn only when asked for: a motor that lacks a tenth from the beginning, the smallest loss
that is to be found in a mission."""
EIGHT = tuple((kind, wheel) for kind in ("slip", "motor") for wheel in (1, 2, 3, 4))
"""f1 … f8 of the source's Table 5.2."""
PAIRS = tuple(combinations(EIGHT, 2))
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
    broken = [name for name in SPECIAL if name in classes and name != NONE]
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
      kind: One of `SPECIAL`.
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
