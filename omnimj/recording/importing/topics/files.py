"""Files of recorded messages: MCAP files and ROS 2 bags.

MCAP files are read record by record, so that memory does not grow with the file. A bag is a folder with
metadata.yaml and storage files in SQLite or MCAP, or one such file.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path, PurePath
from typing import IO, Any

from omnimj.errors import InputError
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

_MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0B, 0x0F
_DATA = (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK)
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_LENGTH = struct.Struct("<Q")
_RECOVER = "`mcap recover` saves what is whole"
METADATA = "metadata.yaml"
"""File that makes a folder a ROS 2 bag."""
_LARGEST_METADATA = 16 * 2**20
_STORAGES = ("sqlite3", "mcap")
_COMPRESSED = ".zstd"
_SHOWN = 5000  # messages between two steps of the progress


def read_mcap(path: Path, open_channel: OpenChannel, progress: Progress) -> None:
    """Pass every message of an MCAP file to the function that its channel was opened with.

    Chunks are checked against their checksum, and expanded to the size they claim and no further.

    Raises:
      InputError: The mcap library is missing, or the file is damaged or of another kind.
    """
    records = require_module(path, "mcap.records", "mcap")
    streams = require_module(path, "mcap.data_stream", "mcap")
    size = path.stat().st_size
    with path.open("rb") as file:
        _require_magic(path, file, size)
        reader = _Reader(path, open_channel, records, streams.ReadDataStream)
        try:
            for opcode, body in _records(path, file, size - len(_MAGIC)):
                reader.take(opcode, body)
                if opcode == _CHUNK:
                    progress(file.tell() / size)
            reader.require_all_messages()
        except InputError:
            raise
        except Exception as error:  # damaged records make the library raise errors of any kind
            raise not_whole(path, "MCAP file", error, _RECOVER) from None


def _require_magic(path: Path, file: IO[bytes], size: int) -> None:
    if file.read(len(_MAGIC)) != _MAGIC:
        raise InputError(path, "is not an MCAP file", "it begins with other bytes")
    file.seek(max(size - len(_MAGIC), len(_MAGIC)))
    if file.read() != _MAGIC:
        raise InputError(path, "is cut short", f"an MCAP file ends as it begins; {_RECOVER}")
    file.seek(len(_MAGIC))


def _records(path: Path, file: IO[bytes], end: int) -> Iterator[tuple[int, memoryview]]:
    """Yield the data and, after it, the statistics; other records are skipped."""
    at, ended = file.tell(), False
    while at < end:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise InputError(path, f"ends within a record at byte {at}", _RECOVER)
        opcode, length = _HEAD.unpack(head)
        if length > end - at - _HEAD.size:
            found = f"the record at byte {at} claims {length} bytes, {end - at - _HEAD.size} are left"
            raise InputError(path, found, _RECOVER)
        ended = ended or opcode == _DATA_END
        if opcode == _STATISTICS if ended else opcode in _DATA:
            if length > LARGEST_RECORD:
                found = f"the record at byte {at} has {length} bytes"
                raise InputError(path, found, f"at most {LARGEST_RECORD} are held in memory")
            yield opcode, memoryview(file.read(length))
        else:
            file.seek(length, io.SEEK_CUR)
        at += _HEAD.size + length
    if not ended:
        raise InputError(path, "has no end of data", _RECOVER)


class _Reader:
    """Schemas and channels seen so far, and the receivers of their messages."""

    def __init__(
        self, path: Path, open_channel: OpenChannel, records: Any, stream: Callable[[io.BytesIO], Any]
    ):
        self._path, self._open = path, open_channel
        self._records, self._stream = records, stream
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._receivers: dict[int, OnMessage | None] = {}
        self._count = 0
        self._stated: int | None = None

    def take(self, opcode: int, body: memoryview, inside: bool = False) -> None:
        """Use one record, or all records of a chunk."""
        if opcode == _MESSAGE:
            self._pass_on(body)
        elif opcode == _SCHEMA:
            one = self._records.Schema.read(self._stream(io.BytesIO(body)))
            self._schemas.setdefault(one.id, one)
        elif opcode == _CHANNEL:
            one = self._records.Channel.read(self._stream(io.BytesIO(body)))
            self._channels.setdefault(one.id, one)
        elif opcode == _CHUNK and not inside:
            self._take_chunk(body)
        elif opcode == _STATISTICS and not inside:
            (self._stated,) = _LENGTH.unpack_from(body)

    def require_all_messages(self) -> None:
        """Refuse a file that has lost messages, as one with a damaged chunk that is no longer seen as one.

        Raises:
          InputError: It has other messages than its statistics count.
        """
        if self._stated is not None and self._stated != self._count:
            found = f"has {self._count} messages, its statistics count {self._stated}"
            raise InputError(self._path, found, _RECOVER)

    def _take_chunk(self, body: memoryview) -> None:
        content = memoryview(_expanded(self._path, body))
        at, end = 0, len(content)
        while at < end:
            opcode, length = _HEAD.unpack_from(content, at)
            at += _HEAD.size
            if length > end - at:
                raise InputError(self._path, f"a record in a chunk claims {length} bytes", _RECOVER)
            self.take(opcode, content[at : at + length], inside=True)
            at += length

    def _pass_on(self, body: memoryview) -> None:
        channel, _, logged, _ = _MESSAGE_HEAD.unpack_from(body)
        self._count += 1
        if channel not in self._receivers:
            self._receivers[channel] = self._open(self._described(channel))
        receiver = self._receivers[channel]
        if receiver is not None:
            receiver(logged, body[_MESSAGE_HEAD.size :])

    def _described(self, number: int) -> Channel:
        if number not in self._channels:
            raise InputError(self._path, f"has a message of channel {number}, which is not described")
        one = self._channels[number]
        schema = self._schemas.get(one.schema_id)
        if schema is None:
            return Channel(one.topic, "", one.message_encoding, metadata=dict(one.metadata))
        return Channel(
            one.topic,
            plain_type(schema.name),
            one.message_encoding,
            schema.encoding,
            schema.data.decode("utf-8", "replace"),
            dict(one.metadata),
        )


def _expanded(path: Path, body: memoryview) -> bytes | memoryview:
    """Content of a chunk, checked against its size and checksum."""
    _, _, size, checksum = _CHUNK_HEAD.unpack_from(body)
    at = _CHUNK_HEAD.size
    (letters,) = struct.unpack_from("<I", body, at)
    compression = bytes(body[at + 4 : at + 4 + letters]).decode("utf-8")
    at += 4 + letters
    (length,) = _LENGTH.unpack_from(body, at)
    packed = body[at + _LENGTH.size :]
    if length > len(packed):
        raise InputError(path, f"a chunk claims {length} bytes, {len(packed)} are there", _RECOVER)
    if size > LARGEST_RECORD:
        found = f"a chunk claims to expand to {size} bytes"
        raise InputError(path, found, f"at most {LARGEST_RECORD} are held in memory")
    content = expand(path, packed[:length], compression, size)
    if len(content) != size:
        raise InputError(path, "a chunk does not expand to the size that it claims", _RECOVER)
    if checksum and zlib.crc32(content) != checksum:
        raise InputError(path, "a chunk is damaged, its checksum is another", _RECOVER)
    return content


def expand(path: Path, packed: memoryview, compression: str, size: int) -> bytes | memoryview:
    """Expand compressed bytes to at most one byte more than `size`, so that a decompression bomb
    cannot exhaust the memory.

    Raises:
      InputError: The compression is unknown, or its library is missing.
    """
    if not compression:
        return packed
    if compression == "zstd":
        library = require_module(path, "zstandard", "zstandard")
        with library.ZstdDecompressor().stream_reader(packed) as stream:
            return stream.read(size + 1)
    if compression == "lz4":
        library = require_module(path, "lz4.frame", "lz4")
        return library.LZ4FrameDecompressor().decompress(packed, max_length=size + 1)
    raise InputError(path, f"found compression {compression!r}", "it is not known", ("zstd", "lz4", ""))


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
