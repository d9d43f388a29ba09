"""A regime in words: what a person says of a rule, and its bounds as numbers."""

from __future__ import annotations

import numpy as np

from omnimj.gap.locate_rules import Blocks, Rule
from omnimj.gap.locate_variables import canonical

_LISTED = 4  # names in a list before the rest is counted
_STANDSTILL = 0.12  # of the largest speed


def bounds_of(rule: Rule) -> dict[str, tuple[float, float]]:
    """Variable → lowest and highest value; nothing for a variable without an order."""
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


def in_words(rule: Rule) -> str:
    """As a person says it: `carriage speed above 0.8 m/s`."""
    v, name = rule.variable, canonical(rule.variable.name)
    if v.labels:
        return _labels_in_words(rule)
    low, high = _ends(rule)
    is_below, is_above = rule.members[0] == 0, rule.members[-1] == v.bins - 1
    unit = f" {v.unit}" if v.unit not in ("", "1") else ""
    if v.is_angle:
        return f"once per turn, {v.words} from {low:.3g} to {high:.3g}{unit}"
    if name == "reversal" and is_below:
        return f"within {high:.3g}{unit} after a reversal"
    if name == "time" and is_above:
        return f"time since start, after {low:.3g}{unit}"
    if name == "time" and is_below:
        return f"early, in the first {high:.3g}{unit}"
    if name.endswith("position") and not (is_below or is_above):
        return f"around {v.words} {low:.3g} … {high:.3g}{unit}"
    words = f"{v.words} (either sign)" if v.is_size else v.words
    if is_below:
        text = f"{words} below {high:.3g}{unit}"
        slow = name.endswith("speed") and high <= _STANDSTILL * float(np.nanmax(np.abs(v.values)))
        return f"near standstill, {words} below {high:.3g}{unit}" if slow and high > 0.0 else text
    if is_above:
        return f"{words} above {low:.3g}{unit}"
    return f"{words} between {low:.3g} and {high:.3g}{unit}"


def _labels_in_words(rule: Rule) -> str:
    labels = rule.variable.labels
    inside = [labels[k] for k in rule.members]
    others = [name for name in labels if name not in inside]
    prefix = {"floor": "on ", "run": "in run ", "wheel": "at wheel "}.get(rule.variable.name, "")
    if rule.variable.name == "direction" and len(inside) == 1:
        return "at rest" if inside == ["at rest"] else f"one direction, {inside[0]} only"
    if rule.variable.name == "run":
        return f"{prefix}{_listed(inside)} alone"
    return f"{prefix}{_listed(inside)} and not {prefix}{_listed(others)}"


def _listed(names: list[str]) -> str:
    if len(names) <= _LISTED:
        return ", ".join(names)
    return f"{', '.join(names[:_LISTED])} and {len(names) - _LISTED} more"


def sign_ratio(rule: Rule, energy: np.ndarray, among: Blocks, signed: np.ndarray) -> tuple[float, str]:
    """RMS mismatch at the rule's sign over that at the other sign, and the sign in words.

    Values of the other sign are those that the rule turned round holds.
    """
    low, high = _ends(rule)
    own = among & (signed >= low) & (signed <= high)
    mirrored = among & (signed >= -high) & (signed <= -low)
    if not (own.any() and mirrored.any()):
        return 1.0, ""
    ratio = float(np.sqrt(energy[own].mean() / max(float(energy[mirrored].mean()), 1e-12)))
    return ratio, "negative" if low + high < 0.0 else "positive"
