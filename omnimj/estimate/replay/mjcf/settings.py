"""Base parameters, and candidate effects made of the parts of an MJCF file, sized by the logs."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import mujoco
import numpy as np

from omnimj.effects import Effect, effects_of
from omnimj.effects.mjcf import AXIS_OF_TILT
from omnimj.effects.parts import ACTUATOR, BODY, CHANNEL, JOINT, joint_unit
from omnimj.estimate.replay.interface import BaseParameter, CandidateEffect, CandidateParameter
from omnimj.estimate.replay.mjcf.columns import MeasuredParts
from omnimj.estimate.replay.mjcf.laws import TIMING
from omnimj.plant.mujoco.machine import Machine, apply_part_effects
from omnimj.plant.mujoco.quantities import QUANTITIES, body_names, is_hinge, joint_to_centre
from omnimj.signals import Array

NOTICED = 0.1
"""Share of a joint's RMS force that an effect of typical size has."""
_MOST = 30.0  # bound of an amplitude in typical sizes: three times the joint's RMS force
_FADED = 4.0  # largest c |F| of a soft saturation at the largest force
_SLOW = 0.4  # share of the top speed up to which friction counts as friction near standstill
_SPEEDS, _PLACES = (0.02, 0.05, 0.1, 0.25), (0.1, 0.3, 0.5, 0.7, 0.9)
_EXTRA_FRICTION = {
    "load_friction": "load_share",
    "stribeck": "stribeck_force",
    "position_friction": "place_force",
}
_PLAY, _WIDEST = 1e-3, 0.1  # play of typical size and widest play, over the joint's range
_ADDED = 0.05  # payload of typical size over the mass of its body and what it carries
_MOST_CARRIED = 10.0  # heaviest payload over the same
_ARMS = (0.5, 1.0, 1.5, 2.0)  # places of a payload, over the distance of the centre of mass
_ARM_SPREAD, _TO_END = 0.3, 0.5  # standard deviation of its place, over the same and over the way to the end


@dataclass(frozen=True)
class JointSpan:
    """Range of a joint's measured motion and force."""

    low: float
    high: float
    speed: float
    """Top speed."""
    acceleration: float
    """RMS acceleration."""
    force: float
    """RMS force of its actuator, or of its links where it has none [N or N.m]."""
    peak: float
    """Largest force of its actuator."""
    is_excited: bool


Spans = Mapping[str, JointSpan]
"""Joint → its span."""


def base_parameters(machine: Machine, period: float) -> tuple[BaseParameter, ...]:
    """Uncertain quantities of the machine, and the offset between the clocks of inputs and positions.

    Args:
      period: Sample period of the log [s].
    """
    found = []
    for one in machine.uncertain:
        quantity = QUANTITIES[one.part[0]][one.part[2]]
        low = max(one.value - one.half_width, quantity.lowest + one.beyond)
        words = f"{quantity.words} of {one.part[1]}"
        found.append(BaseParameter(one.name, one.unit, one.value, low, one.value + one.half_width, words))
    sample = 0.75 * period
    words = "offset between the clocks of inputs and positions"
    return (*found, BaseParameter(TIMING, "s", 0.0, -sample, sample, words))


def machine_candidates(machine: Machine, parts: MeasuredParts, spans: Spans) -> tuple[CandidateEffect, ...]:
    """Candidate effects of all parts of a machine that can show in its logs."""
    found = []
    menu = effects_of(machine.plant)
    for effect in menu.values():
        for selectors in _choices(effect, machine, parts, spans):
            chosen = f" ({', '.join(selectors.values())})" if selectors else ""
            label = f"{effect.name}{chosen}"
            shapes = _shapes(effect, selectors, machine, spans)
            facts = {
                "is_sensor": effect.where == "sensors",
                "has_threshold": effect.has_threshold,
                "quantity": _uncertain_quantity(effect, selectors, machine),
            }
            chosen_parts = MappingProxyType(selectors)
            found.append(CandidateEffect(label, effect.name, effect.words, shapes, chosen_parts, **facts))
    return tuple(found)


def _uncertain_quantity(effect: Effect, selectors: Mapping[str, str], machine: Machine) -> str:
    """Base parameter that is the quantity which an effect changes; empty without one."""
    m = machine.mj_model
    if effect.quantity == "mass" and any(is_hinge(m, name) for name in machine.joints):
        return ""  # an uncertain mass scales the body's inertia, which a payload does not
    parts = [(kind, name, effect.quantity) for kind, name in selectors.items()]
    return next((one.name for one in machine.uncertain if one.part in parts), "")


def _choices(
    effect: Effect, machine: Machine, parts: MeasuredParts, spans: Spans
) -> Iterator[dict[str, str]]:
    """Parts on which an effect can show."""
    if not effect.selectors:  # of the only joint
        has_channel = not effect.name.startswith("velocity") or parts.has_velocity[0]
        is_new = effect.name not in _ONCE or not any(key.startswith(effect.name) for key in machine.effects)
        if has_channel and is_new:
            yield {}
        return
    (selector,) = effect.selectors
    moving = [name for name in parts.joints if spans[name].is_excited]
    inputs = {own.drive.joint: own for own in parts.inputs if own is not None}
    if selector.name == JOINT:
        names = moving
        if effect.name in ("compliance", "load_friction"):
            names = [j for j in moving if j in inputs]
        elif effect.name == "backlash":
            names = [j for j in moving if j in inputs and inputs[j].is_force]
        if effect.name in _ONCE:
            names = [j for j in names if not _present(machine, effect.name, j)]
        yield from ({JOINT: name} for name in names)
    elif selector.name == ACTUATOR:
        for own in (inputs[j] for j in moving if j in inputs and not inputs[j].is_force):
            if own.drive.has_back_emf or effect.name not in ("torque_constant", "back_emf"):
                yield {ACTUATOR: own.drive.name}
    elif selector.name == BODY:
        yield from ({BODY: name} for name in _moved_bodies(machine, moving))
    elif selector.name == CHANNEL and selector.choices:
        names = (machine.column_names.get(name, name) for name in _measured_columns(parts))
        yield from ({CHANNEL: name} for name in names if name in selector.choices)
    elif selector.name == CHANNEL:
        yield from ({CHANNEL: name} for name in _channels(effect.name, parts, moving))
    elif np.any(machine.mj_model.opt.gravity):
        yield from ({AXIS_OF_TILT.name: str(axis)} for axis in AXIS_OF_TILT.choices)


def _measured_columns(parts: MeasuredParts) -> Iterator[str]:
    """Columns of the joints and their inputs."""
    for name, own, has_velocity in zip(parts.joints, parts.inputs, parts.has_velocity, strict=True):
        yield f"position:{name}"
        if own is not None:
            yield own.column
        if has_velocity:
            yield f"velocity:{name}"


_ONCE = ("stribeck", "position_friction", "stiffness", "cable_drag")


def _present(machine: Machine, name: str, joint: str) -> bool:
    return any(key.startswith(name) and v.get(JOINT) == joint for key, v in machine.effects.items())


def _moved_bodies(machine: Machine, moving: list[str]) -> Iterator[str]:
    """Bodies that a moving joint carries and that have a mass, those rigidly joined to another left out."""
    m = machine.mj_model
    carried = {int(m.jnt_bodyid[machine.joints.index(name)]) for name in moving}
    for k, name in enumerate(body_names(m), 1):
        if name and k in carried and m.body_subtreemass[k] > 0.0:
            yield name


def _channels(effect: str, parts: MeasuredParts, moving: list[str]) -> Iterator[str]:
    """Channels on which an effect of the sensors can show."""
    inputs = [own for own in parts.inputs if own is not None and own.drive.joint in moving]
    velocities = [n for n, has in zip(parts.joints, parts.has_velocity, strict=True) if has and n in moving]
    if effect == "sensor_delay":
        yield from (own.column for own in inputs)
        yield from (f"velocity:{name}" for name in velocities)
        # where a command drives the joint and no velocity was measured, `actuator_delay` is the same
        observed = {own.drive.joint for own in inputs if own.is_force} | set(velocities)
        yield from (f"position:{name}" for name in moving if name in observed)
        yield from (f"sensor:{name}" for name in parts.sensors)
        return
    kind = effect.partition("_")[0]
    if kind == "position":
        yield from (f"position:{name}" for name in moving)
    elif kind == "velocity":
        yield from (f"velocity:{name}" for name in velocities)
    elif effect == "force_scale":  # an offset of a force is `force_offset`
        yield from (own.column for own in inputs if own.is_force)
    elif kind == "sensor":
        yield from (f"sensor:{name}" for name in parts.sensors)


def _shapes(
    effect: Effect, selectors: Mapping[str, str], machine: Machine, spans: Spans
) -> tuple[CandidateParameter, ...]:
    """Parameters of an effect on a part, in the units of its joint, with bounds and trials by the logs."""
    kind, name = next(iter(selectors.items()), (JOINT, machine.joints[0]))
    if kind == BODY:
        return _payload(effect, machine, selectors[BODY], spans)
    joint = machine.joint_of(kind, name)
    if joint not in spans:
        return tuple(_plain(p) for p in effect.parameters)
    hinge = is_hinge(machine.mj_model, joint)
    shapes = []
    for p in effect.parameters:
        shape = dataclasses.replace(_plain(p), unit=joint_unit(p.unit, hinge))
        if effect.name in ("saturation", "soft_saturation"):
            peak = spans[joint].peak / abs(next(d.gear for d in machine.drives if d.joint == joint))
            shape = _limiting(shape, peak)
        elif effect.name == "backlash":
            reach = spans[joint].high - spans[joint].low
            shape = dataclasses.replace(shape, high=_WIDEST * reach, typical=_PLAY * reach)
        elif p.null_value is None:
            shape = _placed(shape, spans[joint])
        else:
            shape = _sized(shape, p.unit, spans[joint], machine)
            shape = _above_zero(shape, effect, machine, joint)
        shapes.append(shape)
    return tuple(shapes)


def _limiting(shape: CandidateParameter, peak: float) -> CandidateParameter:
    """Bounds and typical size of a limit, or of a fading, by the largest force of the actuator."""
    if shape.null_value == 0.0:
        return dataclasses.replace(shape, high=_FADED / peak, typical=NOTICED / peak)
    return dataclasses.replace(shape, low=0.1 * peak, high=peak, typical=0.7 * peak, null_value=peak)


def _plain(p) -> CandidateParameter:
    return CandidateParameter(p.name, p.unit, p.low, p.high, p.typical, p.null_value)


def _sized(shape: CandidateParameter, unit: str, span: JointSpan, machine: Machine) -> CandidateParameter:
    """Typical size of an amplitude: a tenth of the joint's force."""
    force = NOTICED * span.force
    speed, reach = 0.5 * span.speed, 0.5 * (span.high - span.low)
    typical = {
        "N": force,
        "N.s/m": force / speed,
        "N.s2/m2": force / speed**2,
        "N/m": force / reach,
        "kg": force / max(span.acceleration, 1e-9),
        "A": force / max(abs(machine.drives[0].gain), 1e-9) if machine.drives else None,
        "m/N": 0.02 * reach / span.force,
        "m": 0.05 * reach,
        "m/s": 0.05 * speed,
    }.get(unit)
    if typical is None:
        return shape
    low, high = max(shape.low, -_MOST * typical), min(shape.high, _MOST * typical)
    return dataclasses.replace(shape, low=low, high=high, typical=typical)


def _above_zero(
    shape: CandidateParameter, effect: Effect, machine: Machine, joint: str
) -> CandidateParameter:
    """Bound an amplitude so that what it adds to does not fall below zero.

    Extra friction, of a load, of a place or near standstill, only ever adds to dry friction. With either
    sign each of them stands in for another: less friction around one place for friction that grows with a
    load, say, and less near standstill for any friction that grows with the speed.
    """
    if effect.name in _EXTRA_FRICTION:
        own = apply_part_effects(machine).terms.get((JOINT, joint, _EXTRA_FRICTION[effect.name]), 0.0)
        return dataclasses.replace(shape, low=min(0.0 - own, 0.0))
    part = (JOINT, joint, effect.quantity)
    if effect.quantity not in QUANTITIES[JOINT]:
        return shape
    return dataclasses.replace(shape, low=max(shape.low, -machine.values[part]))


def _placed(shape: CandidateParameter, span: JointSpan) -> CandidateParameter:
    """Bounds and trials of a place, a width or a speed."""
    low, high, reach, top = span.low, span.high, span.high - span.low, span.speed
    middle = 0.5 * (low + high)
    bounds, trials = {
        "position": ((low, high, middle), tuple(low + share * reach for share in _PLACES)),
        "rest_position": ((low - reach, high + reach, middle), (low, middle, high)),
        "width": ((0.01 * reach, 0.5 * reach, 0.1 * reach), (0.05 * reach, 0.15 * reach)),
        "velocity": ((0.003 * top, _SLOW * top, 0.05 * top), tuple(share * top for share in _SPEEDS)),
    }[shape.name]
    return dataclasses.replace(shape, low=bounds[0], high=bounds[1], typical=bounds[2], trials=trials)


def _payload(effect: Effect, machine: Machine, body: str, spans: Spans) -> tuple[CandidateParameter, ...]:
    """Parameters of a payload on a body: its moment about the body's joint, and its distance.

    The moment is bounded by ten times that of the body with what it carries, or by what the strongest
    measured force can hold where that is more: a light link may carry many times its own mass.
    """
    m = machine.mj_model
    k = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, body)
    arm = _arm(m, k)
    mass, carried = float(m.body_mass[k]), float(m.body_subtreemass[k])
    first, second = map(_plain, effect.parameters)
    low, typical = -0.9 * mass, _ADDED * carried
    most = max(_MOST_CARRIED * carried, held_mass(machine, body, spans))
    if arm == 0.0:
        first = dataclasses.replace(first, low=low, high=_MOST_CARRIED * carried, typical=typical)
        return first, dataclasses.replace(second, low=0.0, high=0.0, typical=0.0, trials=(0.0,))
    first = dataclasses.replace(first, low=low * arm, high=most * arm, typical=typical * arm)
    trials = tuple(share * arm for share in _ARMS)
    second = dataclasses.replace(second, low=0.25 * arm, high=4.0 * arm, typical=arm, trials=trials)
    return (
        dataclasses.replace(first, times=second.name, least=low),
        dataclasses.replace(second, spread=max(_ARM_SPREAD * arm, _TO_END * _beyond_centre(m, k))),
    )


def _beyond_centre(m: mujoco.MjModel, body: int) -> float:
    """Length of a body beyond its centre of mass as seen from its joint, by spheres around its geoms [m]."""
    _, direction = joint_to_centre(m, body)
    own = m.geom_bodyid == body
    ends = (m.geom_pos[own] - m.body_ipos[body]) @ direction + m.geom_rbound[own]
    return float(ends.max(initial=0.0))


def held_mass(machine: Machine, body: str, spans: Spans) -> float:
    """Mass at a body's centre whose weight the largest force at its hinge can hold [kg]; 0 without."""
    m = machine.mj_model
    k = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, body)
    moment = float(np.linalg.norm(m.opt.gravity)) * _arm(m, k)
    if moment == 0.0:
        return 0.0
    hinges = [name for j, name in enumerate(machine.joints) if m.jnt_bodyid[j] == k and is_hinge(m, name)]
    return max((spans[name].peak / moment for name in hinges if name in spans), default=0.0)


def _arm(m: mujoco.MjModel, body: int) -> float:
    """Distance from a body's joint to its centre of mass [m]; 0 below a micrometre."""
    anchor, _ = joint_to_centre(m, body)
    arm = float(np.linalg.norm(m.body_ipos[body] - anchor))
    return arm if arm >= 1e-6 else 0.0


def free_curves(spans: Spans) -> dict[str, float]:
    """Variable of each free curve, `elbow speed`, or `speed` of the only joint → typical force [N or N.m]."""
    found = {}
    for name, span in spans.items():
        if span.is_excited:
            kinds = ("speed", "position", "time") if len(spans) < 3 else ("speed", "position")
            before = f"{name} " if len(spans) > 1 else ""
            found |= {f"{before}{kind}": NOTICED * span.force for kind in kinds}
    return found


def joint_span(
    position: Array, speed: Array, acceleration: Array, force: Array, noise: tuple[float, float]
) -> JointSpan:
    """Span of a joint from its smoothed motion and the force of its actuator or links, shape (n,) each."""
    low, high, top = float(position.min()), float(position.max()), float(np.abs(speed).max())
    moves = float(np.sqrt(np.mean(speed**2)))
    is_excited = high - low > 10.0 * noise[0] and moves > 5.0 * noise[1]
    size = max(float(np.sqrt(np.mean(force**2))), 1e-9)
    bend = max(float(np.sqrt(np.mean(acceleration**2))), 1e-9)
    peak = max(float(np.abs(force).max()), 1e-9)
    return JointSpan(low, max(high, low + 1e-9), max(top, 1e-9), bend, size, peak, is_excited)
