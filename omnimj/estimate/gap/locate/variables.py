"""Regime variables: names, bins and conditions; rules in words and as bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from omnimj.estimate.gap.locate.rules import BINS, BlockMask, Rule, Variable, bin_edges
from omnimj.estimate.gap.sentences import format_amount, format_number, variable_words
from omnimj.estimate.replay.interface import Segment
from omnimj.signals import Array

_ORDER = (
    *("lateral_speed", "floor", "direction", "load", "speed", "reversal", "wheel_angle", "position"),
    *("current", "force", "yaw_rate", "acceleration", "time"),
)
"""Known names, ordered by preference where the data cannot distinguish them."""

_CONDITIONS = frozenset({"lateral_speed", "floor", "direction", "load"})
_FLOOR_FLAG = "floor "
_DIRECTIONS = ("backward", "at rest", "forward")  # names of −1, 0, 1
_FEW = 12  # largest number of values of a variable whose values are listed
_LISTED = 4  # names in a list before the rest is counted
_STANDSTILL = 0.12  # share of the largest speed up to which a range is near standstill


def regime_variables(regimes: Mapping[str, tuple[str, Array]]) -> tuple[Variable, ...]:
    """Variables with their bins, preferred ones first; a signed one is followed by its magnitude.

    Args:
      regimes: Name → unit and values, shape (blocks,); text where values have no order.
    """
    regimes = _with_labels(regimes)

    def rank(name: str) -> int:
        return _ORDER.index(name) if name in _ORDER else len(_ORDER)

    found: list[Variable] = []
    for name in sorted(regimes, key=rank):
        unit, values = regimes[name]
        values = np.asarray(values)
        words = variable_words(name)
        if name == "run":
            continue
        if values.dtype.kind not in "fiub":
            found.append(_of_labels(name, unit, words, values))
            continue
        values = values.astype(float)
        if name == "wheel_angle" or name.startswith("wheel_angle_"):
            found.append(_of_angle(name, unit, words, values))
            continue
        is_condition = name in _CONDITIONS
        if _has_both_signs(values):
            found.append(_of_numbers(name, unit, words, np.abs(values), is_condition, is_size=True))
        found.append(_of_numbers(name, unit, words, values, is_condition))
    return tuple(found)


def _with_labels(regimes: Mapping[str, tuple[str, Array]]) -> dict[str, tuple[str, Array]]:
    """Join flags such as `floor pvc` (1 there, else 0) into one variable, and name directions."""
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


def run_variable(segments: Sequence[Segment], blocks: int) -> Variable:
    """Run of every block, as a variable."""
    values = np.full(blocks, "", dtype=object)
    for segment in segments:
        values[segment.first : segment.last] = segment.run
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
    edges = 0.5 * (distinct[1:] + distinct[:-1]) if few else bin_edges(finite)
    code = _codes(values, edges)
    return Variable(name, unit, words, values, code, edges, is_size=is_size, is_condition=is_condition)


def _codes(values: Array, edges: Array) -> np.ndarray:
    finite = np.isfinite(values)
    code = np.searchsorted(edges, np.where(finite, values, 0.0), side="right").astype(np.int64)
    return np.where(finite, code, -1)


def rule_bounds(rule: Rule) -> dict[str, tuple[float, float]]:
    """Variable → lowest and highest value; empty for a variable without an order."""
    v = rule.variable
    if v.labels:
        return {}
    low, high = _ends(rule)
    return {v.name: (low, high)}


def _ends(rule: Rule) -> tuple[float, float]:
    v, first, last = rule.variable, rule.members[0], rule.members[-1]
    finite = v.values[np.isfinite(v.values)]
    lowest, highest = (0.0, 2.0 * np.pi) if v.is_angle else (float(finite.min()), float(finite.max()))
    low = lowest if first == 0 else float(v.edges[first - 1])
    high = highest if last == v.bins - 1 else float(v.edges[last])
    return low, high


def describe_rule(rule: Rule) -> str:
    """Description of a rule, such as `carriage speed above 0.8 m/s`."""
    v, name = rule.variable, rule.variable.name
    if v.labels:
        return _labels_in_words(rule)
    low, high = _ends(rule)
    low_number, low_amount = format_number(low), format_amount(low, v.unit)
    high_amount = format_amount(high, v.unit)
    is_below, is_above = rule.members[0] == 0, rule.members[-1] == v.bins - 1
    if v.is_angle:
        return f"once per turn, {v.words} from {low_number} to {high_amount}"
    if name == "reversal" and is_below:
        return f"within {high_amount} after a reversal"
    if name == "time" and is_above:
        return f"time since start, after {low_amount}"
    if name == "time" and is_below:
        return f"early, in the first {high_amount}"
    if name.endswith("position") and not (is_below or is_above):
        return f"around {v.words} {low_number} … {high_amount}"
    words = f"{v.words} (either sign)" if v.is_size else v.words
    if is_below:
        text = f"{words} below {high_amount}"
        slow = name.endswith("speed") and high <= _STANDSTILL * float(np.nanmax(np.abs(v.values)))
        return f"near standstill, {text}" if slow and high > 0.0 else text
    if is_above:
        return f"{words} above {low_amount}"
    return f"{words} between {low_number} and {high_amount}"


def _labels_in_words(rule: Rule) -> str:
    labels = rule.variable.labels
    inside = [labels[k] for k in rule.members]
    others = [name for name in labels if name not in inside]
    prefix = {"floor": "on ", "run": "in run "}.get(rule.variable.name, "")
    if rule.variable.name == "direction" and len(inside) == 1:
        return "at rest" if inside == ["at rest"] else f"one direction, {inside[0]} only"
    if rule.variable.name == "run":
        return f"{prefix}{_listed(inside)} alone"
    return f"{prefix}{_listed(inside)} and not {prefix}{_listed(others)}"


def _listed(names: list[str]) -> str:
    if len(names) <= _LISTED:
        return ", ".join(names)
    return f"{', '.join(names[:_LISTED])} and {len(names) - _LISTED} more"


def sign_ratio(rule: Rule, energy: np.ndarray, among: BlockMask, signed: np.ndarray) -> float:
    """RMS mismatch at the rule's sign over that at the other sign.

    The other sign is the mirror image of the rule's range.

    Args:
      signed: Values of the variable, shape (blocks,).
    """
    low, high = _ends(rule)
    own = among & (signed >= low) & (signed <= high)
    mirrored = among & (signed >= -high) & (signed <= -low)
    if not (own.any() and mirrored.any()):
        return 1.0
    return float(np.sqrt(energy[own].mean() / max(float(energy[mirrored].mean()), 1e-12)))
