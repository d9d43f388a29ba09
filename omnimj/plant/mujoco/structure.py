"""Structures of MJCF files that logs of joints and actuators cannot explain, each refused in one line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco

from omnimj.errors import InputError
from omnimj.plant.mujoco.quantities import joint_names

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
