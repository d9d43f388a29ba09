"""ROS 2 bags: folders with metadata.yaml and storage files in SQLite or MCAP, or one such file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

from omnimj.errors import InputError
from omnimj.recording.importing.topics.mcap_file import expand, read_mcap
from omnimj.recording.importing.topics.messages import (
    LARGEST_RECORD,
    Channel,
    OnMessage,
    OpenChannel,
    Progress,
    not_whole,
    plain_type,
    require_module,
)

METADATA = "metadata.yaml"
"""File that makes a folder a ROS 2 bag."""
_LARGEST_METADATA = 16 * 2**20
_STORAGES = ("sqlite3", "mcap")
_COMPRESSED = ".zstd"
_SHOWN = 5000  # messages between two steps of the progress


def read_bag(path: Path, open_channel: OpenChannel, progress: Progress) -> str:
    """Pass every message of a bag to the function of its channel; return the kind of file in words.

    Raises:
      InputError: A library is missing, or a file is damaged or of another kind.
    """
    if not path.is_dir():
        if path.suffix.lower() == ".mcap":
            read_mcap(path, open_channel, progress)
            return "MCAP"
        _read_sqlite(path, open_channel, "", progress)
        return "ROS 2 bag (sqlite3)"
    content = _metadata(path / METADATA)
    storage = str(content.get("storage_identifier", ""))
    if storage not in _STORAGES:
        raise InputError(path / METADATA, f"found storage {storage!r}", "it is not known", _STORAGES)
    mode = str(content.get("compression_mode") or "").lower()
    files = _storage_files(path, content)
    for k, file in enumerate(files):
        within = _within(progress, k, len(files))
        if storage == "mcap":
            read_mcap(file, open_channel, within)
        else:
            _read_sqlite(file, open_channel, mode, within)
    return f"ROS 2 bag ({storage})"


def _within(progress: Progress, done: int, files: int) -> Progress:
    """Progress within one of several files, as that of the bag."""
    return lambda share: progress((done + share) / files)


def _metadata(file: Path) -> Mapping[str, Any]:
    yaml = require_module(file, "ruamel.yaml", "rosbags")
    if not file.is_file():
        raise InputError(file, "no such file", "`ros2 bag reindex` makes it")
    if file.stat().st_size > _LARGEST_METADATA:
        raise InputError(file, f"has {file.stat().st_size} bytes", f"at most {_LARGEST_METADATA} are read")
    try:
        content = yaml.YAML(typ="safe", pure=True).load(file.read_text(encoding="utf-8"))
    except OSError:
        raise
    except Exception as error:  # the library raises errors of many kinds for damaged text
        reason = " ".join(str(error).split())[:120]
        raise InputError(file, "is not valid YAML", reason) from None
    found = content.get("rosbag2_bagfile_information") if isinstance(content, Mapping) else None
    if not isinstance(found, Mapping):
        raise InputError(file, "has no rosbag2_bagfile_information", "`ros2 bag reindex` makes it again")
    return found


def _storage_files(folder: Path, content: Mapping[str, Any]) -> list[Path]:
    names = content.get("relative_file_paths")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        found = "has no list relative_file_paths"
        raise InputError(folder / METADATA, found, "`ros2 bag reindex` makes it again")
    files = [folder / PurePath(name).name for name in names]  # never outside the bag
    for file in files:
        if not file.is_file():
            raise InputError(folder, f"{METADATA} names {file.name!r}", "there is no such file")
        if file.suffix == _COMPRESSED:
            rule = "expand it with `zstd -d`, and correct metadata.yaml with `ros2 bag reindex`"
            raise InputError(file, "is compressed as a whole", rule)
    return files


def _read_sqlite(path: Path, open_channel: OpenChannel, mode: str, progress: Progress) -> None:
    """Read a storage file; `mode` is the compression of its messages."""
    library = require_module(path, "rosbags.rosbag2", "rosbags")
    try:
        with library.Reader(path) as reader:
            receivers = {one.id: open_channel(_described(one)) for one in reader.connections if one.msgcount}
            wanted = [one for one in reader.connections if receivers.get(one.id) is not None]
            total = sum(one.msgcount for one in wanted)
            messages: Any = reader.messages(connections=wanted) if wanted else ()
            for k, (connection, logged, payload) in enumerate(messages):
                _pass_on(path, receivers[connection.id], logged, payload, mode)
                if k % _SHOWN == 0:
                    progress(k / total)
    except (InputError, OSError):
        raise
    except Exception as error:  # damaged databases make the library raise errors of any kind
        raise not_whole(path, "ROS 2 bag", error) from None


def _pass_on(path: Path, receiver: OnMessage | None, logged: int, payload: bytes, mode: str) -> None:
    content: bytes | memoryview = payload
    if mode == "message":
        content = expand(path, memoryview(payload), "zstd", LARGEST_RECORD)
        if len(content) > LARGEST_RECORD:
            raise InputError(
                path, "a message expands without end", f"at most {LARGEST_RECORD} bytes are held"
            )
    if receiver is not None:
        receiver(logged, memoryview(content))


def _described(connection: Any) -> Channel:
    form = {"MSG": "ros2msg", "IDL": "ros2idl"}.get(connection.msgdef.format.name, "")
    return Channel(
        connection.topic,
        plain_type(connection.msgtype),
        connection.ext.serialization_format,
        form,
        connection.msgdef.data if form else "",
    )
