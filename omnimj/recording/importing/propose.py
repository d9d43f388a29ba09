"""Proposal of a mapping: which column of a log is which of the dataset, by its name, unit and values."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from omnimj.recording.dataset import MAX_WHEELS, MIN_WHEELS, MJCF, PLANT_COLUMNS, plant_columns
from omnimj.recording.dataset_file import POSE_MEASURED
from omnimj.recording.importing.mapping import ColumnSource, LogMapping, StaleRule
from omnimj.recording.importing.tables import SourceColumn, SourceTable
from omnimj.recording.importing.topics.quantities import JOINT_EFFORT, JOINT_POSITION, JOINT_VELOCITY
from omnimj.recording.importing.units import RAW_UNITS, find_unit, target_unit
from omnimj.recording.logger_faults import is_magnitude

_SET = re.compile(r"set|target|cmd|command|ref|desired|goal|soll")
_CHANGE = re.compile(r"^d(x|y|t|ang|theta|phi)?$|delta|error|diff")
_ORDINAL = re.compile(r"\b(\d+)(st|nd|rd|th)\b")
_STEPS = (5e-5, 0.06)  # [s] plausible time steps: 20 kHz … 17 Hz
_WHEEL = re.compile(r"wheel|motor|drive|whl", re.IGNORECASE)
_JOINT_COLUMNS = {JOINT_VELOCITY: "wheel_speed", JOINT_EFFORT: "current"}  # of a robot
_PART_COLUMNS = {JOINT_POSITION: "position", JOINT_VELOCITY: "velocity", JOINT_EFFORT: "force"}  # of an MJCF
_ODOMETRY = "nav_msgs/Odometry"
_MOST_OTHERS = 40
_PER_WHEEL = ("current", "current_target", "wheel_speed", "counter")
_PATTERNS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    # kind, names, SI units that the column may have
    ("time", r"^(t|time.*|timestamp.*|stamp|zeit.*|elapsed.*|sec|secs|seconds)$", ("s",)),
    ("yaw_rate", r"yaw_?rate|gyro(_?z)?$|omega_?z|^wz$|angular_?vel.*z", ("rad/s",)),
    ("acceleration_x", r"^a(cc\w*)?[_.]?x$|acceleration_?x", ("m/s2",)),
    ("acceleration_y", r"^a(cc\w*)?[_.]?y$|acceleration_?y", ("m/s2",)),
    ("current", r"cur(r(ent)?)?|amp(ere)?s?$|strom|^i_?\d+$", ("A",)),
    ("x", r"^(x|px|x_?pos(ition)?|pos(ition)?[_.]?x|x_?(global|world|pose)|pose[_.]?x)$", ("m",)),
    ("y", r"^(y|py|y_?pos(ition)?|pos(ition)?[_.]?y|y_?(global|world|pose)|pose[_.]?y)$", ("m",)),
    ("heading", r"^(heading|theta|phi|psi|ang|angle|orientation|yaw|rot(ation)?_?z)$", ("rad",)),
    ("counter", r"tick|enc|count|pos", RAW_UNITS),
    ("wheel_speed", r"vel|speed|omega|rpm|drehzahl|^w_?\d+$|^qd_?\d+$", ("rad/s", "m/s")),
)


@dataclass(frozen=True)
class Proposal:
    """Proposed mapping, and what a person must check or add."""

    mapping: LogMapping
    remarks: Mapping[str, str] = field(default_factory=dict)
    """Points to check, by column of the dataset."""
    missing: tuple[str, ...] = ()
    """Columns and conditions that the plant needs and the log does not show."""
    unclear: tuple[str, ...] = ()
    """Columns that need a scale, since the log has raw readings."""
    hints: tuple[str, ...] = ()
    """Further lines for the mapping file, as comments."""

    @property
    def is_complete(self) -> bool:
        """True if a dataset can be written without a person."""
        return not self.missing and not self.unclear


def propose(tables: Sequence[SourceTable], plant: str | None = None, floor: str | None = None) -> Proposal:
    """Propose a mapping for logs of one kind; the plant is guessed where it is not given."""
    columns = tables[0].columns
    found = _by_kind(columns)
    plant = plant or _plant(columns, found)
    remarks: dict[str, str] = {}
    if plant == "uto_robot":
        chosen = _robot(columns, found, remarks)
    elif plant == MJCF:
        chosen = _any_machine(columns, remarks)
    else:
        chosen = _exact(columns, plant)
        chosen |= _kept(found, set(chosen), set(PLANT_COLUMNS[plant].known))
    if "time" not in chosen and found.get("time"):
        chosen = {"time": ColumnSource(found["time"][0]), **chosen}
    if "time" in chosen:
        chosen["time"] = _timed(tables, chosen["time"], remarks)
    chosen = {target: _with_unit(columns, target, rule) for target, rule in _in_order(chosen, plant)}
    chosen = {target: _with_sign_bit(tables, target, rule, remarks) for target, rule in chosen.items()}
    hints: list[str] = []
    stale = None
    if plant == "uto_robot":
        chosen = _with_signs(tables, chosen, remarks)
        stale = _counters(tables, found, chosen, hints)
    mapping = _with_conditions(plant, chosen, stale, floor)
    if tables[0].choice is not None:
        mapping = _with_topics(tables, mapping, hints)
    unclear = _unclear(columns, chosen, remarks)
    return Proposal(mapping, remarks, _missing(mapping), unclear, tuple(hints))


def missing_columns(names: Sequence[str], plant: str, pose_measured: bool | None = None) -> tuple[str, ...]:
    """List the columns that a plant needs and that are not among the names of a dataset's columns."""
    wheels = wheel_count(names)
    if pose_measured is None:
        pose_measured = bool({"x", "y", "heading"} & set(names)) and "acceleration_x" not in names
    needed = plant_columns(plant, wheels, pose_measured)
    missing = [name for name in needed.required if name not in names]
    if needed.one_of and not any(name in names for name in needed.one_of):
        missing.append(" or ".join(needed.one_of))
    return tuple(missing)


def wheel_count(names: Sequence[str]) -> int:
    """Number of wheels whose current or speed is among these names; that of a four-wheel robot if none is."""
    numbers = [
        int(found[2]) for name in names if (found := re.fullmatch(r"(current|wheel_speed)_(\d+)", name))
    ]
    return min(max(numbers, default=4), MAX_WHEELS) if max(numbers, default=0) >= MIN_WHEELS else 4


def _exact(columns: Mapping[str, SourceColumn], plant: str) -> dict[str, ColumnSource]:
    """Columns that have the names of omnimj, or whose messages identify them."""
    known = plant_columns(plant, MAX_WHEELS)
    found: dict[str, ColumnSource] = {}
    for name, column in columns.items():
        if known.has(column.kind):
            found.setdefault(column.kind, ColumnSource(name))
    return found | {name: ColumnSource(name) for name in columns if known.has(name)}


def _with_topics(tables: Sequence[SourceTable], mapping: LogMapping, hints: list[str]) -> LogMapping:
    """Add how the topics are joined; rows that a topic does not cover are left out."""
    columns = tables[0].columns
    gaps = any(np.isnan(column.values).any() for table in tables for column in table.columns.values())
    used = {rule.source for rule in mapping.columns.values()}
    others = [name for name in columns if name not in used][:_MOST_OTHERS]
    if others:
        hints += ["# not used:", *(f"#   {name}" for name in others)]
    pose = mapping.columns.get("x")
    if pose is not None and columns[pose.source].words == _ODOMETRY:
        defaults = {key: value for key, value in mapping.defaults.items() if key != POSE_MEASURED}
        hints.append(f"# the pose is that of {_ODOMETRY}: under [defaults], pose_measured = true if a camera")
        hints.append("# or motion capture measured it; a pose summed up from the wheels is not measured")
        mapping = replace(mapping, defaults=defaults)
    return replace(mapping, topics=tables[0].choice, empty="drop" if gaps else mapping.empty)


def _joint_numbers(columns: Mapping[str, SourceColumn]) -> dict[str, int]:
    """Numbers of the wheels by joint: those in their names where each has one, else their order."""
    parts = [c.part for c in columns.values() if c.kind in _JOINT_COLUMNS and _WHEEL.search(c.part)]
    parts = list(dict.fromkeys(parts))
    in_names = [_number(part, "") for part in parts]
    numbers = [number for number in in_names if number is not None]
    if len(set(numbers)) == len(parts):
        return dict(zip(parts, numbers, strict=True))
    return {part: k + 1 for k, part in enumerate(parts)}


def _by_kind(columns: Mapping[str, SourceColumn]) -> dict[str, list[str]]:
    """Names of the columns by what they are; those of wheels as `current_1`, `counter_2` …"""
    found: dict[str, list[str]] = {}
    numbered: dict[str, dict[str, int]] = {}
    joints = _joint_numbers(columns)
    for name, column in columns.items():
        if column.kind:
            kind = _JOINT_COLUMNS.get(column.kind)
            if kind and column.part in joints:
                numbered.setdefault(kind, {})[name] = joints[column.part]
            elif not column.part:
                found.setdefault(column.kind, []).append(name)
            continue
        kind = _kind(name, column)
        if kind is None:
            continue
        number = _number(name, column.words)
        if kind in _PER_WHEEL:
            if number is not None:
                numbered.setdefault(kind, {})[name] = number
        else:
            found.setdefault(kind, []).append(name)
    for kind, numbers in numbered.items():
        first = 1 - min(numbers.values())  # some loggers count from 0
        for name, number in numbers.items():
            found.setdefault(f"{kind}_{number + max(first, 0)}", []).append(name)
    return found


def _kind(name: str, column: SourceColumn) -> str | None:
    """Quantity of a column by its name and unit, or by its description; None if unknown."""
    unit = find_unit(column.unit) if column.unit else None
    plain = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower().strip()
    both = f"{plain} {column.words.lower()}"
    if _CHANGE.search(plain) or _CHANGE.search(column.words.lower()):
        return None
    for kind, pattern, units in _PATTERNS:
        if not re.search(pattern, plain):
            continue
        if kind == "counter" and (unit is None or unit.si):
            continue
        if unit is not None and unit.si and unit.si not in units:
            continue
        if _SET.search(both):
            return "current_target" if kind == "current" else None
        return kind
    return None


def _number(name: str, words: str) -> int | None:
    """Number of the wheel in a name, or in its description."""
    in_name = re.findall(r"\d+", name)
    if len(in_name) == 1:
        return int(in_name[0])
    in_words = _ORDINAL.search(words)
    return int(in_words[1]) if in_words else None


def _plant(columns: Mapping[str, SourceColumn], found: Mapping[str, list[str]]) -> str:
    wheels = [n for n in range(1, MAX_WHEELS + 1) if f"wheel_speed_{n}" in found or f"counter_{n}" in found]
    if len(wheels) >= MIN_WHEELS:
        return "uto_robot"
    exact = {
        plant: sum(name in columns for name in needed.required) / len(needed.required)
        for plant, needed in PLANT_COLUMNS.items()
        if not needed.prefixes  # any log fits it
    }
    best = max(exact, key=lambda plant: exact[plant])
    if exact[best] > 0.7:
        units = {name: find_unit(columns[name].unit) for name in ("position", "velocity") if name in columns}
        turns = any(unit is not None and unit.si in ("rad", "rad/s") for unit in units.values())
        has_force = any(name in columns for name in PLANT_COLUMNS["linear_axis"].one_of)
        if best != "linear_axis" or (has_force and not turns):
            return best
    return MJCF


def _robot(
    columns: Mapping[str, SourceColumn], found: Mapping[str, list[str]], remarks: dict[str, str]
) -> dict[str, ColumnSource]:
    known = plant_columns("uto_robot", MAX_WHEELS).known
    chosen = _exact(columns, "uto_robot")
    chosen |= _kept(found, set(chosen), set(known))
    for target, rule in chosen.items():
        others = [name for name in found.get(target, ()) if name != rule.source]
        if others:
            remarks[target] = f"or {', '.join(others)}"
        source = columns[rule.source]
        if source.part:
            _remark_joint(target, source.part, remarks)
            continue
        about = f"{rule.source} {source.words}".lower()
        if target.startswith("wheel_speed") and re.search(r"motor|^m\d", about):
            remarks[target] = "a motor's speed: scale = 1 / gear"
        elif target == "heading" and rule.source != "heading" and not source.kind:
            remarks[target] = "the angle of the robot's x axis; offset in rad"
    if {"x", "y"} <= set(chosen) and "heading" not in chosen and "yaw" in chosen:
        chosen["heading"] = chosen["yaw"]
    return chosen


def _remark_joint(target: str, part: str, remarks: dict[str, str]) -> None:
    """State which joint a wheel is where its name has no number, or another one."""
    number = target.rpartition("_")[2]
    if f"{_number(part, '')}" != number:
        remarks[target] = f"wheel {number} by the order in the messages: check that it is {part}"


def _kept(found: Mapping[str, list[str]], taken: set[str], known: set[str]) -> dict[str, ColumnSource]:
    return {
        kind: ColumnSource(names[0]) for kind, names in found.items() if kind in known and kind not in taken
    }


def _any_machine(columns: Mapping[str, SourceColumn], remarks: dict[str, str]) -> dict[str, ColumnSource]:
    """Columns of one joint and its actuator; everything else is a sensor of its name.

    Columns that have the names of a dataset, such as `position:elbow`, keep them.
    """
    chosen: dict[str, ColumnSource] = _exact(columns, MJCF)
    joints = {name: column for name, column in columns.items() if column.part}
    for name, column in joints.items():
        target = f"{_PART_COLUMNS[column.kind]}:{column.part}"
        chosen.setdefault(target, ColumnSource(name))
        part = "an actuator" if column.kind == JOINT_EFFORT else "a joint"
        remarks[target] = f"the name after the colon is {part} of your MJCF file"
    if joints:
        return chosen
    ready, taken = any(":" in target for target in chosen), {rule.source for rule in chosen.values()}
    for name in columns:
        plain = name.lower()
        if name in taken:
            continue
        if re.search(_PATTERNS[0][1], plain):
            target = "time"
        elif ready:
            target = f"sensor:{name}"
        elif _SET.search(plain):
            target = "control:motor"
        elif re.search(r"pos|angle|^q$", plain):
            target = "position:joint"
        elif re.search(r"vel|speed|^qd$", plain):
            target = "velocity:joint"
        elif re.search(r"(force|torque|effort)$", plain):
            target = "force:motor"
        else:
            target = f"sensor:{name}"
        if target in chosen:
            target = f"sensor:{name}"
        chosen[target] = ColumnSource(name)
        if ":" in target and not target.startswith("sensor"):
            remarks[target] = "the name after the colon is that in your MJCF file"
    return chosen


def _timed(tables: Sequence[SourceTable], rule: ColumnSource, remarks: dict[str, str]) -> ColumnSource:
    """Find the unit of time by its steps where none is written."""
    column = tables[0].columns[rule.source]
    if column.unit and find_unit(column.unit) is not None:
        return rule
    steps = np.diff(column.values)
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    if not len(steps):
        return rule
    step = float(np.median(steps))
    for unit, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if _STEPS[0] <= step * factor <= _STEPS[1]:
            remarks["time"] = f"no unit is written; a step of {step:.4g} suggests {unit}"
            return replace(rule, unit=unit)
    remarks["time"] = f"no unit is written; a step is {step:.4g}"
    return rule


def _in_order(chosen: Mapping[str, ColumnSource], plant: str) -> list[tuple[str, ColumnSource]]:
    """Columns in the order in which the plant lists them, time first."""
    known = plant_columns(plant, MAX_WHEELS).known
    return sorted(chosen.items(), key=lambda one: known.index(one[0]) if one[0] in known else len(known))


def _with_sign_bit(
    tables: Sequence[SourceTable], target: str, rule: ColumnSource, remarks: dict[str, str]
) -> ColumnSource:
    """Recognise whole numbers below 0 that were logged without their sign: 65535 for -1."""
    found = [t.columns[rule.source].values for t in tables if rule.source in t.columns]
    values = np.concatenate(found)
    values = values[np.isfinite(values)]
    if not len(values) or values.min() < 0.0 or np.any(values != np.round(values)):
        return rule
    for bits in (16, 32):
        top = 2.0**bits
        high, low = values > 0.75 * top, values < 0.25 * top
        if values.max() < top and high.any() and low.any() and bool(np.all(high | low)):
            remarks[target] = f"{int(values.max())} is {int(values.max() - top)} logged without its sign"
            return replace(rule, signed=bits)
    return rule


def _with_unit(columns: Mapping[str, SourceColumn], target: str, rule: ColumnSource) -> ColumnSource:
    written = columns[rule.source].unit
    unit = find_unit(written) if written else None
    if rule.unit is None and unit is not None and unit.si:
        rule = replace(rule, unit=written)
    if target in ("heading", "yaw") and unit is not None and unit.si == "rad":
        rule = replace(rule, wrap=round(2.0 * np.pi / unit.factor, 9))
    return rule


def _with_signs(
    tables: Sequence[SourceTable], chosen: Mapping[str, ColumnSource], remarks: dict[str, str]
) -> dict[str, ColumnSource]:
    """Give currents that are never negative the sign of their wheel's speed."""
    done = dict(chosen)
    for target, rule in chosen.items():
        number = target.removeprefix("current_")
        speed = chosen.get(f"wheel_speed_{number}")
        if not target.startswith("current_") or speed is None or not number.isdigit():
            continue
        if tables[0].columns[rule.source].kind:  # messages define the sign
            continue
        having = [t.columns for t in tables if {rule.source, speed.source} <= set(t.columns)]
        values = [np.nan_to_num(c[rule.source].values) for c in having]
        if is_magnitude(values, [np.nan_to_num(c[speed.source].values) for c in having]):
            done[target] = replace(rule, sign_of=speed.source)
            remarks[target] = f"never negative though {speed.source} changes its sign: a magnitude"
    return done


def _counts(tables: Sequence[SourceTable], counter: str, speed: str) -> bool:
    """True if a counter changes in most rows in which its motor turns; some loggers leave it at 0."""
    changed = turning = 0
    for columns in (t.columns for t in tables if {counter, speed} <= set(t.columns)):
        turns = columns[speed].values[1:] != 0.0
        turning += int(np.count_nonzero(turns))
        changed += int(np.count_nonzero(turns & (np.diff(columns[counter].values) != 0.0)))
    return changed > 0.5 * turning


def _counters(
    tables: Sequence[SourceTable],
    found: Mapping[str, list[str]],
    chosen: Mapping[str, ColumnSource],
    hints: list[str],
) -> StaleRule | None:
    """Rule for stale rows from counters and speeds of the same motors, with a hint at finer speeds."""
    every = range(1, MAX_WHEELS + 1)
    numbers = [
        n
        for n in every
        if f"counter_{n}" in found
        and f"wheel_speed_{n}" in chosen
        and _counts(tables, found[f"counter_{n}"][0], chosen[f"wheel_speed_{n}"].source)
    ]
    if not numbers:
        return None
    hints.append("# counters give finer speeds; scale = 2 pi / (ticks per turn of the wheel):")
    hints += [
        f'# wheel_speed_{n} = {{ from = "{found[f"counter_{n}"][0]}", difference = true, scale = … }}'
        for n in numbers
    ]
    counters = tuple(found[f"counter_{n}"][0] for n in numbers)
    return StaleRule(counters, tuple(chosen[f"wheel_speed_{n}"].source for n in numbers))


def _with_conditions(
    plant: str, chosen: Mapping[str, ColumnSource], stale: StaleRule | None, floor: str | None
) -> LogMapping:
    defaults: dict[str, float | str | bool] = {} if floor is None else {"floor": floor}
    if plant == "uto_robot" and {"x", "y", "heading"} <= set(chosen) and "acceleration_x" not in chosen:
        defaults[POSE_MEASURED] = True
    return LogMapping(plant, chosen, defaults, stale=stale)


def _unclear(
    columns: Mapping[str, SourceColumn], chosen: Mapping[str, ColumnSource], remarks: dict[str, str]
) -> tuple[str, ...]:
    found = []
    for target, rule in chosen.items():
        unit = find_unit(columns[rule.source].unit) if columns[rule.source].unit else None
        needed = target_unit(target)
        if not needed:
            continue
        if unit is not None and rule.unit is None and rule.scale is None:
            remarks[target] = f"raw readings ({unit.name}): scale = … {needed} per {unit.name}"
            found.append(target)
        elif unit is not None and unit.si and unit.si != needed and rule.scale is None:
            remarks[target] = f"{unit.name} is not a unit of {needed}: give a scale"
            found.append(target)
        elif unit is None and rule.unit is None and rule.source != target and target not in remarks:
            remarks[target] = f"no unit is written: taken as {needed}"
    return tuple(found)


def _missing(mapping: LogMapping) -> tuple[str, ...]:
    missing = missing_columns(list(mapping.columns), mapping.plant)
    conditions = [key for key in plant_columns(mapping.plant).conditions if key not in mapping.defaults]
    return (*missing, *(f"[defaults] {key}" for key in conditions))
