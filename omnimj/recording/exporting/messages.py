"""Runs as MCAP files of ROS 2 messages, which Foxglove, PlotJuggler and ROS 2 read.

Well-known messages hold poses, joints and the inertial unit, one more all columns. The strings of a message
are the same in every row, so that a row is one fixed layout of bytes.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnimj import __version__
from omnimj.errors import InputError
from omnimj.recording.exporting.source import LAST_STAMP, ExportedRun, ros_names
from omnimj.recording.folder import atomic_file
from omnimj.recording.importing.topics.messages import require_module
from omnimj.recording.json_files import to_jsonable
from omnimj.signals import Array

TRACE_TYPE = "omnimj_msgs/msg/Trace"
"""Type of the message with all columns; its definition is in the file."""
WORLD, BODY = "world", "base_link"
_UNKNOWN = -1.0  # first covariance of an estimate that does not exist, by the definition of sensor_msgs/Imu
_NO_ESTIMATE = (_UNKNOWN, *[0.0] * 8)
_SECOND = 1_000_000_000
_SEPARATOR = "=" * 80


class Layout:
    """Bytes of a message (little-endian CDR): texts are fixed, numbers come with each row."""

    def __init__(self):
        self._format, self._fixed, self._at = "<4s", [b"\x00\x01\x00\x00"], 0
        self._slots: list[bytes | int | float | None] = [*self._fixed]

    def stamp(self) -> Layout:
        """Add seconds and nanoseconds."""
        return self._number("i", 4, None)._number("I", 4, None)

    def text(self, text: str) -> Layout:
        """Add a fixed text."""
        content = text.encode() + b"\x00"
        self._number("I", 4, len(content))
        self._format += f"{len(content)}s"
        self._slots.append(content)
        self._at += len(content)
        return self

    def length(self, count: int) -> Layout:
        """Add the length of a list."""
        return self._number("I", 4, count)

    def numbers(self, count: int) -> Layout:
        """Add doubles that come with each row."""
        for _ in range(count):
            self._number("d", 8, None)
        return self

    def fixed(self, values: Sequence[float]) -> Layout:
        """Add fixed doubles."""
        for value in values:
            self._number("d", 8, value)
        return self

    def _number(self, code: str, size: int, value: float | None) -> Layout:
        gap = -self._at % size
        self._format += f"{gap}x{code}" if gap else code
        self._slots.append(value)
        self._at += gap + size
        return self

    def packer(self) -> Callable[[Sequence[float]], bytes]:
        """Function that packs the numbers of one row."""
        layout, slots = struct.Struct(self._format), list(self._slots)
        places = [k for k, slot in enumerate(slots) if slot is None]

        def pack(values: Sequence[float]) -> bytes:
            for place, value in zip(places, values, strict=True):
                slots[place] = value
            return layout.pack(*slots)

        return pack


@dataclass(frozen=True)
class Topic:
    """One topic of an exported run."""

    name: str
    type_name: str
    layout: Layout
    """Begins with a stamp, or with the length of its list."""
    values: Array
    """Numbers of each row after its stamp, shape (n, m)."""
    units: Mapping[str, str]
    """Units by field, beyond those that the type defines."""
    columns: Mapping[str, str]
    """Columns of the run by field."""
    definition: str = ""
    """Definition of a type that ROS does not have."""


def run_topics(run: ExportedRun) -> Iterator[Topic]:
    """Yield the topics of a run: all columns in `/trace`, then what other tools draw."""
    yield _trace(run)
    columns = run.columns
    joints = _joints(columns)
    if joints and (states := _joint_states(columns, joints)) is not None:
        yield states
    if {"acceleration_x", "acceleration_y", "yaw_rate"} <= set(columns):
        yield _imu(columns)
    if {"x", "y", "heading"} <= set(columns):
        yield _odometry(columns)
        yield _transform(columns)
    if {"target_x", "target_y", "target_heading"} <= set(columns):
        pose = _pose(columns, "target_x", "target_y", "target_heading")
        layout = Layout().stamp().text(WORLD).numbers(7)
        yield Topic("/target_pose", "geometry_msgs/msg/PoseStamped", layout, pose, {}, {})
    if {"target_twist_x", "target_twist_y", "target_yaw_rate"} <= set(columns):
        twist = _twist(columns, "target_twist_x", "target_twist_y", "target_yaw_rate")
        layout = Layout().stamp().text(BODY).numbers(6)
        yield Topic("/target_twist", "geometry_msgs/msg/TwistStamped", layout, twist, {}, {})


def _trace(run: ExportedRun) -> Topic:
    fields = ros_names(("header", *run.columns))
    lines = ["# One row of a run of omnimj; units in brackets", "std_msgs/Header header"]
    units = run.units
    for name in run.columns:
        unit, field = units[name], fields[name]
        remark = f"{name} [{unit}]" if unit else name
        lines.append(f"float64 {field}  # {_one_line(remark)}")
    layout = Layout().stamp().text(BODY).numbers(len(run.columns))
    return Topic(
        "/trace",
        TRACE_TYPE,
        layout,
        np.column_stack(list(run.columns.values())),
        {fields[name]: unit for name, unit in units.items() if unit},
        {fields[name]: name for name in run.columns},
        "\n".join(lines),
    )


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _joints(columns: Mapping[str, Array]) -> dict[str, tuple[str | None, str | None]]:
    """Columns of position and velocity by joint."""
    found: dict[str, tuple[str | None, str | None]] = {}
    for name in columns:
        wheel = re.fullmatch(r"wheel_speed(_\d+)?", name)
        if wheel:
            number = wheel[1] or ""
            angle = f"wheel_angle{number}"
            found[f"wheel{number}"] = (angle if angle in columns else None, name)
        elif name.startswith("position:"):
            joint = name.partition(":")[2]
            velocity = f"velocity:{joint}"
            found[joint] = (name, velocity if velocity in columns else None)
    return found


def _joint_states(
    columns: Mapping[str, Array], joints: Mapping[str, tuple[str | None, str | None]]
) -> Topic | None:
    """Positions and velocities, each only where every joint has one, as JointState demands."""
    layout = Layout().stamp().text(BODY).length(len(joints))
    for joint in joints:
        layout.text(joint)
    parts = []
    for k in (0, 1):
        names = [pair[k] for pair in joints.values()]
        given = [name for name in names if name is not None]
        whole = len(given) == len(joints)
        layout.length(len(joints) if whole else 0)
        if whole:
            layout.numbers(len(joints))
            parts += [columns[name] for name in given]
    layout.length(0)
    if not parts:
        return None
    return Topic("/joint_states", "sensor_msgs/msg/JointState", layout, np.column_stack(parts), {}, {})


def _quaternion(heading: Array) -> Array:
    """Rotation about the vertical axis, shape (n, 4)."""
    zero = np.zeros_like(heading)
    return np.column_stack((zero, zero, np.sin(heading / 2.0), np.cos(heading / 2.0)))


def _pose(columns: Mapping[str, Array], x: str, y: str, heading: str) -> Array:
    zero = np.zeros_like(columns[x])
    return np.column_stack((columns[x], columns[y], zero, _quaternion(columns[heading])))


def _twist(columns: Mapping[str, Array], x: str, y: str, yaw: str) -> Array:
    zero = np.zeros_like(columns["time"])
    parts = [columns.get(name, np.full_like(zero, np.nan)) for name in (x, y, yaw)]
    return np.column_stack((parts[0], parts[1], zero, zero, zero, parts[2]))


def _imu(columns: Mapping[str, Array]) -> Topic:
    """Planar unit: what it does not measure is not a number."""
    none = np.full_like(columns["time"], np.nan)
    has_yaw = "yaw" in columns
    turn = _quaternion(columns["yaw"]) if has_yaw else np.zeros((len(none), 4))
    layout = Layout().stamp().text(BODY).numbers(4).fixed([0.0] * 9 if has_yaw else _NO_ESTIMATE)
    layout.numbers(3).fixed([0.0] * 9).numbers(3).fixed([0.0] * 9)
    rates = (none, none, columns["yaw_rate"])
    acceleration = (columns["acceleration_x"], columns["acceleration_y"], none)
    return Topic(
        "/imu", "sensor_msgs/msg/Imu", layout, np.column_stack((turn, *rates, *acceleration)), {}, {}
    )


def _odometry(columns: Mapping[str, Array]) -> Topic:
    pose = _pose(columns, "x", "y", "heading")
    twist = _twist(columns, "twist_x", "twist_y", "twist_yaw")
    layout = Layout().stamp().text(WORLD).text(BODY).numbers(7).fixed([0.0] * 36)
    layout.numbers(6).fixed([0.0] * 36)
    return Topic("/odom", "nav_msgs/msg/Odometry", layout, np.column_stack((pose, twist)), {}, {})


def _transform(columns: Mapping[str, Array]) -> Topic:
    layout = Layout().length(1).stamp().text(WORLD).text(BODY).numbers(7)
    return Topic("/tf", "tf2_msgs/msg/TFMessage", layout, _pose(columns, "x", "y", "heading"), {}, {})


def write_mcap(path: Path, run: ExportedRun) -> None:
    """Write a run as MCAP, in full or not at all.

    Stamps and times of logging are those of the run, rounded to nanoseconds. Units are in the comments of the
    definition of `/trace` and in the metadata of its channel.

    Raises:
      InputError: A library is missing, or a time does not fit a stamp.
      OutputError: The file cannot be written.
    """
    writing = require_module(path, "mcap.writer", "mcap")
    typesys = require_module(path, "rosbags.typesys", "rosbags")
    time = run.columns["time"]
    for k in (0, -1):
        if not 0.0 <= time[k] < LAST_STAMP:
            found, rule = f"a time is {time[k]:.9g} s", f"stamps hold 0 to {LAST_STAMP} s"
            raise InputError(run.file, found, rule)
    stamps = np.round(time * _SECOND).astype(np.int64).tolist()
    known = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        writer = writing.Writer(file)
        writer.start(profile="ros2", library=f"omnimj {__version__}")
        about = {str(key): _text(value) for key, value in run.about.items()}
        writer.add_metadata("omnimj", about)
        opened = []
        for topic in run_topics(run):
            channel = _register(writer, topic, known)
            opened.append((channel, topic.layout.packer(), topic.values.tolist()))
        for k, stamp in enumerate(stamps):
            seconds, nanoseconds = divmod(stamp, _SECOND)
            for channel, pack, rows in opened:
                writer.add_message(channel, stamp, pack((seconds, nanoseconds, *rows[k])), stamp, k)
        writer.finish()


def _text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(to_jsonable(value))


def _register(writer, topic: Topic, known) -> int:
    """Add the schema and the channel of a topic; return the channel."""
    if topic.definition:
        header, _ = known.generate_msgdef("std_msgs/msg/Header", ros_version=2)
        text = f"{topic.definition}\n{_SEPARATOR}\nMSG: std_msgs/Header\n{header}"
    else:
        text, _ = known.generate_msgdef(topic.type_name, ros_version=2)
    schema = writer.register_schema(topic.type_name, "ros2msg", text.encode())
    metadata = {f"unit.{field}": unit for field, unit in topic.units.items()}
    metadata |= {f"column.{field}": column for field, column in topic.columns.items()}
    return writer.register_channel(topic.name, "cdr", schema, metadata)
