"""Pages of the reference made from the code: effects, keys of scenarios, JSON schemas, Python interface."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import omnimj
from omnimj import workflows
from omnimj.control.detection.detector import OPTION_FLAGS
from omnimj.effects.catalogue import EFFECTS, PLANTS, effects_of
from omnimj.effects.effect import AXIS, MJCF, RIG, ROBOT, Effect, EffectParameter
from omnimj.parameters import read_floors
from omnimj.parameters.reading import Rule
from omnimj.plant.faults import FAULT_KINDS, FaultKind
from omnimj.plant.ground import PATCH_KEYS
from omnimj.simulate.metrics import metric_units
from omnimj.simulate.scenario.drive import DRIVE_KEYS, KINDS
from omnimj.simulate.scenario.motion import CIRCLE_KEYS, PROFILE_KEYS, SQUARE_KEYS, WAYPOINT_KEYS
from omnimj.simulate.scenario.overrides import RIG_KEYS, ROBOT_KEYS
from omnimj.simulate.scenario.tables import DIAGNOSIS_KEYS, KINEMATIC_KEYS

SCHEMA_FOLDER = Path(omnimj.__file__).resolve().parent / "docs" / "schema"
"""JSON schemas of the files that commands write."""
_PLANT_WORDS = {RIG: "rig", ROBOT: "robot", AXIS: "linear axis", MJCF: "any machine"}
_PLACES = {
    "rail": "Rail of the rig",
    "guide": "Guide of the axis",
    "wheel": "Wheels",
    "motor": "Motors",
    "floor": "Floor",
    "body": "Body",
    "sensors": "Sensors",
}
_DECIMALS = 4
_DRIVES = {"profile": PROFILE_KEYS, "circle": CIRCLE_KEYS, "square": SQUARE_KEYS, "waypoints": WAYPOINT_KEYS}
_EFFECTS_GUIDE = """# Effects

Physics that a model may lack. `omnimj record --effect NAME:KEY=VALUE` adds one to the true machine,
`[effects.NAME]` in a model file makes it part of the model, and `omnimj gap` finds those that are missing.
*Vanishes at* is the value without effect; a parameter without one is a shape, such as a place or a width. The
bounds are wide physical ones.

This page is made from the catalogue in `omnimj/effects`."""
_API_GUIDE = """# Python interface

`import omnimj` takes no time: each name is loaded when it is first used. Everything is in SI units, and every
error that omnimj raises on purpose is an `OmnimjError`.
"""


def reference_pages() -> dict[str, str]:
    """Pages made from the code: name → Markdown."""
    return {
        "effects.md": effects_page(),
        "scenario_keys.md": scenario_keys_page(),
        "schemas.md": schemas_page(),
        "api.md": api_page(),
    }


def _number(value: float) -> str:
    return f"{value:.{_DECIMALS}g}" if math.isfinite(value) else "∞" if value > 0 else "−∞"


# effects


def effects_page() -> str:
    """All effects with their parameters, units and bounds, for each plant that they act on."""
    parts = [_EFFECTS_GUIDE]
    for where, title in _placed_titles():
        effects = [effect for effect in EFFECTS.values() if effect.where == where]
        parts.append(f"## {title}")
        parts += [_effect_text(effect) for effect in sorted(effects, key=lambda one: one.name)]
    return "\n\n".join(parts) + "\n"


def _placed_titles() -> Iterator[tuple[str, str]]:
    places = dict.fromkeys(effect.where for effect in EFFECTS.values())
    for where in (*(one for one in _PLACES if one in places), *(one for one in places if one not in _PLACES)):
        yield where, _PLACES.get(where, where.capitalize())


def _effect_text(effect: Effect) -> str:
    """Heading, description, choices and table of parameters of one effect."""
    words = effect.words[0].upper() + effect.words[1:]
    own = {plant: effects_of(plant)[effect.name] for plant in PLANTS if effect.name in effects_of(plant)}
    parts = [
        f"### `{effect.name}`",
        f"{words}.",
        f"Acts on: {', '.join(_PLANT_WORDS[plant] for plant in own)}.",
    ]
    offered = [selector for one in own.values() for selector in one.selectors]
    for selector in {one.name: one for one in offered}.values():
        alike = [one.choices for one in offered if one.name == selector.name]
        named = _choices(list(dict.fromkeys(choice for choices in alike for choice in choices)))
        parts.append(f"Choice `{selector.name}`{' (optional)' if selector.optional else ''}: {named}.")
    parts.append(_parameters_table(own))
    return "\n\n".join(part for part in parts if part)


def _choices(choices: Sequence[str | int]) -> str:
    if not choices:
        return "any name"
    if all(isinstance(choice, int) for choice in choices):
        return f"{min(choices)} to {max(choices)}"
    return ", ".join(f"`{choice}`" for choice in choices)


def _parameters_table(own: Mapping[str, Effect]) -> str:
    """Parameters of an effect; plants with other bounds have lines of their own."""
    grouped: dict[EffectParameter, list[str]] = {}
    for plant, effect in own.items():
        for parameter in effect.parameters:
            grouped.setdefault(parameter, []).append(plant)
    if not grouped:
        return ""
    several = any(len(plants) < len(own) for plants in grouped.values())
    head = ("parameter", "unit", "low", "high", "typical", "vanishes at", *(("plants",) if several else ()))
    rows = []
    for parameter, plants in grouped.items():
        null = "–" if parameter.null_value is None else _number(parameter.null_value)
        numbers = (_number(parameter.low), _number(parameter.high), _number(parameter.typical))
        acts = (", ".join(_PLANT_WORDS[plant] for plant in plants),) if several else ()
        rows.append((f"`{parameter.name}`", parameter.unit, *numbers, null, *acts))
    return table(head, rows)


# scenarios


def scenario_keys_page() -> str:
    """Every key that a scenario file may have."""
    metrics = metric_units("uto_robot", 4, True, False)
    rig_metrics = metric_units("quarter_rig", 1, False, False)
    kinds = "\n\n".join(_fault_text(name, kind) for name, kind in FAULT_KINDS.items())
    own = {kind: _DRIVES.get(kind, ()) for kind in KINDS}
    common = tuple(key for key in DRIVE_KEYS if not any(key in keys for keys in own.values()))
    drives = "\n".join(f"| `{kind}` | {_keys(keys)} |" for kind, keys in own.items())
    return f"""# Keys of a scenario

Every key that a scenario file may have, made from the code that reads it; how to write one:
[Scenarios](scenarios.md). `--set KEY=VALUE` takes the same keys with dots between them (`faults.0.loss`); an
unknown key is answered with those that exist.

## Top level

| plant | keys |
|---|---|
| `uto_robot`: any robot | {_keys(ROBOT_KEYS)} |
| `quarter_rig`: the test rig | {_keys(RIG_KEYS)} |

`description`, `plant`, `floor` and `duration` are needed, and `drive` of a robot, `current` [A] of the rig.
Floors that are shipped: {_keys(read_floors())}.

## Drive

Keys of all kinds of drive: {_keys(common)}.

| `kind` | further keys |
|---|---|
{drives}

Speeds are in m/s or `"low"`, `"high"`; accelerations in m/s²; angles in rad; times in s; lengths in m.

## Faults

A `[[faults]]` table has `kind`, `onset` [s], optionally `end` [s], and for a fault of one wheel `wheel`.

{kinds}

## Patches

`[[patches]]`: rectangles of another floor, with {_keys(PATCH_KEYS)}; centre and size in m as `[x, y]`, yaw in
rad.

## Diagnosis

`[diagnosis]`: {_keys(DIAGNOSIS_KEYS)}. True or false: {_keys(OPTION_FLAGS)}.

## Kinematics

`[kinematics]`, with `level = "kinematic"`: {_keys(KINEMATIC_KEYS)}.

## Checks

`[checks]` bounds metrics, `NAME = LIMIT` from above or `NAME = {{ min = …, max = … }}`; `[checks.robust]`,
`[checks.published]` and `[checks.off]` hold for one method.

{table(("metric of a robot with four wheels", "unit"), [(f"`{k}`", v or "–") for k, v in metrics.items()])}

{table(("metric of the rig", "unit"), [(f"`{k}`", v or "–") for k, v in rig_metrics.items()])}
"""


def _keys(names: Sequence[str] | Mapping[str, Any]) -> str:
    return ", ".join(f"`{name}`" for name in names) or "–"


def _fault_text(name: str, kind: FaultKind) -> str:
    if not kind.own_keys:
        return f"### `{name}`\n\n{_fault_place(kind)}; no further keys."
    rows = [(f"`{key}`", _rule(kind.numbers[key]), _presence(kind, key)) for key in kind.numbers]
    rows = [(f"`{key}`", "a name", _presence(kind, key)) for key in kind.names] + rows
    return f"### `{name}`\n\n{_fault_place(kind)}.\n\n{table(('key', 'value', ''), rows)}"


def _fault_place(kind: FaultKind) -> str:
    if "channel" in kind.names:
        return "On one measured channel"
    return "On one wheel" if kind.on_wheel else "On the whole robot"


def _presence(kind: FaultKind, key: str) -> str:
    if key in kind.one_of:
        others = " or ".join(f"`{one}`" for one in kind.one_of if one != key)
        return f"either this or {others}"
    if key in kind.defaults:
        return f"optional, {kind.defaults[key]:g} by default"
    return "optional" if key in kind.optional else "needed"


def _rule(rule: Rule) -> str:
    return f"a number; {rule}"


# JSON schemas


def schemas_page() -> str:
    """The JSON schemas of the files that commands write, as tables."""
    parts = [
        "# JSON files\n\nFiles that commands write for programs. Each keeps to a JSON schema, "
        "which tests hold against every output; more keys may come. The schemas are part of the package, in "
        "`omnimj/docs/schema`."
    ]
    for file in sorted(SCHEMA_FOLDER.glob("*.json")):
        schema = json.loads(file.read_text(encoding="utf-8"))
        rows = list(_schema_rows(schema, "", schema))
        keys = table(("key", "type", "always there"), rows)
        parts.append(f"## `{file.name}`\n\n[Schema](schema/{file.name})\n\n{keys}")
    return "\n\n".join(parts) + "\n"


def _schema_rows(
    schema: Mapping[str, Any], prefix: str, root: Mapping[str, Any]
) -> Iterator[tuple[str, str, str]]:
    """Rows of all keys of an object and of what it holds."""
    schema = _resolved(schema, root)
    needed = schema.get("required", ())
    for key, entry in schema.get("properties", {}).items():
        entry = _resolved(entry, root)
        name = f"{prefix}{key}"
        yield f"`{name}`", _schema_type(entry, root), "yes" if key in needed else ""
        yield from _schema_rows(entry, f"{name}.", root)
        if isinstance(items := entry.get("items"), Mapping):
            yield from _schema_rows(items, f"{name}[].", root)
    if isinstance(others := schema.get("additionalProperties"), Mapping):
        others = _resolved(others, root)
        yield f"`{prefix}NAME`", _schema_type(others, root), ""
        yield from _schema_rows(others, f"{prefix}NAME.", root)


def _resolved(schema: Mapping[str, Any], root: Mapping[str, Any]) -> Mapping[str, Any]:
    reference = schema.get("$ref")
    if not isinstance(reference, str):
        return schema
    node: Any = root
    for part in reference.removeprefix("#/").split("/"):
        node = node[part]
    return node


def _schema_type(schema: Mapping[str, Any], root: Mapping[str, Any]) -> str:
    if "enum" in schema:
        return " or ".join(f"`{json.dumps(choice)}`" for choice in schema["enum"])
    for key in ("oneOf", "anyOf"):
        if key in schema:
            return " or ".join(_schema_type(_resolved(one, root), root) for one in schema[key])
    found = schema.get("type", "any")
    names = [found] if isinstance(found, str) else list(found)
    if "items" in schema and "array" in names:
        held = _schema_type(_resolved(schema["items"], root), root)
        names[names.index("array")] = f"list of {held}"
    bounds = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    limits = [f"{sign} {schema[key]:g}" for key, sign in bounds.items() if key in schema]
    return " or ".join(names) + (f", {', '.join(limits)}" if limits else "")


# Python interface


def api_page() -> str:
    """The public names of `omnimj`, for mkdocstrings, in groups: functions, then records and classes."""
    names = [name for name in omnimj.__all__ if not name.startswith("_")]
    errors = [name for name in names if name.endswith("Error")]
    functions = [name for name in names if name[0].islower()]
    jobs = [name for name in functions if name in workflows.__all__]
    others = [name for name in functions if name not in jobs]
    classes = [name for name in names if name[0].isupper() and name not in errors]
    groups = {
        "Jobs": jobs,
        "Reading and writing": others,
        "Machines, controllers and records": classes,
        "Errors": errors,
    }
    parts = [_API_GUIDE]
    for title, members in groups.items():
        parts += [f"## {title}", *(f"::: omnimj.{name}" for name in members)]
    return "\n\n".join(parts) + "\n"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; a bar in a cell is escaped."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |" for line in lines)
