"""New files of a machine: its MJCF with changed values, and the TOML file with what MJCF cannot express.

The text of the MJCF file is kept but for the attributes that change; one assembled from several files is
written as a whole by MuJoCo, with six digits.
"""

from __future__ import annotations

import dataclasses
import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import tomlkit

from omnimj.effects import MJCF, Interval, find_effect
from omnimj.effects.mjcf import NO_LIMIT
from omnimj.effects.model_writer import effect_entry
from omnimj.effects.parts import ACTUATOR, BODY, JOINT, Part, PartChanges
from omnimj.errors import InputError
from omnimj.plant.mujoco.machine import Machine, apply_part_effects
from omnimj.plant.mujoco.quantities import (
    Drive,
    changed_drive,
    changed_values,
    is_hinge,
    tilted_gravity,
    with_masses,
)

SAID = (
    "coulomb",
    "viscous",
    "quadratic_friction",
    "armature",
    "gain",
    "torque_constant",
    "back_emf",
    "actuator_lag",
    "saturation",
    "payload",
    "grade",
)
"""Effects that MJCF can express; they become values of the MJCF file."""
_ACTUATORS = ("general", "motor", "position", "velocity", "damper", "dcmotor")
_COMMON = {
    *("name", "class", "group", "joint", "jointinparent", "gear", "ctrllimited", "ctrlrange"),
    *("forcelimited", "forcerange", "user", "lengthrange", "actlimited", "actrange", "actdim"),
    *("armature", "damping", "delay"),
}
"""Attributes that `general` has in common with the other actuators."""


def new_machine_files(
    machine: Machine, own: Mapping[Part, float], effects: Mapping[str, Mapping[str, Any]], name: str
) -> dict[str, str]:
    """Texts of the new MJCF file and of the TOML file beside it.

    Args:
      machine: The machine that the search began with.
      own: Refitted values.
      effects: Named effects, name of their table → selectors and parameters (numbers or intervals).
      name: Stem of the new files.

    Returns:
      File name → text.

    Raises:
      InputError: A part cannot be found in the text of the MJCF file.
    """
    said = {key: v for key, v in effects.items() if find_effect(key, MJCF, key).name in SAID}
    plain = {key: {k: getattr(v, "value", v) for k, v in values.items()} for key, values in said.items()}
    changes = apply_part_effects(dataclasses.replace(machine, effects=plain, provenance={}))
    values = changed_values(machine.values, own, changes)
    rest = {key: v for key, v in effects.items() if key not in said}
    return {
        f"{name}.xml": mjcf_text(machine, values, changes),
        f"{name}.toml": facts_text(machine, values, rest),
    }


def mjcf_text(machine: Machine, values: Mapping[Part, float], changes: PartChanges) -> str:
    """Text of the MJCF file with other values.

    Args:
      machine: The machine.
      values: Values of all its quantities.
      changes: Payloads, direction of gravity and limits of forces.
    """
    builder = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
    root = ET.fromstring(machine.file.read_bytes(), builder)
    if any(node.tag in ("include", "attach", "replicate") for node in root.iter()):
        root = ET.fromstring(mujoco.MjSpec.from_file(str(machine.file)).to_xml())
    _make_absolute(root, machine.file.parent.absolute())
    changed = {part for part, value in values.items() if value != machine.values[part]}
    for joint in machine.joints:
        keys = {key for kind, name, key in changed if (kind, name) == (JOINT, joint)}
        if keys:
            _write_joint(_find(root, ("joint",), joint, machine), machine, joint, keys, values)
    for drive in machine.drives:
        limit = changes.limits.get(drive.name, NO_LIMIT)
        if limit < NO_LIMIT or any((kind, name) == (ACTUATOR, drive.name) for kind, name, _ in changed):
            new = changed_drive(drive, values, limit if limit < NO_LIMIT else math.inf)
            _write_drive(_find_drive(root, drive, machine), drive, new)
    bodies = {name for kind, name, _ in changed if kind == BODY} | {p.body for p in changes.payloads}
    model = with_masses(machine.mj_model, values, changes.payloads)
    for body in bodies:
        _write_inertia(_find(root, ("body",), body, machine), model, body)
    if any(changes.tilt.values()):
        option = root.find("option")
        option = ET.SubElement(root, "option") if option is None else option
        option.set("gravity", _numbers(tilted_gravity(machine.mj_model.opt.gravity, changes.tilt)))
    return ET.tostring(root, encoding="unicode") + "\n"


def _make_absolute(root: ET.Element, folder: Path) -> None:
    """Let the new file find meshes and textures from any folder."""
    if root.find("asset") is None or not any("file" in node.attrib for node in root.iter()):
        return
    compiler = root.find("compiler")
    compiler = ET.SubElement(root, "compiler") if compiler is None else compiler
    common = compiler.attrib.pop("assetdir", "")
    for key in ("meshdir", "texturedir"):
        compiler.set(key, (folder / compiler.get(key, common)).as_posix())


def _find(root: ET.Element, tags: tuple[str, ...], name: str, machine: Machine) -> ET.Element:
    for node in root.iter():
        if node.tag in tags and node.get("name") == name:
            return node
    raise InputError(f"{machine.file}: {tags[0]} {name!r}", "is not in the text of this file")


def _find_drive(root: ET.Element, drive: Drive, machine: Machine) -> ET.Element:
    """Node of an actuator; one without a name is that of its joint."""
    for node in root.iter():
        unnamed = node.tag in _ACTUATORS and not node.get("name") and drive.name == drive.joint
        if unnamed and node.get("joint") == drive.joint:
            return node
    return _find(root, _ACTUATORS, drive.name, machine)


def _number(value: float) -> str:
    return repr(float(value))


def _numbers(values: Any) -> str:
    return " ".join(_number(v) for v in values)


def _write_joint(
    node: ET.Element, machine: Machine, joint: str, keys: set[str], values: Mapping[Part, float]
) -> None:
    m = machine.mj_model
    k = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_JOINT, joint)
    dof = m.jnt_dofadr[k]
    if keys & {"damping", "quadratic_damping"}:
        terms = [values[JOINT, joint, "damping"], values[JOINT, joint, "quadratic_damping"]]
        terms.append(float(m.dof_dampingpoly[dof, 1]))
        while len(terms) > 1 and terms[-1] == 0.0:
            terms.pop()
        node.set("damping", _numbers(terms))
    for key in keys & {"frictionloss", "armature"}:
        node.set(key, _number(values[JOINT, joint, key]))
    if "stiffness" in keys:
        node.set("stiffness", _numbers([values[JOINT, joint, "stiffness"], *m.jnt_stiffnesspoly[k]]))
    if "springref" in keys:
        in_degrees = is_hinge(m, joint) and _in_degrees(machine)
        angle = values[JOINT, joint, "springref"]
        node.set("springref", _number(math.degrees(angle) if in_degrees else angle))


def _in_degrees(machine: Machine) -> bool:
    return bool(mujoco.MjSpec.from_file(str(machine.file)).compiler.degree)


def _write_drive(node: ET.Element, old: Drive, new: Drive) -> None:
    """Write an actuator as `general`, the form that can say all its numbers."""
    for key in [key for key in node.attrib if key not in _COMMON]:
        del node.attrib[key]
    node.tag = "general"
    node.set("gaintype", "fixed")
    node.set("gainprm", _number(new.gain))
    bias = (new.bias, new.position_gain, new.velocity_gain)
    node.set("biastype", "affine" if any(bias) else "none")
    if any(bias):
        node.set("biasprm", _numbers(bias))
    node.set("dyntype", "filterexact" if new.lag > 0.0 else "none")
    if new.lag > 0.0:
        node.set("dynprm", _number(new.lag))
    if all(map(math.isfinite, old.command_range)):
        node.set("ctrllimited", "true")
        node.set("ctrlrange", _numbers(old.command_range))
    if all(map(math.isfinite, new.force_range)):
        node.set("forcelimited", "true")
        node.set("forcerange", _numbers(new.force_range))


def _write_inertia(node: ET.Element, model: mujoco.MjModel, body: str) -> None:
    k = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body)
    for old in node.findall("inertial"):
        node.remove(old)
    about = {"mass": [model.body_mass[k]], "pos": model.body_ipos[k], "quat": model.body_iquat[k]}
    about["diaginertia"] = model.body_inertia[k]
    node.insert(0, ET.Element("inertial", {key: _numbers(np.atleast_1d(v)) for key, v in about.items()}))


def facts_text(
    machine: Machine, values: Mapping[Part, float], effects: Mapping[str, Mapping[str, Any]]
) -> str:
    """Text of the TOML file: what is still uncertain, the effects that the file had, and further ones.

    Args:
      machine: The machine.
      values: New values of all quantities.
      effects: Effects that MJCF cannot express.
    """
    document = tomlkit.document()
    words = "Half widths of what is uncertain, and the effects that MJCF cannot express."
    document.add(tomlkit.comment(words))
    for one in machine.uncertain:
        kind, name, key = one.part
        entry = tomlkit.inline_table()
        entry.update({"half_width": one.half_width, "unit": one.unit})
        table: Any = document
        for part in ("uncertain", kind, name):
            if part not in table:
                table[part] = tomlkit.table(is_super_table=part != name)
            table = table[part]
        table[key] = entry
    if machine.effects or effects:
        document["effects"] = tomlkit.table(is_super_table=True)
    all_effects: Any = document.get("effects", {})
    for name, given in {**machine.effects, **effects}.items():
        all_effects[name] = _effect_table(machine, name, given)
    return tomlkit.dumps(document)


def _effect_table(machine: Machine, name: str, given: Mapping[str, Any]) -> Any:
    effect, table = find_effect(name, MJCF, name), tomlkit.table()
    table.comment(effect.words)
    for selector in effect.selectors:
        table[selector.name] = given[selector.name]
    for parameter in effect.parameters:
        value = given[parameter.name]
        number = value.value if isinstance(value, Interval) else value
        unit = machine.unit(effect, parameter.unit, given)
        table[parameter.name] = effect_entry(float(number), unit, value)
    return table
