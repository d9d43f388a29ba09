"""Runs as MCAP files of ROS 2 messages, which Foxglove, PlotJuggler and ROS 2 read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from omnimj import __version__
from omnimj.errors import InputError
from omnimj.recording.exporting.messages import Topic, run_topics
from omnimj.recording.exporting.source import LAST_STAMP, ExportedRun
from omnimj.recording.folder import atomic_file
from omnimj.recording.importing.topics.messages import require_module
from omnimj.recording.json_files import to_jsonable

_SECOND = 1_000_000_000
_SEPARATOR = "=" * 80


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
