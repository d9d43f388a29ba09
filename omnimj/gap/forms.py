"""Candidates of a plant from the catalogue of effects: every selector's choice is a candidate of its own."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

from omnimj.effects import Effect, EffectParameter, effects_of
from omnimj.gap.replay import CandidateForm, Shape

_SPEEDS = (0.02, 0.1, 0.4)  # of the range: where friction near standstill may end
_PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)


def candidate_forms(
    plant: str, spans: Mapping[str, tuple[float, float]], without: tuple[str, ...] = ()
) -> tuple[CandidateForm, ...]:
    """Every effect of a plant as the search sees it.

    Args:
      plant: Name of the plant.
      spans: What the runs cover: `speed` and `position` → lowest, highest; shapes are tried inside.
      without: Labels that cannot show in these data (a channel that was not recorded).
    """
    forms = []
    for effect in effects_of(plant).values():
        choices = [[(s.name, c) for c in s.choices] for s in effect.selectors]
        for chosen in itertools.product(*choices):
            text = ", ".join(str(c) if n != "wheel" else f"wheel {c}" for n, c in chosen)
            label = f"{effect.name} ({text})" if text else effect.name
            if label not in without:
                forms.append(_form(effect, label, dict(chosen), spans))
    return tuple(forms)


def _form(
    effect: Effect, label: str, selectors: dict[str, str | int], spans: Mapping[str, tuple[float, float]]
) -> CandidateForm:
    shapes = tuple(_shape(p, spans) for p in effect.parameters)
    return CandidateForm(
        label, effect.name, effect.words, shapes, selectors, is_sensor=effect.where == "sensors"
    )


def _shape(p: EffectParameter, spans: Mapping[str, tuple[float, float]]) -> Shape:
    return Shape(p.name, p.unit, p.low, p.high, p.typical, p.vanishes, _trials(p, spans))


def _trials(p: EffectParameter, spans: Mapping[str, tuple[float, float]]) -> tuple[float, ...]:
    """Values at which a shape is tried."""
    if p.vanishes is not None:
        return ()
    low, high = spans.get("position", (0.0, 1.0))
    width = max(high - low, 1e-6)
    fast = max(abs(v) for v in spans.get("speed", (0.0, 1.0)))
    wanted: tuple[float, ...] = (p.typical,)
    if p.unit == "m/s":
        wanted = tuple(share * fast for share in _SPEEDS)
    elif p.name == "width":
        wanted = (0.05 * width, 0.15 * width)
    elif p.name == "start":
        wanted = tuple(low + a * width for a in (0.0, 0.25, 0.5, 0.75))
    elif p.name == "end":
        wanted = tuple(low + b * width for b in (0.25, 0.5, 0.75, 1.0))
    elif p.name == "rest_position":
        wanted = (low, 0.5 * (low + high), high)
    elif p.name == "position":
        wanted = tuple(low + share * width for share in _PLACES)
    elif p.name == "poles":
        wanted = (1.0, 2.0, 3.0, 4.0, 6.0, 7.0, 8.0, 12.0)
    elif p.name == "direction":
        wanted = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, -2.5, -2.0, -1.5, -1.0, -0.5)
    return tuple(min(max(value, p.low), p.high) for value in wanted)
