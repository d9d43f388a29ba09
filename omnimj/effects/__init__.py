"""Named pieces of physics that a machine may have on top of its model: the vocabulary of the gap workflow."""

from omnimj.effects.catalogue import EFFECTS, base_name, effects_of, find_effect
from omnimj.effects.changes import Applied, Changes, Channel
from omnimj.effects.effect import AXIS, RIG, ROBOT, Effect, EffectParameter, Selector
from omnimj.effects.machine import applied, check_effects, complete, plant_of, with_effects
from omnimj.effects.text import parse_effect

__all__ = [
    "AXIS",
    "EFFECTS",
    "RIG",
    "ROBOT",
    "Applied",
    "Changes",
    "Channel",
    "Effect",
    "EffectParameter",
    "Selector",
    "applied",
    "base_name",
    "check_effects",
    "complete",
    "effects_of",
    "find_effect",
    "parse_effect",
    "plant_of",
    "with_effects",
]
