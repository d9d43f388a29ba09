"""The variables of a regime: what they are called, which are conditions, how their values are cut."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from omnimj.gap.locate_rules import BINS, Variable, cut
from omnimj.gap.replay import Piece
from omnimj.signals import Array

_WORDS: Mapping[str, str] = {
    "lateral_speed": "lateral speed",
    "floor": "floor",
    "direction": "direction",
    "wheel": "wheel",
    "mass": "mass",
    "load": "load",
    "speed": "speed",
    "carriage_speed": "carriage speed",
    "reversal": "time since a reversal",
    "wheel_angle": "wheel angle",
    "position": "position",
    "carriage_position": "carriage position",
    "current": "current",
    "force": "force",
    "wheel_speed": "wheel speed",
    "yaw_rate": "yaw rate",
    "acceleration": "acceleration",
    "carriage_acceleration": "acceleration",
    "time": "time since start",
}
"""Known names in the order in which they are preferred where the data cannot tell them apart."""

_ALIASES: Mapping[str, str] = {
    "time_since_start": "time",
    "time_since_reversal": "reversal",
    "sideways_speed": "lateral_speed",
    "payload": "mass",
}
_CONDITIONS = frozenset({"lateral_speed", "floor", "direction", "wheel", "mass", "load"})
_ANGLES = frozenset({"wheel_angle", "motor_angle"})
_FLOOR_FLAG = "floor "
_DIRECTIONS = ("backward", "at rest", "forward")  # of −1, 0, 1
_FEW = 12  # values at most of a variable whose values are listed


def canonical(name: str) -> str:
    """The name under which a variable is known here."""
    return _ALIASES.get(name, name)


def variables_of(regimes: Mapping[str, tuple[str, Array]]) -> tuple[Variable, ...]:
    """Variables with their bins, the preferred first; of a signed one also its size.

    Args:
      regimes: Name → unit and values, shape (blocks,); text where values have no order.
    """
    regimes = _with_labels(regimes)
    order = list(_WORDS)

    def rank(name: str) -> int:
        known = canonical(name)
        return order.index(known) if known in order else len(order)

    found: list[Variable] = []
    for name in sorted(regimes, key=rank):
        unit, values = regimes[name]
        values = np.asarray(values)
        words = _WORDS.get(canonical(name), name.replace("_", " "))
        known = canonical(name)
        if known == "run":
            continue
        if values.dtype.kind not in "fiub":
            found.append(_of_labels(name, unit, words, values))
            continue
        values = values.astype(float)
        if known in _ANGLES or any(known.startswith(f"{angle}_") for angle in _ANGLES):
            found.append(_of_angle(name, unit, words, values))
            continue
        is_condition = known in _CONDITIONS
        if _has_both_signs(values):
            found.append(_of_numbers(name, unit, words, np.abs(values), is_condition, is_size=True))
        found.append(_of_numbers(name, unit, words, values, is_condition))
    return tuple(found)


def _with_labels(regimes: Mapping[str, tuple[str, Array]]) -> dict[str, tuple[str, Array]]:
    """The same with flags such as `floor pvc` (1 there, else 0) as one variable, and directions by name."""
    found, floors = {}, {}
    for name, (unit, values) in regimes.items():
        values = np.asarray(values)
        if name.startswith(_FLOOR_FLAG):
            floors[name.removeprefix(_FLOOR_FLAG)] = values
        elif (
            name == "direction" and values.dtype.kind in "fiu" and set(np.unique(values)) <= {-1.0, 0.0, 1.0}
        ):
            found[name] = (unit, np.array(_DIRECTIONS, dtype=object)[values.astype(int) + 1])
        else:
            found[name] = (unit, values)
    if floors:
        names = np.array([*floors, ""], dtype=object)
        flags = np.stack([*floors.values(), np.full(len(next(iter(floors.values()))), 0.5)])
        found["floor"] = ("", names[flags.argmax(axis=0)])
    return found


def runs_of(pieces: Sequence[Piece], blocks: int) -> Variable:
    """The run that a block belongs to, as a variable."""
    values = np.full(blocks, "", dtype=object)
    for piece in pieces:
        values[piece.first : piece.last] = piece.run
    return _of_labels("run", "", "run", values)


def _has_both_signs(values: Array) -> bool:
    finite = values[np.isfinite(values)]
    return bool(np.mean(finite > 0.0) > 0.05 and np.mean(finite < 0.0) > 0.05) if finite.size else False


def _of_labels(name: str, unit: str, words: str, values: np.ndarray) -> Variable:
    texts = [str(v) for v in values.tolist()]
    labels = tuple(sorted(set(texts) - {""}))
    number = {label: k for k, label in enumerate(labels)}
    code = np.array([number.get(text, -1) for text in texts], dtype=np.int64)
    coded = np.where(code >= 0, code.astype(float), np.nan)
    return Variable(name, unit, words, coded, code, np.empty(0), labels, is_condition=name in _CONDITIONS)


def _of_angle(name: str, unit: str, words: str, values: Array) -> Variable:
    turned = np.mod(values, 2.0 * np.pi)
    edges = np.linspace(0.0, 2.0 * np.pi, BINS // 2 + 1)[1:-1]
    return Variable(name, unit, words, turned, _codes(turned, edges), edges, is_angle=True)


def _of_numbers(
    name: str, unit: str, words: str, values: Array, is_condition: bool, is_size: bool = False
) -> Variable:
    finite = values[np.isfinite(values)]
    distinct = np.unique(finite)
    few = 1 < distinct.size <= _FEW
    edges = 0.5 * (distinct[1:] + distinct[:-1]) if few else cut(finite)
    code = _codes(values, edges)
    return Variable(name, unit, words, values, code, edges, is_size=is_size, is_condition=is_condition)


def _codes(values: Array, edges: Array) -> np.ndarray:
    finite = np.isfinite(values)
    code = np.searchsorted(edges, np.where(finite, values, 0.0), side="right").astype(np.int64)
    return np.where(finite, code, -1)
