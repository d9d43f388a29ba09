"""Any machine: an MJCF file, and what is uncertain about it and its effects in NAME.toml beside NAME.xml.

```toml
[uncertain.joint.elbow]
damping = { half_width = 0.02, unit = "N.m.s/rad" }   # the value is that of the MJCF file, or `value = …`

[effects.stribeck]
joint = "elbow"
force = { value = 0.1, unit = "N.m", source = "identified" }
velocity = { value = 0.2, unit = "rad/s", source = "identified" }

[sensors]
on_link = ["elbow"]   # joints whose encoder is on the link: play lies before it
```
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mujoco

from omnimj.effects import MJCF, complete_values, find_effect
from omnimj.effects.effect import Effect
from omnimj.effects.parts import ACTUATOR, BODY, CHANNEL, JOINT, Part, PartChanges, joint_unit
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.model_file import EffectValues, read_effects
from omnimj.parameters.reading import Provenance, Rule, check_number, check_table, read_toml
from omnimj.plant.mujoco.quantities import (
    BACK_EMF,
    QUANTITIES,
    Drive,
    body_names,
    is_hinge,
    joint_names,
    read_drives,
    read_values,
    sensor_names,
    unit_of,
)

_TABLES = ("uncertain", "effects", "sensors")
_KEYS = ("value", "half_width", "unit")
_POSITIVE, _FINITE = Rule(0.0, math.inf, True), Rule(-math.inf, math.inf, False)
_OBJECT = mujoco.mjtObj
_FLOATING = (
    "the forces on a floating base are in no log: fix the base to the world and log the machine on a stand, "
    "or lifted"
)
_BALL = "its position is no single number: write three hinges, and log their angles"
_LOOP = (
    "the force in a closed loop follows from no position: leave the constraint out and log with the loop "
    "open, or give the driven branch the inertia of the other"
)
_COUPLED = (
    "how coupled joints share their load is in no log: keep the driven joint alone, with the inertia of the "
    "other as armature (times the square of the ratio)"
)
_TENDON = "its springs and dampers can be replayed, nothing else: state this on the joints"
_UNNAMED = "columns of the dataset name the parts: give it one"


@dataclass(frozen=True)
class Uncertain:
    """Quantity that is refitted before any effect is considered."""

    part: Part
    unit: str
    value: float
    half_width: float
    label: str = ""
    beyond: float = 0.0
    """Constant by which the value exceeds that of the part: a total mass includes the armature."""

    @property
    def name(self) -> str:
        """Name in messages and results: `elbow.damping`, unless it has a label."""
        return self.label or f"{self.part[1]}.{self.part[2]}"


@dataclass(frozen=True)
class Machine:
    """Machine that an MJCF file describes: fixed base, hinges and slides, actuators on joints, sensors."""

    file: Path
    """The MJCF file."""
    mj_model: mujoco.MjModel
    drives: tuple[Drive, ...]
    values: Mapping[Part, float]
    """Values of all quantities."""
    uncertain: tuple[Uncertain, ...] = ()
    effects: EffectValues = field(default_factory=dict)
    provenance: Mapping[str, Provenance] = field(default_factory=dict)
    """`effects.NAME.PARAMETER` → unit and source."""
    plant: str = MJCF
    """Plant whose names the effects have."""
    encoders_on_links: tuple[str, ...] = ()
    """Joints whose position is measured on the link, behind a play; that of the others on the motor."""
    forces_are_declared: bool = False
    """True if a logged force is the command times the declared gain, False if it was measured."""
    column_names: Mapping[str, str] = field(default_factory=dict)
    """Channel → its name in the logs and results, where this is another one."""

    @property
    def facts(self) -> Path:
        """The TOML file beside the MJCF file; it need not exist."""
        return self.file.with_suffix(".toml")

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return joint_names(self.mj_model)

    def parts(self, kind: str) -> tuple[str, ...]:
        """Names of all parts of a kind."""
        names = {JOINT: self.joints, BODY: tuple(filter(None, body_names(self.mj_model)))}
        names[ACTUATOR] = tuple(d.name for d in self.drives)
        return names[kind]

    def joint_of(self, kind: str, name: str) -> str:
        """Joint whose type gives the units of an effect on a part; empty for a body or a sensor."""
        if kind == CHANNEL:
            kind, _, name = name.partition(":")
            kind = {"position": JOINT, "velocity": JOINT, "force": ACTUATOR, "control": ACTUATOR}.get(
                kind, ""
            )
        if kind == ACTUATOR:
            return next((d.joint for d in self.drives if d.name == name), "")
        return name if kind == JOINT else ""

    def unit(self, effect: Effect, unit: str, selectors: Mapping[str, Any]) -> str:
        """Unit of a parameter of an effect on the selected part."""
        for selector in effect.selectors:
            joint = self.joint_of(selector.name, str(selectors.get(selector.name, "")))
            if joint and joint in self.joints:
                return joint_unit(unit, is_hinge(self.mj_model, joint))
        return unit


def read_machine_file(path: Path | None) -> Machine:
    """Read an MJCF file and the TOML file beside it.

    Args:
      path: The MJCF file.

    Raises:
      InputError: No file, not MJCF, a structure that cannot be replayed, or a wrong value; the message names
        the part.
      UnknownNameError: An unknown part, quantity or effect; the message lists the choices.
    """
    if path is None:
        rule = 'pass --model FILE.xml, or model = "FILE.xml" in dataset.toml'
        raise InputError("--model", "is missing", f"a dataset of any machine needs its MJCF file: {rule}")
    mj_model = _compile(path)
    refuse_structure(mj_model, path)
    drives = read_drives(mj_model, path)
    machine = Machine(path, mj_model, drives, read_values(mj_model, drives))
    if not machine.facts.is_file():
        return machine
    tree = read_toml(machine.facts)
    for key in tree:
        if key not in _TABLES:
            raise UnknownNameError(machine.facts, "table", key, _TABLES)
    provenance: dict[str, Provenance] = {}
    effects = read_effects(tree, machine.facts, provenance)
    uncertain = tuple(_uncertain(machine, tree.get("uncertain", {})))
    on_links = tuple(_on_links(machine, tree.get("sensors", {})))
    found = replace(
        machine, uncertain=uncertain, effects=effects, provenance=provenance, encoders_on_links=on_links
    )
    apply_part_effects(found)
    return found


def _compile(path: Path) -> mujoco.MjModel:
    if not path.is_file():
        found = "is a folder" if path.is_dir() else "no such file"
        raise InputError(path, found, "an MJCF file is needed")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        _name_actuators(spec)
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(path, "is not an MJCF model", " ".join(str(error).split())) from None


def _name_actuators(spec: mujoco.MjSpec) -> None:
    """Give actuators without a name that of their joint, unless another one has it."""
    taken = {actuator.name for actuator in spec.actuators}
    for actuator in spec.actuators:
        of_joint = actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT and actuator.target not in taken
        if of_joint and not actuator.name:
            actuator.name = actuator.target
            taken.add(actuator.name)


def _on_links(machine: Machine, tree: Any) -> Iterator[str]:
    """Yield the joints of `[sensors] on_link`."""
    place = f"{machine.facts}: sensors"
    for key, names in check_table(place, tree).items():
        if key != "on_link":
            raise UnknownNameError(place, "key", key, ("on_link",))
        if not isinstance(names, list):
            raise InputError(f"{place}.{key}", f"found {names!r}", "must be a list of joints")
        for name in names:
            if name not in machine.joints:
                raise UnknownNameError(f"{place}.{key}", JOINT, name, machine.joints)
            yield name


def _uncertain(machine: Machine, tree: Any):
    """Yield the entries of `[uncertain.KIND.PART]`."""
    file = machine.facts
    for kind, parts in check_table(f"{file}: uncertain", tree).items():
        if kind not in QUANTITIES:
            raise UnknownNameError(f"{file}: uncertain", "kind of part", kind, QUANTITIES)
        for name, entries in check_table(f"{file}: uncertain.{kind}", parts).items():
            if name not in machine.parts(kind):
                raise UnknownNameError(f"{file}: uncertain.{kind}", kind, name, machine.parts(kind))
            place = f"{file}: uncertain.{kind}.{name}"
            known = [k for (t, n, k) in machine.values if (t, n) == (kind, name) and k != BACK_EMF]
            for key, entry in check_table(place, entries).items():
                if key not in known:
                    raise UnknownNameError(place, f"quantity of this {kind}", key, known)
                yield _quantity(machine, (kind, name, key), f"{place}.{key}", entry)


def _quantity(machine: Machine, part: Part, place: str, entry: Any) -> Uncertain:
    unit = unit_of(machine.mj_model, machine.drives, part)
    shape = f'write {{ half_width = …, unit = "{unit}" }}, and value = … unless that of the MJCF file holds'
    if not isinstance(entry, Mapping):
        raise InputError(place, f"found {entry!r}", shape)
    for key in entry:
        if key not in _KEYS:
            raise UnknownNameError(place, "key", key, _KEYS)
    for key in ("half_width", "unit"):
        if key not in entry:
            raise InputError(place, f"'{key}' is missing", shape)
    if entry["unit"] != unit:
        raise InputError(f"{place}.unit", f"found {entry['unit']!r}", f"the unit is {unit!r}")
    half = float(check_number(f"{place}.half_width", entry["half_width"], _POSITIVE))
    value = float(check_number(f"{place}.value", entry.get("value", machine.values[part]), _FINITE))
    lowest = QUANTITIES[part[0]][part[2]].lowest
    if value < lowest:
        raise InputError(f"{place}.value", f"found {value:g}", f"must be at least {lowest:g} {unit}")
    return Uncertain(part, unit, value, half)


def apply_part_effects(machine: Machine) -> PartChanges:
    """Collect the changes of a machine's effects.

    Raises:
      InputError: An effect is incomplete, or a value or unit is wrong.
      UnknownNameError: An unknown effect, parameter or part.
    """
    changes = PartChanges(machine.values)
    for name, given in machine.effects.items():
        place = f"{machine.facts}: effects.{name}"
        effect = find_effect(name, machine.plant, f"{machine.facts}: effects")
        values = complete_values(effect, given, place, partial=False)
        _require_parts(machine, effect, values, place)
        _require_units(machine, name, effect, values)
        for hook in effect.hooks:
            hook(changes, values)
    return changes


def with_part_effects(machine: Machine, effects: Mapping[str, Mapping[str, Any]]) -> Machine:
    """Copy of a machine with further effects; an effect of the same name is replaced.

    Args:
      machine: The machine.
      effects: Name → parameter or part → value; missing values are filled in as in `complete_values`.

    Raises:
      InputError: A value out of bounds or missing.
      UnknownNameError: An unknown effect, parameter or part.
    """
    full = dict(machine.effects)
    for name, values in effects.items():
        effect, place = find_effect(name, machine.plant, "effects"), f"effects.{name}"
        given = {**_only_parts(machine, effect), **values}
        for selector in effect.selectors:
            if not selector.choices and selector.name not in given:
                found, rule = f"'{selector.name}' is missing", "name one of the choices"
                raise InputError(place, found, rule, _choices(machine, selector.name))
        full[name] = complete_values(effect, given, place)
        _require_parts(machine, effect, full[name], place)
    changed = replace(machine, effects=full)
    apply_part_effects(changed)
    return changed


def _only_parts(machine: Machine, effect: Effect) -> dict[str, str]:
    """Selectors for which the machine has a single part."""
    kinds = [s.name for s in effect.selectors if s.name in (JOINT, ACTUATOR, BODY)]
    return {kind: names[0] for kind in kinds if len(names := machine.parts(kind)) == 1}


def _require_parts(machine: Machine, effect: Effect, values: Mapping[str, Any], place: str) -> None:
    for selector in effect.selectors:
        if selector.choices:
            continue
        chosen, known = values[selector.name], _choices(machine, selector.name)
        if chosen not in known:
            raise UnknownNameError(place, selector.name, chosen, known)


def _choices(machine: Machine, kind: str) -> tuple[str, ...]:
    """Names of the parts, or channels, that an effect can act on."""
    return channel_names(machine) if kind == CHANNEL else machine.parts(kind)


def _require_units(machine: Machine, name: str, effect: Effect, values: Mapping[str, Any]) -> None:
    for parameter in effect.parameters:
        origin = machine.provenance.get(f"effects.{name}.{parameter.name}")
        unit = machine.unit(effect, parameter.unit, values)
        if origin is not None and origin.unit != unit:
            place = f"{machine.facts}: effects.{name}.{parameter.name}.unit"
            raise InputError(place, f"found {origin.unit!r}", f"the unit is {unit!r}")


def channel_names(machine: Machine) -> tuple[str, ...]:
    """Columns that a dataset of this machine can have."""
    actuators = machine.parts(ACTUATOR)
    return (
        *(f"{kind}:{name}" for kind in ("position", "velocity") for name in machine.joints),
        *(f"{kind}:{name}" for kind in ("force", "control", "enabled") for name in actuators),
        *(f"sensor:{name}" for name in sensor_names(machine.mj_model) if name),
    )


def refuse_structure(m: mujoco.MjModel, path: Path) -> None:
    """Refuse what cannot be replayed.

    Constraints that are switched off, and tendons that are springs and dampers alone, are no hindrance.

    Args:
      m: The compiled model.
      path: Its file, for messages.

    Raises:
      InputError: The message names the first such part, the reason and the remedy.
    """
    for place, found, rule in _hindrances(m, path):
        raise InputError(place, found, rule)


def _hindrances(m: mujoco.MjModel, path: Path) -> Iterator[tuple[str, str, str]]:
    """Yield place, what was found, and the remedy."""
    if m.nflex:
        what, rule = "is a flexible body", "no log names its motion: write rigid bodies and joints"
        yield f"{path}: flex {_name(m, _OBJECT.mjOBJ_FLEX, 0)!r}", what, rule
    if m.nplugin:
        what, rule = "is a plugin", "its forces are not known here: leave it out, or write it in plain MJCF"
        yield f"{path}: plugin {_name(m, _OBJECT.mjOBJ_PLUGIN, 0)!r}", what, rule
    yield from _joints(m, path)
    yield from _constraints(m, path)
    yield from _tendons(m, path)
    for k in range(m.nu):
        if not mujoco.mj_id2name(m, _OBJECT.mjOBJ_ACTUATOR, k):
            yield f"{path}: actuator {k + 1}", "has no name", _UNNAMED


def _joints(m: mujoco.MjModel, path: Path) -> Iterator[tuple[str, str, str]]:
    if not m.njnt:
        yield str(path), "has no joints", "a machine that moves is needed"
    for k, name in enumerate(joint_names(m)):
        body = _name(m, _OBJECT.mjOBJ_BODY, int(m.jnt_bodyid[k]))
        place = f"{path}: joint {name or k + 1!r} of body {body!r}"
        if m.jnt_type[k] == mujoco.mjtJoint.mjJNT_FREE:
            yield place, "is a free joint", _FLOATING
        elif m.jnt_type[k] == mujoco.mjtJoint.mjJNT_BALL:
            yield place, "is a ball joint", _BALL
        elif not name:
            yield place, "has no name", _UNNAMED


def _constraints(m: mujoco.MjModel, path: Path) -> Iterator[tuple[str, str, str]]:
    for k in range(m.neq):
        if not m.eq_active0[k]:
            continue
        kind = mujoco.mjtEq(m.eq_type[k])
        place = f"{path}: equality {_name(m, _OBJECT.mjOBJ_EQUALITY, k)!r}"
        if kind == mujoco.mjtEq.mjEQ_JOINT:
            names = joint_names(m)
            first, second = int(m.eq_obj1id[k]), int(m.eq_obj2id[k])
            other = f"to joint {names[second]!r}" if second >= 0 else "to a constant"
            yield place, f"couples joint {names[first]!r} {other}", _COUPLED
        elif kind == mujoco.mjtEq.mjEQ_TENDON:
            yield place, "couples tendons", _LOOP
        else:
            words = kind.name.removeprefix("mjEQ_").lower()
            yield place, f"closes a loop ({words})", _LOOP


def _tendons(m: mujoco.MjModel, path: Path) -> Iterator[tuple[str, str, str]]:
    for k in range(m.ntendon):
        forces = {
            "frictionloss": m.tendon_frictionloss[k],
            "armature": m.tendon_armature[k],
            "range": m.tendon_limited[k],
        }
        acting = [name for name, value in forces.items() if value]
        if acting:
            place = f"{path}: tendon {_name(m, _OBJECT.mjOBJ_TENDON, k)!r}"
            yield place, f"has {acting[0]}", _TENDON


def _name(m: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    return mujoco.mj_id2name(m, kind, index) or str(index + 1)
