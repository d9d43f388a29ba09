"""Model files inside of MJCF files: what `omnimj robot` writes for plain MuJoCo is a model file as well.

Such a file holds `<custom><text name="omnimj_robot" data="…"/></custom>`: the tables of the model file as
JSON, which is kept when MuJoCo saves the file. Places of wheels, sizes of rollers and the body's mass stand
in the MJCF, too, and must agree with the tables, so that a file edited by hand is not misread.
"""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from omnimj.errors import InputError
from omnimj.parameters.reading import read_regular_file, read_toml

MJCF_SUFFIX = ".xml"
"""Suffix by which an MJCF file is known."""
# as `omnimj.wheels.model_text` writes them
_TEXT = "omnimj_robot"  # name of the text that holds the tables
_NO_TWIN = "no_twin"  # only key of a robot for which omnimj has no twin: the reason
_REMEDY = "a file of `omnimj robot` holds one; for other machines write a copy of robot.toml"
_EDITED = "the file was edited; write it anew with `omnimj robot`, or give a model file (.toml)"
_TOLERANCE = 1e-5  # relative, of numbers that MJCF files hold with 8 digits, or 6 where MuJoCo wrote them


def is_mjcf(path: Path) -> bool:
    """True for a path with the suffix of an MJCF file."""
    return path.suffix.lower() == MJCF_SUFFIX


def read_model_tree(path: Path) -> dict[str, Any]:
    """Read the tables of a model file: TOML, or an MJCF file of `omnimj robot`.

    Args:
      path: Path of the file; one with the suffix `.xml` is an MJCF file.

    Raises:
      InputError: The file cannot be read, holds no model file, or was edited; the message says what is wrong.
    """
    if not is_mjcf(path):
        return read_toml(path)
    root = _read_xml(path)
    element = root.find(f"custom/text[@name='{_TEXT}']")
    if element is None:
        raise InputError(path, f'has no <custom><text name="{_TEXT}"> with motors and sensors', _REMEDY)
    tree = _parse(path, element.get("data") or element.text or "")  # MuJoCo itself writes a text
    if _NO_TWIN in tree:
        raise InputError(path, "is a robot without a twin", str(tree[_NO_TWIN]))
    for name, found, stated in _stated_twice(root, tree):
        if not math.isclose(found, stated, rel_tol=_TOLERANCE, abs_tol=1e-7):
            raise InputError(f"{path}: {name}", f"is {found:g}, its {_TEXT} says {stated:g}", _EDITED)
    return tree


def _read_xml(path: Path) -> ET.Element:
    content = read_regular_file(path, "an MJCF file")
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise InputError(path, "defines a document type", "MJCF files have none")
    try:
        return ET.fromstring(content)
    except (ET.ParseError, LookupError, ValueError) as error:  # LookupError: of an unknown encoding
        raise InputError(path, "is not valid XML", " ".join(str(error).split())) from None


def _parse(path: Path, data: str) -> dict[str, Any]:
    place = f"{path}: {_TEXT}"
    try:
        tree = json.loads(data, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise InputError(place, "is not the text of a model file", str(error)) from None
    if not isinstance(tree, dict):
        raise InputError(place, f"found {tree!r}", "tables of a model file are needed")
    return tree


def _refuse(name: str) -> float:
    raise ValueError(f"{name} is not finite")


def _stated_twice(root: ET.Element, tree: Mapping[str, Any]) -> Iterator[tuple[str, float, float]]:
    """Numbers that MJCF and tables both state: name, MJCF's, the tables'; what is malformed is left out."""
    bodies = {body.get("name", ""): body for body in root.iter("body")}
    mounts = tree.get("wheels")
    count = len(mounts) if isinstance(mounts, list) else 0
    for i in range(1, count + 1):
        body, mount = bodies.get(f"wheel_{i}_wheel"), (mounts, i - 1)
        if body is not None:
            yield from _numbers(f"wheel_{i}_wheel: pos", _floats(body.get("pos")), _value(*mount, "position"))
            yield from _numbers(f"wheel_{i}_wheel: ahead", _ahead(body), _value(*mount, "drives_along"))
    mass, wheel = _value(tree, "body", "mass"), _value(tree, "wheel", "mass")
    inertial = bodies["chassis"].find("inertial") if "chassis" in bodies else None
    if count and inertial is not None and isinstance(mass, float) and isinstance(wheel, float):
        yield from _numbers("chassis: mass", _floats(inertial.get("mass")), [mass - count * wheel])
    radius, around = _value(tree, "wheel", "roller_radius"), _value(tree, "wheel", "radius")
    if isinstance(radius, float) and isinstance(around, float):
        geom = root.find(".//default[@class='roller']/geom")
        if geom is not None:
            yield from _numbers("roller: size", _floats(geom.get("size"))[1:], [radius, radius])
        first = next((body for name, body in bodies.items() if name.startswith("wheel_1_roller")), None)
        place = _floats(None if first is None else first.get("pos"))
        if len(place) == 3:
            yield "wheel_1_roller: distance from the axle", math.hypot(place[0], place[2]), around - radius


def _numbers(name: str, found: list[float], stated: Any) -> Iterator[tuple[str, float, float]]:
    for number, other in zip(found, stated if isinstance(stated, list) else (), strict=False):
        if isinstance(other, int | float):
            yield name, number, float(other)


def _ahead(body: ET.Element) -> list[float]:
    """Direction in which a wheel drives, x and y, by its turn about z; MuJoCo writes a quaternion."""
    quaternion, angles = _floats(body.get("quat")), _floats(body.get("euler"))
    if len(quaternion) == 4:
        yaw = 2.0 * math.atan2(quaternion[3], quaternion[0])
    else:
        yaw = math.radians(angles[2]) if len(angles) == 3 else 0.0
    return [math.cos(yaw), math.sin(yaw)]


def _floats(text: str | None) -> list[float]:
    try:
        return [float(word) for word in (text or "").split()]
    except ValueError:
        return []


def _value(tree: Any, *keys: Any) -> Any:
    """Value of a quantity under keys; None where the tables have another form."""
    for key in (*keys, "value"):
        try:
            tree = tree[key]
        except (KeyError, IndexError, TypeError):
            return None
    return float(tree) if isinstance(tree, int) and not isinstance(tree, bool) else tree
