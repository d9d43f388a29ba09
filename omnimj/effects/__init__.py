"""Effects: named physics that a machine may have beyond its model, the candidates of the gap workflow.

`effect` defines effects and the changes they make, `catalogue` finds them by plant and name, `machine` adds
them to a machine (`with_effects`) and applies them to its constants (`apply_effects`), `model_writer` writes
them into model files. Every other module declares effects in a tuple `EFFECTS`.
"""

from omnimj.effects.catalogue import EFFECTS, base_name, effects_of, find_effect
from omnimj.effects.effect import (
    AXIS,
    FLOOR,
    FLOOR_SCALES,
    MJCF,
    RIG,
    ROBOT,
    AppliedEffects,
    ChannelEffect,
    Effect,
    EffectParameter,
    Interval,
    MachineChanges,
    Selector,
    scale_floor,
)
from omnimj.effects.machine import (
    apply_effects,
    check_effects,
    collect_changes,
    complete_values,
    parse_effect,
    with_effects,
    with_further_effects,
)

__all__ = [
    "AXIS",
    "EFFECTS",
    "FLOOR",
    "FLOOR_SCALES",
    "MJCF",
    "RIG",
    "ROBOT",
    "AppliedEffects",
    "ChannelEffect",
    "Effect",
    "EffectParameter",
    "Interval",
    "MachineChanges",
    "Selector",
    "apply_effects",
    "base_name",
    "check_effects",
    "collect_changes",
    "complete_values",
    "effects_of",
    "find_effect",
    "parse_effect",
    "scale_floor",
    "with_effects",
    "with_further_effects",
]
