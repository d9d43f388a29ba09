"""The bytes on the wire are written down; Python and the C header both keep to them."""

from __future__ import annotations

import hashlib
import json
import random
import re
import shutil
import subprocess
import zlib
from pathlib import Path

import pytest
from cobs import cobs
from make_golden_frames import PATH, golden
from sample_frames import KEY, SECRET, describe

import omnimj.link
from omnimj.link.codec.frames import decode
from omnimj.link.codec.key import Key, is_weak
from omnimj.link.codec.layout import (
    HEADER,
    MAX_CHANNELS,
    MAX_FRAME_SIZE,
    MAX_WHEELS,
    PROTOCOL,
    SCHEMA,
    SCHEMA_TEXT,
    DropReason,
)
from omnimj.link.codec.messages import FaultCode, Frame, MessageType, Quantity, Raw, Status
from omnimj.link.codec.stream import PacketStream

ROOM = Path(omnimj.link.__file__).parent
HEADER_FILE = (ROOM / "firmware" / "omnimj_link.h").read_text(encoding="ascii")
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang") or ""
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
WARY = ("-Wconversion", "-ffreestanding")
WRITTEN = json.loads(PATH.read_text(encoding="utf-8"))
assert_compiler = None
needs_compiler = pytest.mark.skipif(not COMPILER, reason="no C compiler (cc, gcc, clang) on this machine")


def test_frames_are_encoded_as_written_down():
    assert golden() == WRITTEN


@pytest.mark.parametrize("row", WRITTEN["frames"], ids=lambda row: f"{row['name']}{' keyed' * row['keyed']}")
def test_frames_are_decoded_as_written_down(row):
    packet = bytes.fromhex(row["packet"])
    frame = decode(packet, KEY if row["keyed"] else None)
    assert isinstance(frame, Frame) and describe(frame) == row["told"]
    assert PacketStream().feed(bytes.fromhex(row["stuffed"])) == [packet]


def test_every_type_is_written_down():
    assert {int(row["told"].split()[0]) for row in WRITTEN["frames"]} == set(MessageType)


def test_golden_bytes_are_as_the_protocol_lists_them():
    """By hand from the tables: nothing of the codec is used."""
    (row,) = (r for r in WRITTEN["frames"] if r["name"] == "command" and not r["keyed"])
    head = "0204000001eeffc00300000028460f0000000000" + SCHEMA.to_bytes(4, "little").hex()
    payload = "cdcc4c3d040000002a0000000000803e000000bf0000c03f0000c0bf"
    content = bytes.fromhex(head + payload)
    assert row["packet"] == (content + zlib.crc32(content).to_bytes(4, "little")).hex()
    (row,) = (r for r in WRITTEN["frames"] if r["name"] == "command" and r["keyed"])
    content = bytes.fromhex(head.replace("02040000", "02040100") + payload)
    content += hashlib.blake2s(content, key=SECRET, digest_size=16).digest()
    assert row["packet"] == (content + zlib.crc32(content).to_bytes(4, "little")).hex()


def _constant(name: str) -> int:
    (found,) = re.findall(rf"#define {name} (0x[0-9A-F]+|\d+)u$", HEADER_FILE, re.MULTILINE)
    return int(found, 0)


def test_the_header_names_the_same_numbers():
    assert _constant("OMJ_SCHEMA") == SCHEMA == int(WRITTEN["schema"], 16)
    assert _constant("OMJ_PROTOCOL") == PROTOCOL
    assert _constant("OMJ_LONGEST_FRAME") == MAX_FRAME_SIZE
    assert _constant("OMJ_MOST_WHEELS") == MAX_WHEELS
    assert _constant("OMJ_MOST_CHANNELS") == MAX_CHANNELS
    assert _constant("OMJ_HEADER_SIZE") == HEADER.size
    assert _constant("OMJ_FAULT_CODES") == max(FaultCode) + 1 == len(FaultCode)
    assert _constant("OMJ_QUANTITIES") == max(Quantity) + 1 == len(Quantity)
    assert _constant("OMJ_RAWS") == len(Raw)
    assert _constant("OMJ_STATUSES") == 2 ** len(Status) == sum(Status) + 1


@pytest.mark.parametrize(
    ("enumeration", "prefix"),
    [(MessageType, ""), (Quantity, "QUANTITY_"), (Raw, "RAW_"), (Status, "STATUS_"), (FaultCode, "FAULT_")],
)
def test_the_header_names_the_same_choices(enumeration, prefix):
    for one in enumeration:
        assert re.search(rf"\bOMJ_{prefix}{one.name} = {int(one)}\b", HEADER_FILE), one


def test_the_schema_holds_everything_that_both_sides_must_agree_on():
    assert WRITTEN["schema_text"] == SCHEMA_TEXT.splitlines() and SCHEMA_TEXT.endswith("\n")
    for kind in MessageType:
        assert f"\n{kind.name} {int(kind)}:" in SCHEMA_TEXT


@pytest.fixture(scope="module")
def in_c(tmp_path_factory):
    """Asks the C header, line by line."""
    assert COMPILER
    program = tmp_path_factory.mktemp("c") / "link_check"
    source = Path(__file__).with_name("link_check.c")
    built = subprocess.run(
        [COMPILER, *STRICT, "-O1", "-I", str(ROOM / "firmware"), str(source), "-o", str(program)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr

    def ask(questions: list[str]) -> list[str]:
        done = subprocess.run(
            [str(program)], input="\n".join(questions), capture_output=True, text=True, check=True
        )
        answers = done.stdout.splitlines()
        assert len(answers) == len(questions)
        return answers

    return ask


@needs_compiler
def test_the_header_alone_is_strict_freestanding_c99(tmp_path):
    source = tmp_path / "alone.c"
    source.write_text('#include "omnimj_link.h"\nint nothing(void);\nint nothing(void) { return 0; }\n')
    for level in ("-O0", "-O2"):
        built = subprocess.run(
            [
                COMPILER,
                *STRICT,
                *WARY,
                level,
                "-I",
                ROOM / "firmware",
                "-c",
                source,
                "-o",
                tmp_path / "alone.o",
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        assert built.returncode == 0, built.stderr


@needs_compiler
def test_c_reads_and_writes_the_golden_frames(in_c):
    rows = WRITTEN["frames"]
    requests = [f"frame {WRITTEN['key'] if row['keyed'] else '-'} {row['packet']}" for row in rows]
    for row, answer in zip(rows, in_c(requests), strict=True):
        verdict, again = answer.split("|")
        assert verdict.strip() == f"right {row['told']}" and again == row["packet"], row["name"]
    stuffed = in_c([f"cobs {row['packet']}" for row in rows])
    assert stuffed == [row["stuffed"] for row in rows]
    streamed = in_c([f"stream ff{row['stuffed']}00{row['stuffed']}" for row in rows])
    for row, answer in zip(rows, streamed, strict=True):
        assert answer == f"{row['packet']} dropped 1"


def _spoiled(rng: random.Random, rows: list[dict]) -> bytes:
    """A golden packet with some bytes changed, but for every other one with its checksum made right again."""
    packet = bytearray.fromhex(rng.choice(rows)["packet"])
    for _ in range(rng.randint(1, 3)):
        packet[rng.choice((rng.randrange(len(packet)), rng.randrange(24, len(packet))))] = rng.randrange(256)
    if rng.random() < 0.3:
        del packet[rng.randrange(len(packet)) :]
    if rng.random() < 0.1:
        packet += rng.randbytes(rng.randint(1, 500))
    if rng.random() < 0.8 and len(packet) > 4:
        packet[-4:] = zlib.crc32(packet[:-4]).to_bytes(4, "little")
    return bytes(packet)


@needs_compiler
def test_c_and_python_drop_and_read_the_same(in_c):
    rng = random.Random(5)
    plain = [row for row in WRITTEN["frames"] if not row["keyed"]]
    requests, expected, seen = [], [], set()
    for _ in range(6000):
        packet = _spoiled(rng, plain if rng.random() < 0.8 else WRITTEN["frames"])
        key = rng.choice((None, KEY, None))
        frame = decode(packet, key)
        seen.add(frame if isinstance(frame, DropReason) else None)
        requests.append(f"frame {SECRET.hex() if key else '-'} {packet.hex() or '-'}")
        expected.append(f"drop {int(frame)}" if isinstance(frame, DropReason) else f"right {describe(frame)}")
    answers = [answer.split("|")[0].strip() for answer in in_c(requests)]
    assert answers == expected
    assert seen == {None, *DropReason} - {DropReason.STUFFING}, "every way out is met"


@needs_compiler
def test_c_stuffs_and_cuts_streams_as_python_does(in_c):
    rng = random.Random(6)
    contents = [
        rng.choice((rng.randbytes, _no_zeros))(n) for n in (1, 2, 252, 253, 254, 255, 256, 507, 508, 509, 512)
    ]
    contents += [bytes(n) for n in (1, 254, 255, 512)]
    assert in_c([f"cobs {content.hex()}" for content in contents]) == [
        cobs.encode(content).hex() + "00" for content in contents
    ]
    lines = [bytes(rng.choices(range(256), [40] + [1] * 255, k=4000)) for _ in range(10)]
    lines += [
        b"\0".join(cobs.encode(rng.randbytes(rng.randint(28, 516))) for _ in range(8)) for _ in range(30)
    ]
    for line, answer in zip(lines, in_c([f"stream {line.hex()}" for line in lines]), strict=True):
        stream = PacketStream()
        packets = "".join(packet.hex() + " " for packet in stream.feed(line))
        assert answer.startswith(f"{packets}dropped ")
        assert abs(int(answer.split()[-1]) - stream.drops.total) <= 1, "an overlong last piece counts early"


def _no_zeros(size: int) -> bytes:
    return bytes(1 + i % 255 for i in range(size))


@needs_compiler
def test_c_and_python_refuse_the_same_keys(in_c):
    rng = random.Random(8)
    keys = [SECRET, bytes(32), b"\xff" * 32, bytes(range(32)), bytes(range(0, 256, 8)), SECRET[:8] * 4]
    keys += [bytes(rng.choices(range(20), k=32)) for _ in range(50)] + [rng.randbytes(32) for _ in range(50)]
    answers = in_c([f"weak {key.hex()}" for key in keys])
    assert answers == [str(int(is_weak(key))) for key in keys]
    assert answers[:6] == ["0", "1", "1", "1", "1", "1"] and answers[-50:] == ["0"] * 50


@needs_compiler
def test_c_makes_the_hashes_that_python_makes(in_c):
    rng = random.Random(7)
    sizes = (0, 1, 3, 63, 64, 65, 127, 128, 129, 500)
    contents = [rng.randbytes(size) for size in sizes]
    requests, expected = [], []
    for content in contents:
        for key in (b"", SECRET, SECRET[:7]):
            for length in (1, 16, 32):
                requests.append(f"blake {key.hex() or '-'} {length} {content.hex() or '-'}")
                expected.append(hashlib.blake2s(content, key=key, digest_size=length).hexdigest())
    assert in_c(requests) == expected
    sessions = [rng.randbytes(24) for _ in range(20)]
    made = in_c([f"session {SECRET.hex()} {hello.hex()}" for hello in sessions])
    for hello, key in zip(sessions, made, strict=True):
        connection = hello[16:] + hello[:16]
        own = KEY.session_key(connection).tag(b"content")
        assert Key(bytes.fromhex(key)).tag(b"content") == own
    addresses = [rng.randbytes(20 + size) for size in (0, 6, 18, 44)]
    cookies = in_c([f"cookie {SECRET.hex()} {content.hex()}" for content in addresses])
    for content, cookie in zip(addresses, cookies, strict=True):
        digest = hashlib.blake2s(content, key=SECRET, digest_size=8).digest()
        assert int(cookie, 16) == int.from_bytes(digest, "little")
    sums = in_c([f"crc {content.hex() or '-'}" for content in contents])
    assert sums == [f"{zlib.crc32(content):08x}" for content in contents]
