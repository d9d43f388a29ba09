"""Scope of the search by logs and structure of a machine: excited joints, effects that cannot show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from omnimj.effects import effects_of
from omnimj.effects.parts import ACTUATOR, JOINT
from omnimj.estimate.replay.interface import EXCITED, NOT_SOUGHT, CandidateEffect
from omnimj.estimate.replay.mjcf.columns import MeasuredParts
from omnimj.estimate.replay.mjcf.log import MachineLog
from omnimj.estimate.replay.mjcf.settings import Spans
from omnimj.plant.mujoco.machine import Machine
from omnimj.plant.mujoco.quantities import is_hinge

_BACK = 0.02  # share of the top speed that a motion back must reach


class Lack(NamedTuple):
    """Reason for which an effect has no candidate on a part, and the remedy."""

    part: str
    reason: str
    remedy: str


def scope_notes(
    machine: Machine,
    parts: MeasuredParts,
    spans: Spans,
    log: MachineLog,
    candidates: Sequence[CandidateEffect],
) -> Iterator[str]:
    """Yield sentences on joints that hardly move, on excited ones, and on effects that are not sought."""
    m = machine.mj_model
    for name, span in spans.items():
        if not span.is_excited:
            yield (
                f"{NOT_SOUGHT}: joint {name} hardly moves in these runs: nothing can be found about its "
                "friction and drive; move it over its range"
            )
    excited = []
    for name in parts.joints:
        span, unit = spans[name], "rad" if is_hinge(m, name) else "m"
        if span.is_excited:
            reach = span.high - span.low
            excited.append(f"{name} (over {reach:.3g} {unit}, up to {span.speed:.3g} {unit}/s)")
    if excited:
        yield f"{EXCITED}: {', '.join(excited)}"
    yield from _one_way(parts, spans, log)
    yield from _not_sought(machine, parts, spans, candidates)


def _one_way(parts: MeasuredParts, spans: Spans, log: MachineLog) -> Iterator[str]:
    """Joints that move in one direction only."""
    for j, name in enumerate(parts.joints):
        speed = log.speed[:, j]
        back = min(float(np.max(speed)), -float(np.min(speed)))
        if spans[name].is_excited and back < _BACK * spans[name].speed:
            yield (
                f"{NOT_SOUGHT}: joint {name} never turns back in these runs: coulomb and force_offset "
                "cannot be told apart there; move it both ways"
            )


def _not_sought(
    machine: Machine, parts: MeasuredParts, spans: Spans, candidates: Sequence[CandidateEffect]
) -> Iterator[str]:
    """Effects without a candidate, by part and reason."""
    had = {(c.effect, *c.selectors.values()) for c in candidates}
    found: dict[Lack, list[str]] = {}
    effects = effects_of(machine.plant)
    for effect in (one for one in effects.values() if one.selectors):
        (selector,) = effect.selectors
        names = machine.parts(selector.name) if selector.name in (JOINT, ACTUATOR) else ()
        for name in names:
            lack = _lack(effect.name, selector.name, name, machine, parts, spans)
            if lack is not None and (effect.name, name) not in had:
                found.setdefault(lack, []).append(effect.name)
    for lack, lacking in found.items():
        yield f"{NOT_SOUGHT}: {', '.join(lacking)} on {lack.part}: {lack.reason}; {lack.remedy}"
    if not np.any(machine.mj_model.opt.gravity):
        yield f"{NOT_SOUGHT}: grade: {machine.file.name} has no gravity; state it if the machine feels it"


def _lack(
    effect: str, kind: str, name: str, machine: Machine, parts: MeasuredParts, spans: Spans
) -> Lack | None:
    """Reason for which an effect may lack on a part; None for a joint that hardly moves."""
    joint = machine.joint_of(kind, name)
    if not spans[joint].is_excited:
        return None
    own = parts.inputs[parts.joints.index(joint)]
    if kind == JOINT:
        if own is None and effect == "load_friction":
            reason = "without an actuator it transmits nothing but its own friction"
            return Lack(f"joint {name}", reason, "coulomb is the same there")
        if own is None:
            reason = "no actuator drives it through a spring or play"
            return Lack(f"joint {name}", reason, "give it one if it is driven")
        if effect == "backlash":
            reason = f"no force was measured, and {own.column} depends on the motion as well"
            return Lack(f"joint {name}", reason, f"log force:{own.drive.name}")
        return Lack(f"joint {name}", f"{machine.facts.name} has it already", "change its values there")
    if own is not None and own.is_force:
        reason = f"{own.column} was measured behind them"
        return Lack(f"actuator {name}", reason, f"log control:{name} instead to see them")
    reason = "the file does not drive it by a voltage"
    return Lack(f"actuator {name}", reason, "write it as dcmotor, or with a velocity bias, if it is")
