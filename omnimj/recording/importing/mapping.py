"""Mapping files: how the columns of a log become those of a dataset, read and written as TOML."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import (
    Rule,
    check_choice,
    check_flag,
    check_number,
    check_table,
    check_text,
    read_toml,
    require_keys,
)
from omnimj.recording.dataset import PLANT_COLUMNS
from omnimj.recording.dataset_file import CONDITION_KEYS, POSE_MEASURED
from omnimj.recording.importing.dialect import DECIMALS, SEPARATORS, Dialect
from omnimj.recording.importing.topics.join import JOINS, STAMPS, TopicChoice
from omnimj.recording.importing.units import find_unit, known_units
from omnimj.recording.run_table import printable
from omnimj.recording.write_dataset import toml_entries, toml_key, toml_text

if TYPE_CHECKING:
    from omnimj.recording.importing.propose import Proposal

PLANTS = tuple(PLANT_COLUMNS)
EMPTY_RULES = ("refuse", "drop", "hold")
"""Treatments of rows in which a mapped column is empty."""

_TOP = ("plant", "empty", "defaults", "csv", "topics", "columns", "pose", "stale", "runs")
_FINITE = Rule(-math.inf, math.inf, False)
_POSITIVE = Rule(0.0, math.inf, True)
_BITS = Rule(2, 64, False)
_LINES = Rule(0, 10_000, False)
_HEAD = """# How the columns of a log become those of a dataset; edit it, then
#   omnimj import FILE... --mapping THIS_FILE --out DATASET
# column = { from = "its name in the log", unit = "mm/s", scale = 2.0, offset = 0.0 }, offset and scale in SI.
# difference = true: change per second (of a counter); wrap = 65536: it starts over; signed = 16: 65535 is -1;
# sign_of = "a column": a magnitude gets its sign; times = "a column": the product of both.
# floor = "{folder}": the name of the folder of each log.
# [pose] rotation = 0.1: x, y and heading turned by this angle in rad."""
_EXAMPLE = 'write { from = "name of a column", unit = "mm/s" }'


@dataclass(frozen=True)
class ColumnSource:
    """Where a column of the dataset comes from: offset + scale × factor of the unit × reading."""

    source: str
    """Column of the log; `from` in the file."""
    unit: str | None = None
    """Unit of the log's column; that written in the log when None."""
    scale: float | None = None
    """Factor; 1 when None, and the unit of the log must then be that of the column."""
    offset: float = 0.0
    """Offset in the SI unit of the column."""
    difference: bool = False
    """Whether the column is the reading's change since the row before, per time."""
    wrap: float | None = None
    """Range of a counter or angle that starts over, in the log's unit, such as 65536 or 360."""
    signed: int | None = None
    """Bits of whole numbers below 0 that were logged without their sign: with 16, 65535 is -1."""
    sign_of: str | None = None
    """Column of the log whose sign a magnitude gets."""
    times: str | None = None
    """Column of the log that multiplies the reading: the supply voltage of a share of it."""


@dataclass(frozen=True)
class StaleRule:
    """Rows that the log repeats: none of `unchanged` changes although one of `moving` is not 0."""

    unchanged: tuple[str, ...]
    moving: tuple[str, ...]


@dataclass(frozen=True)
class LogMapping:
    """Content of a mapping file."""

    plant: str
    columns: Mapping[str, ColumnSource]
    """Columns of the dataset."""
    defaults: Mapping[str, float | str | bool] = field(default_factory=dict)
    runs: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)
    """Conditions of individual runs by name."""
    dialect: Dialect = field(default_factory=Dialect)
    stale: StaleRule | None = None
    rotation: float = 0.0
    """Angle by which the measured pose is turned about its origin, counter-clockwise [rad]."""
    empty: str = EMPTY_RULES[0]
    topics: TopicChoice | None = None
    """Rules by which the topics of recorded messages are joined."""

    @property
    def sources(self) -> tuple[str, ...]:
        """Columns of the log that are needed."""
        rules = self.columns.values()
        stale = (*self.stale.unchanged, *self.stale.moving) if self.stale else ()
        named = [name for rule in rules for name in (rule.source, rule.sign_of, rule.times) if name]
        return tuple(dict.fromkeys((*named, *stale)))


def read_mapping(path: Path) -> LogMapping:
    """Read a mapping file.

    Raises:
      InputError: The file is missing or not TOML, or a value breaks its rule.
      UnknownNameError: A plant or key does not exist; the message lists the choices.
    """
    tree = read_toml(path)
    require_keys(path, tree, _TOP)
    plant = check_choice(f"{path}: plant", tree.get("plant"), PLANTS, "plant")
    entries = check_table(f"{path}: [columns]", tree.get("columns", {}))
    columns = {name: _column(f"{path}: columns.{printable(name)}", entry) for name, entry in entries.items()}
    if "time" not in columns:
        raise InputError(f"{path}: [columns]", "'time' is missing", _EXAMPLE)
    if columns["time"].difference:
        raise InputError(f"{path}: columns.time", "found difference = true", "time itself is needed")
    runs = check_table(f"{path}: [runs]", tree.get("runs", {}))
    return LogMapping(
        plant,
        columns,
        _conditions(f"{path}: [defaults]", tree.get("defaults", {}), (*CONDITION_KEYS, POSE_MEASURED)),
        {
            name: _conditions(f"{path}: [runs.{printable(name)}]", t, CONDITION_KEYS)
            for name, t in runs.items()
        },
        _dialect(f"{path}: csv", tree.get("csv", {})),
        _stale(f"{path}: [stale]", tree.get("stale")),
        _rotation(f"{path}: [pose]", tree.get("pose", {})),
        check_choice(f"{path}: empty", tree.get("empty", EMPTY_RULES[0]), EMPTY_RULES, "rule"),
        _topics(f"{path}: [topics]", tree.get("topics")),
    )


def _column(place: str, entry: Any) -> ColumnSource:
    if not isinstance(entry, Mapping):
        raise InputError(place, f"found {entry!r}", _EXAMPLE)
    keys = ["from" if f.name == "source" else f.name for f in fields(ColumnSource)]
    require_keys(place, entry, keys)
    if "from" not in entry:
        raise InputError(place, "'from' is missing", _EXAMPLE)
    unit = check_text(f"{place}.unit", entry["unit"]) if "unit" in entry else None
    if unit is not None and find_unit(unit) is None:
        raise UnknownNameError(f"{place}.unit", "unit", unit, known_units())
    scale = float(check_number(f"{place}.scale", entry["scale"], _FINITE)) if "scale" in entry else None
    if scale == 0.0:
        raise InputError(f"{place}.scale", "found 0", "must not be 0")
    wrap = float(check_number(f"{place}.wrap", entry["wrap"], _POSITIVE)) if "wrap" in entry else None
    return ColumnSource(
        check_text(f"{place}.from", entry["from"]),
        unit,
        scale,
        float(check_number(f"{place}.offset", entry.get("offset", 0.0), _FINITE)),
        check_flag(f"{place}.difference", entry.get("difference", False)),
        wrap,
        int(check_number(f"{place}.signed", entry["signed"], _BITS, True)) if "signed" in entry else None,
        check_text(f"{place}.sign_of", entry["sign_of"]) if "sign_of" in entry else None,
        check_text(f"{place}.times", entry["times"]) if "times" in entry else None,
    )


def _dialect(place: str, entry: Any) -> Dialect:
    names = [f.name for f in fields(Dialect)]
    require_keys(place, check_table(place, entry), names)
    lines = {
        name: int(check_number(f"{place}.{name}", entry[name], _LINES, whole=True))
        for name in names
        if name.endswith("_line") and name in entry
    }
    if lines.get("first_line") == 0:
        raise InputError(f"{place}.first_line", "found 0", "lines are counted from 1")
    texts: dict[str, Any] = {
        name: check_choice(f"{place}.{name}", entry[name], choices, name)
        for name, choices in (("separator", SEPARATORS), ("decimal", DECIMALS))
        if name in entry
    }
    return Dialect(**{**texts, **lines})


def _topics(place: str, entry: Any) -> TopicChoice | None:
    if entry is None:
        return None
    require_keys(place, check_table(place, entry), [f.name for f in fields(TopicChoice)])
    return TopicChoice(
        check_text(f"{place}: base", entry["base"]) if "base" in entry else None,
        check_choice(f"{place}: join", entry.get("join", JOINS[0]), JOINS, "rule"),
        check_choice(f"{place}: stamps", entry["stamps"], STAMPS, "clock") if "stamps" in entry else None,
    )


def _stale(place: str, entry: Any) -> StaleRule | None:
    if entry is None:
        return None
    require_keys(place, check_table(place, entry), ("unchanged", "moving"))
    names = {}
    for key in ("unchanged", "moving"):
        found = entry.get(key)
        if not isinstance(found, list) or not found or not all(isinstance(name, str) for name in found):
            raise InputError(f"{place}: {key}", f"found {found!r}", "a list of columns of the log is needed")
        names[key] = tuple(found)
    return StaleRule(**names)


def _rotation(place: str, entry: Any) -> float:
    require_keys(place, check_table(place, entry), ("rotation",))
    return float(check_number(f"{place}: rotation", entry.get("rotation", 0.0), _FINITE))


def _conditions(place: str, entry: Any, keys: Sequence[str]) -> dict[str, Any]:
    """Read conditions; floors may be those of a file of the user, and are checked where they are used."""
    found: dict[str, Any] = {}
    require_keys(place, check_table(place, entry), keys)
    for key, value in entry.items():
        at = f"{place}: {key}"
        if key == "mass":
            found[key] = float(check_number(at, value, _POSITIVE))
        elif key == POSE_MEASURED:
            found[key] = check_flag(at, value)
        else:
            found[key] = check_text(at, value)
    return found


def mapping_text(proposal: Proposal) -> str:
    """Return the text of a mapping file that `read_mapping` reads back; remarks become comments."""
    mapping = proposal.mapping
    lines = [_HEAD, "", f"plant = {toml_text(mapping.plant)}"]
    if mapping.empty != LogMapping.empty:
        lines.append(f"empty = {toml_text(mapping.empty)}")
    lines += ["", "[defaults]", *toml_entries(mapping.defaults)]
    lines += [f"# {name.removeprefix('[defaults] ')} = ?" for name in proposal.missing if "]" in name]
    dialect = {f.name: getattr(mapping.dialect, f.name) for f in fields(mapping.dialect)}
    if any(value is not None for value in dialect.values()):
        lines += ["", "[csv]", *toml_entries({k: v for k, v in dialect.items() if v is not None})]
    if mapping.topics is not None:
        lines += ["", *_topics_text(mapping.topics)]
    lines += ["", "[columns]"]
    for target, rule in mapping.columns.items():
        remark = proposal.remarks.get(target)
        lines.append(f"{toml_key(target)} = {_column_text(rule)}{f'  # {remark}' if remark else ''}")
    lines += [f"# {name} = {{ from = ? }}" for name in proposal.missing if "]" not in name]
    lines += proposal.hints
    if mapping.rotation:
        lines += ["", "[pose]", f"rotation = {mapping.rotation!r}"]
    if mapping.stale is not None:
        lines += ["", "[stale]  # rows in which none of the first changes though one of the second is not 0"]
        lines += [f"unchanged = {_list(mapping.stale.unchanged)}", f"moving = {_list(mapping.stale.moving)}"]
    for name, conditions in mapping.runs.items():
        lines += ["", f"[runs.{toml_key(name)}]", *toml_entries(conditions)]
    return "\n".join(lines) + "\n"


def _topics_text(choice: TopicChoice) -> list[str]:
    words = "# a row at each stamp of this topic; the others are joined to it"
    lines = ["[topics]", f"base = {toml_text(choice.base)}  {words}"] if choice.base else ["[topics]"]
    lines.append(f"join = {toml_text(choice.join)}  # linear or previous")
    if choice.stamps:
        lines.append(f"stamps = {toml_text(choice.stamps)}  # header or log")
    return lines


def _column_text(rule: ColumnSource) -> str:
    parts = [f"from = {toml_text(rule.source)}"]
    for f in fields(ColumnSource)[1:]:
        value = getattr(rule, f.name)
        if value is not None and value != f.default:
            parts.append(f"{f.name} = {toml_text(value)}")
    return f"{{ {', '.join(parts)} }}"


def _list(names: tuple[str, ...]) -> str:
    return f"[{', '.join(map(toml_text, names))}]"
