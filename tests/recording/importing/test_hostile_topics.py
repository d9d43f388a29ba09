"""Damaged and hostile bags and MCAP files are refused in one line or read, and never fill the memory."""

from __future__ import annotations

import json
import shutil
import struct
import tracemalloc
import zlib
from pathlib import Path

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from recording.made_bags import START, WRITERS, drive, number, write_json_mcap, write_mcap

from omnimj.errors import InputError
from omnimj.recording.importing.source import read_source

MAGIC = b"\x89MCAP0\r\n"


def record(opcode: int, body: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(body) if length is None else length) + body


def text(content: str) -> bytes:
    return struct.pack("<I", len(content)) + content.encode()


def mcap_of(*records: bytes) -> bytes:
    end = record(0x0F, struct.pack("<I", 0)) + record(0x02, struct.pack("<QQI", 0, 0, 0))
    return MAGIC + record(0x01, text("") + text("")) + b"".join(records) + end + MAGIC


def chunk(content: bytes, size: int, compression: str = "", checksum: int = 0) -> bytes:
    head = struct.pack("<QQQI", 0, 0, size, checksum) + text(compression)
    return record(0x06, head + struct.pack("<Q", len(content)) + content)


def schema(name: str, encoding: str, definition: str, number: int = 1) -> bytes:
    return record(0x03, struct.pack("<H", number) + text(name) + text(encoding) + text(definition))


def channel(topic: str, encoding: str, of: int = 1) -> bytes:
    return record(0x04, struct.pack("<HH", 1, of) + text(topic) + text(encoding) + struct.pack("<I", 0))


def message(payload: bytes, logged: int = 0) -> bytes:
    return record(0x05, struct.pack("<HIQQ", 1, 0, logged, logged) + payload)


def refused(path: Path, content: bytes | None = None) -> str:
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError) as error:
        read_source(path)
    line = str(error.value)
    assert "\n" not in line and path.name in line and len(line) < 700
    return line


def float_topic(payload: bytes, definition: str = "float64 data") -> bytes:
    return mcap_of(
        schema("std_msgs/msg/Float64", "ros2msg", definition), channel("/a", "cdr"), message(payload)
    )


WHOLE_DOUBLE = b"\x00\x01\x00\x00" + struct.pack("<d", 1.5)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"\x89MCAP1\r\n" + b"0" * 40, "is not an MCAP file"),
        (MAGIC + record(0x01, text("") + text("")), "is cut short"),
        (MAGIC + record(0x03, b"", 2**63) + MAGIC, "claims 9223372036854775808 bytes"),
        (MAGIC + record(0x01, text("") + text("")) + MAGIC, "has no end of data"),
        (mcap_of(), "has no topic with numbers"),
        (mcap_of(message(b"")), "channel 1, which is not described"),
        (mcap_of(schema("a/B", "ros2msg", "float64 data", 7)[:-3] + b"\xff" * 3), "no topic with numbers"),
        (mcap_of(channel("/a", "protobuf"), message(b"")), "'protobuf' is not read"),
        (mcap_of(schema("a/B", "ros2msg", "!?"), channel("/a", "cdr"), message(b"")), "cannot be read"),
        (mcap_of(schema("a/B", "ros2msg", "Other x"), channel("/a", "cdr"), message(b"")), "not defined"),
        (mcap_of(schema("a/B", "ros2msg", "B x"), channel("/a", "cdr"), message(b"")), "contains itself"),
        (mcap_of(channel("/a", "cdr", 0), message(b"")), "not defined"),
        (float_topic(WHOLE_DOUBLE[:9]), "message 1 cannot be read"),
        (float_topic(b"\x00\x00\x00\x00" + WHOLE_DOUBLE[4:]), "not little-endian CDR"),
        (float_topic(WHOLE_DOUBLE), "has 1 message; at least 2"),
        (float_topic(b"\0\1\0\0" + b"\xff" * 8, "float64[] data"), "claims 4294967295 entries"),
        (float_topic(b"\0\1\0\0" + b"\xff" * 8, "string[] data"), "claims 4294967295 entries"),
        (float_topic(b"\0\1\0\0" + b"\xff" * 8, "string a"), "claims 4294967295 bytes"),
        (mcap_of(chunk(b"x" * 20, 2**40)), "claims to expand to 1099511627776 bytes"),
        (mcap_of(chunk(b"x" * 20, 30)), "does not expand to the size"),
        (mcap_of(chunk(b"x" * 20, 20, "brotli")), "found compression 'brotli'"),
        (mcap_of(chunk(b"x" * 20, 20, "zstd")), "is not a whole MCAP file"),
        (mcap_of(chunk(b"x" * 20, 20, "lz4")), "is not a whole MCAP file"),
        (mcap_of(chunk(b"x" * 20, 20, "", 77)), "its checksum is another"),
        (mcap_of(chunk(record(0x05, b"", 99), 9)), "a record in a chunk claims 99 bytes"),
        (mcap_of(channel("/a", "json"), message(b"[" * 100_000)), "message 1 cannot be read"),
        (mcap_of(channel("/a", "json"), message(b"[1]")), "no JSON object"),
        (mcap_of(channel("/a", "json"), message(b'{"a": 1}', 2**63)), "no such time"),
    ],
)
def test_a_damaged_or_hostile_mcap_file_is_refused_in_one_line(tmp_path, content, words):
    assert words in refused(tmp_path / "a.mcap", content)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_that_expands_without_end_is_stopped_at_the_size_that_it_claims(tmp_path, compression):
    import lz4.frame

    bomb = bytes(200_000_000)
    packed = zstandard.compress(bomb) if compression == "zstd" else lz4.frame.compress(bomb)
    path = tmp_path / "a.mcap"
    path.write_bytes(mcap_of(chunk(packed, 1000, compression, zlib.crc32(bytes(1000)))))
    del bomb
    tracemalloc.start()
    assert "does not expand to the size" in refused(path)
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()


@pytest.mark.parametrize("keys", [("sec", "nsec"), ("sec", "nanosec")])
def test_stamps_that_are_no_numbers_give_way_to_log_times(tmp_path, keys):
    rows = [
        (START + k * 10**7, f'{{"stamp": {{"{keys[0]}": NaN, "{keys[1]}": {k}}}, "a": {k}}}'.encode())
        for k in range(60)
    ]
    table = read_source(write_json_mcap(tmp_path / "a.mcap", rows))
    assert table.topics[0].stamps == "log: no header stamps"


def test_log_times_that_do_not_advance_are_no_time_base(tmp_path):
    made = [("/a", "std_msgs/msg/Float64", START, number(float(k))) for k in range(60)]
    assert "has 1 message; at least 2" in refused(write_mcap(tmp_path / "a.mcap", made))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Bytes of a small drive by writer and suffix."""
    found = {}
    for writer in ("bag in SQLite", "MCAP, zstd", "MCAP, plain"):
        path = WRITERS[writer](tmp_path_factory.mktemp("whole"), drive(count=8))
        file = next(path.glob("*.db3")) if path.is_dir() else path
        found[writer] = (file.suffix, file.read_bytes())
    return found


@pytest.mark.slow
@given(st.data())
@pytest.mark.parametrize("writer", ["bag in SQLite", "MCAP, zstd", "MCAP, plain"])
def test_cut_flipped_and_random_files_are_read_or_refused_in_one_line(tmp_path_factory, whole, writer, data):
    suffix, content = whole[writer]
    kind = data.draw(st.sampled_from(["cut", "flipped", "random"]))
    if kind == "cut":
        content = content[: data.draw(st.integers(0, len(content) - 1))]
    elif kind == "flipped":
        content = bytearray(content)
        for _ in range(data.draw(st.integers(1, 8))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    else:
        content = data.draw(st.binary(max_size=300))
    path = tmp_path_factory.mktemp("hostile") / f"a{suffix}"
    path.write_bytes(bytes(content))
    try:
        table = read_source(path)
    except InputError as error:
        assert "\n" not in str(error) and str(path) in str(error)
    else:
        assert len({len(column.values) for column in table.columns.values()}) == 1


@pytest.mark.slow
@given(place=st.integers(0, 2**32), bit=st.integers(0, 7))
def test_a_flipped_bit_anywhere_in_an_mcap_file_is_seen_or_changes_no_value(
    tmp_path_factory, whole, place, bit
):
    """Chunks have checksums, and the statistics count the messages of chunks that are no longer seen."""
    suffix, content = whole["MCAP, zstd"]
    folder, at = tmp_path_factory.mktemp("flipped"), place % len(content)
    (folder / f"sound{suffix}").write_bytes(content)
    sound = read_source(folder / f"sound{suffix}").columns
    path = folder / f"a{suffix}"
    path.write_bytes(content[:at] + bytes([content[at] ^ 1 << bit]) + content[at + 1 :])
    try:
        found = read_source(path).columns
    except InputError:
        return
    assert set(found) == set(sound)
    for name, column in found.items():
        assert column.values.tobytes() == sound[name].values.tobytes()


def test_a_folder_without_metadata_is_refused(tmp_path):
    path = WRITERS["bag in SQLite"](tmp_path, drive(count=8))
    (path / "metadata.yaml").unlink()
    assert "is a folder without metadata.yaml" in refused(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rosbag2_bagfile_information", "other", "has no rosbag2_bagfile_information"),
        ("storage_identifier: sqlite3", "storage_identifier: tape", "found storage 'tape'"),
        ("- drive.db3", "- gone.db3", "there is no such file"),
        ("- drive.db3", "- ../../../etc/passwd", "names 'passwd'"),
        ("relative_file_paths:", "relative_file_paths: 3\nx:", "is not valid YAML"),
        ("rosbag2_bagfile_information:", "a: [", "is not valid YAML"),
        ("  relative_file_paths:\n  - drive.db3\n", "", "has no list relative_file_paths"),
    ],
)
def test_wrong_metadata_is_refused_in_one_line(tmp_path, old, new, words):
    path = WRITERS["bag in SQLite"](tmp_path, drive(count=8))
    content = (path / "metadata.yaml").read_text()
    assert old in content
    (path / "metadata.yaml").write_text(content.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        read_source(path)


def test_a_bag_compressed_as_a_whole_and_a_ros_1_bag_say_what_to_do(tmp_path):
    path = WRITERS["bag in SQLite"](tmp_path, drive(count=8))
    (path / "drive.db3").rename(path / "drive.db3.zstd")
    text = (path / "metadata.yaml").read_text().replace("drive.db3", "drive.db3.zstd")
    (path / "metadata.yaml").write_text(text)
    with pytest.raises(InputError, match="is compressed as a whole; expand it with `zstd -d`"):
        read_source(path)
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    assert "`rosbags-convert --src a.bag --dst a`" in refused(tmp_path / "a.bag")


def test_a_database_of_another_program_is_refused(tmp_path):
    import sqlite3

    path = tmp_path / "a.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE other(x)")
    database.close()
    assert "is not a whole ROS 2 bag" in refused(path)


@pytest.mark.slow
def test_deeply_nested_metadata_is_refused(tmp_path):
    path = WRITERS["bag in SQLite"](tmp_path, drive(count=8))
    (path / "metadata.yaml").write_text("[" * 2000)
    with pytest.raises(InputError, match="is not valid YAML"):
        read_source(path)
    shutil.rmtree(path)


def test_fields_that_keep_changing_are_refused(tmp_path):
    rows = [(START + k, json.dumps({f"a{k}": 1.0}).encode()) for k in range(100)]
    path = write_json_mcap(tmp_path / "a.mcap", rows)
    assert "64 different sets of fields" in refused(path)
