"""MCAP files and ROS 2 bags as the table of a log: topics joined, fields as columns."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.importing.tables import SourceColumn, SourceHints, SourceTable, require_size
from omnimj.recording.importing.topics.cdr import CdrNumbers, Definitions
from omnimj.recording.importing.topics.files import read_bag
from omnimj.recording.importing.topics.join import (
    Clock,
    Times,
    TopicChoice,
    TopicSummary,
    Track,
    choose_clocks,
    make_times,
    merged,
    values_at,
)
from omnimj.recording.importing.topics.json_numbers import read_json_message, schema_units
from omnimj.recording.importing.topics.messages import Channel, OnMessage, require_module
from omnimj.recording.importing.topics.quantities import (
    JOINT_STATES,
    definition_units,
    quantity,
    with_yaw,
)
from omnimj.recording.importing.topics.series import Budget, Samples, Series
from omnimj.recording.run_table import printable

RENAMED = "column."
"""Beginning of the keys in a channel's metadata that give a field the name of its column: `column.x = x`."""
KEPT_TIME = 1e6
"""Stamps up to this one [s] count from the start of a simulation or of a robot, and become the time."""
_NO_SIGNALS = (
    "sensor_msgs/Image",
    "sensor_msgs/CompressedImage",
    "sensor_msgs/PointCloud2",
    "sensor_msgs/CameraInfo",
    "sensor_msgs/LaserScan",
    "nav_msgs/OccupancyGrid",
    "rosgraph_msgs/Clock",
    "rcl_interfaces/ParameterEvent",
    "rcl_interfaces/Log",
)
_BASES = ("omnimj_msgs/Trace", JOINT_STATES)
"""Message types that are preferred as time base."""
_ORDER = (*_BASES, "sensor_msgs/Imu", "geometry_msgs/PoseStamped", "nav_msgs/Odometry")
_LONGEST_DEFINITION = 2**17
_NANO = 1e-9
_HELD = re.compile(r"set_?point|target|cmd|command|desired|goal")


@dataclass(frozen=True)
class _Topic:
    channel: Channel
    series: Series
    units: Mapping[str, str]
    whole: frozenset[str]
    """Paths of whole numbers and switches."""


@dataclass(frozen=True)
class _Content:
    """Content of a file."""

    path: Path
    kind: str
    topics: Mapping[str, _Topic]
    """Topics with numbers."""
    left_out: Mapping[str, str]
    """Other topics, with the reason."""


def read_topics(path: Path, hints: SourceHints) -> SourceTable:
    """Read recorded messages as one table, a row at each stamp of one topic.

    Raises:
      InputError: A library is missing, the file is damaged, or no topic has numbers.
      UnknownNameError: The topic of the time base is not in the file.
    """
    choice = hints.choice or TopicChoice()
    collector = _Collector(path, choice.base, hints.columns, hints.topics)
    kind = read_bag(path, collector.open, hints.progress)
    found = collector.with_numbers()
    if not found:
        reasons = ", ".join(f"{name} ({why})" for name, why in collector.left_out.items())
        raise InputError(path, "has no topic with numbers", f"left out: {reasons}" if reasons else "")
    content = _Content(path, kind, found, collector.left_out)
    return _joined(content, _base(path, found, choice.base), choice)


class _Collector:
    """Topics opened so far."""

    def __init__(self, path: Path, base: str | None, columns: Collection[str], topics: Collection[str]):
        self._path, self._base = path, base
        self._columns, self._topics = columns, topics
        self._budget = Budget(path)
        self._standard: Definitions | None = None
        self._opened: dict[str, _Topic] = {}
        self.left_out: dict[str, str] = {}

    def open(self, channel: Channel) -> OnMessage | None:
        """Start to collect a channel; None if it is left out."""
        name = printable(channel.topic)
        if not self._is_needed(name):
            self.left_out.setdefault(name, "not needed")
            return None
        opened = self._opened.get(name)
        if opened is None:
            try:
                opened = self._opened[name] = self._topic(channel)
            except InputError as error:
                self.left_out[name] = str(error)
                return None
        elif opened.channel.type_name != channel.type_name:
            self.left_out[f"{name} as {channel.type_name}"] = f"also {opened.channel.type_name}"
            return None
        return opened.series.take

    def with_numbers(self) -> dict[str, _Topic]:
        """Topics whose messages have numbers, well-known ones first."""
        found = {}
        for name, topic in self._opened.items():
            if any(one.names for one in topic.series.samples()):
                found[name] = topic
            else:
                self.left_out[name] = f"{topic.channel.type_name} without numbers"
        rank = {kind: k for k, kind in enumerate(_ORDER)}
        return dict(sorted(found.items(), key=lambda one: rank.get(one[1].channel.type_name, len(_ORDER))))

    def _is_needed(self, name: str) -> bool:
        if self._topics and name not in self._topics:
            return False
        has_column = any(column.startswith(f"{name}.") for column in self._columns)
        return not self._columns or has_column or name == self._base

    def _topic(self, channel: Channel) -> _Topic:
        place = f"{self._path}: topic {printable(channel.topic)}"
        if channel.type_name in _NO_SIGNALS:
            raise InputError(channel.type_name, "no signals")
        if channel.encoding == "json":
            units = schema_units(channel.definition) if channel.definition_format == "jsonschema" else {}
            series = Series(place, read_json_message, lambda key: key, self._budget)
            return _Topic(channel, series, units, frozenset())
        if channel.encoding != "cdr":
            raise InputError(channel.type_name or "messages", f"{channel.encoding!r} is not read")
        reader = self._cdr(channel)
        units = definition_units(channel.definition)
        return _Topic(channel, Series(place, reader.read, reader.names, self._budget), units, reader.whole)

    def _cdr(self, channel: Channel) -> CdrNumbers:
        full = re.sub(r"^(\w+)/(\w+)$", r"\1/msg/\2", channel.type_name)
        known = self._defined(channel, full) if channel.definition else {}
        try:
            return CdrNumbers(full, known)
        except InputError:
            return CdrNumbers(full, {**self._standard_types(), **known})

    def _defined(self, channel: Channel, full: str) -> Definitions:
        library = require_module(self._path, "rosbags.typesys", "rosbags")
        if len(channel.definition) > _LONGEST_DEFINITION:
            raise InputError(full, f"its definition has {len(channel.definition)} letters")
        try:
            if channel.definition_format == "ros2msg":
                return library.get_types_from_msg(channel.definition, full)
            if channel.definition_format == "ros2idl":
                return library.get_types_from_idl(channel.definition)
        except Exception as error:  # any text may stand in a damaged definition
            reason = " ".join(str(error).split())[:80] or type(error).__name__
            raise InputError(full, f"its definition cannot be read ({reason})") from None
        raise InputError(full, f"definitions as {channel.definition_format!r} are not read")

    def _standard_types(self) -> Definitions:
        if self._standard is None:
            library = require_module(self._path, "rosbags.typesys", "rosbags")
            self._standard = library.get_typestore(library.Stores.LATEST).fielddefs
        return self._standard or {}


def _base(path: Path, found: Mapping[str, _Topic], wanted: str | None) -> str:
    """Topic of the time base: joint states or a trace where there are, else that with the most messages."""
    if wanted is not None:
        if wanted not in found:
            raise UnknownNameError(f"{path}: [topics] base", "topic", wanted, found)
        return wanted
    first = [name for name, one in found.items() if one.channel.type_name in _BASES]
    return max(first or found, key=lambda name: found[name].series.count)


def _joined(content: _Content, base: str, choice: TopicChoice) -> SourceTable:
    samples = {
        name: [one for one in topic.series.samples() if one.names] for name, topic in content.topics.items()
    }
    clocks = choose_clocks(content.path, samples, base, choice.stamps)
    times = _all_times(samples[base], clocks[base].use)
    if len(times) < 2:
        found = f"has {len(times)} message"
        raise InputError(f"{content.path}: topic {base}", found, "at least 2 make a time base")
    zero = 0 if abs(int(times[0])) * _NANO < KEPT_TIME else int(times[0])
    columns = {"time": SourceColumn("time", (times - zero).astype(float) * _NANO, "s", kind="time")}
    others, scalars = dict(content.left_out), {"start": f"{zero} ns"} if zero else {}
    summaries = []
    for name, topic in content.topics.items():
        use, rule = clocks[name].use, "previous" if _HELD.search(name) else choice.join
        tracks = _tracks(samples[name], use) if use else {}
        many = {path: track for path, track in tracks.items() if len(track.times) > 1}
        require_size(content.path, len(times), len(columns) + len(many))
        made = [_column(name, topic, path, track, (times, rule)) for path, track in many.items()]
        columns |= {column.name: column for column in made}
        scalars |= {f"{name}.{k}": f"{one.values[0]:g}" for k, one in tracks.items() if k not in many}
        if not use:
            others[name] = clocks[name].why
        joined = "the rows" if name == base else {"previous": "previous value"}.get(rule, rule)
        joined = joined if many else "a single value" if use else "left out"
        summaries.append(_summary(name, topic, samples[name], clocks[name], joined))
    return SourceTable(
        content.path,
        columns,
        f"{content.kind}, {len(times)} rows at the {clocks[base].use} stamps of {base}",
        others,
        scalars,
        row_of=lambda sample: f"row {sample + 1} at {(int(times[sample]) - zero) * _NANO:.9g} s",
        topics=tuple(summaries),
        choice=TopicChoice(base, choice.join, clocks[base].use),
    )


def _all_times(samples: Iterable[Samples], use: str) -> Times:
    """Times of all messages of a topic, whether their fields differ or not."""
    samples = list(samples)
    if len(samples) == 1:
        return make_times(samples[0], use)[0]
    return np.unique(np.concatenate([make_times(one, use)[0] for one in samples]))


def _tracks(samples: Iterable[Samples], use: str) -> dict[str, Track]:
    """Columns of one topic by path, headings included."""
    found: dict[str, list[Track]] = {}
    for one in samples:
        times, rows = make_times(one, use)
        values = {name: one.values[:, k][rows] for k, name in enumerate(one.names)}
        for name, column in with_yaw(values).items():
            found.setdefault(name, []).append(Track(times, column))
    return {name: merged(tracks) for name, tracks in found.items()}


def _column(topic: str, about: _Topic, path: str, track: Track, at: tuple[Times, str]) -> SourceColumn:
    """One field as a column; `at` has the times of the rows and the rule between messages."""
    times, rule = at
    values = values_at(track, times, "previous" if path in about.whole else rule)
    meta = about.channel.metadata
    renamed = {key.removeprefix(RENAMED): name for key, name in meta.items() if key.startswith(RENAMED)}
    what = quantity(about.channel.type_name, path, about.units, renamed)
    is_reading = what.kind != "time" and not _HELD.search(topic)
    kind, part = (what.kind, what.part) if is_reading else ("", "")
    return SourceColumn(f"{topic}.{path}", values, what.unit, about.channel.type_name, kind, part)


def _summary(name: str, topic: _Topic, samples: list[Samples], clock: Clock, joined: str) -> TopicSummary:
    steps = np.diff(_all_times(samples, clock.use or "log"))
    rate = 1.0 / (float(np.median(steps)) * _NANO) if len(steps) else 0.0
    stamps = f"{clock.use or '–'}{f': {clock.why}' if clock.why else ''}"
    return TopicSummary(name, topic.channel.type_name, topic.series.count, rate, stamps, joined)
