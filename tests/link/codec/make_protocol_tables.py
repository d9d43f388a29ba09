"""Writes the generated parts of `PROTOCOL.md` from the table of messages.

Run as `python tests/link/codec/make_protocol_tables.py` after a change of `omnimj/link/codec/layout.py`.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import omnimj.link
from omnimj.link.codec.layout import (
    CHECKSUM_SIZE,
    HEADER_FIELDS,
    MESSAGES,
    SCHEMA,
    SCHEMA_TEXT,
    TAG_SIZE,
    Field,
)

PROTOCOL_FILE = Path(omnimj.link.__file__).with_name("PROTOCOL.md")


def with_offsets(fields: Iterable[Field]) -> list[tuple[int, Field]]:
    """Fields with their distance from the first one [bytes]."""
    found, at = [], 0
    for field in fields:
        found.append((at, field))
        at += field.size
    return found


def _row(*cells: object) -> str:
    return "".join(f"| {cell} " if cell != "" else "| " for cell in cells) + "|"


def header() -> str:
    """Table of a frame."""
    fields = with_offsets(HEADER_FIELDS)
    size = sum(field.size for field in HEADER_FIELDS)
    rows = [_row(at, field.size, field.name, field.meaning) for at, field in fields]
    rows += [
        _row(size, "n", "payload", "by type"),
        _row(f"{size}+n", f"0 or {TAG_SIZE}", "tag", "section 5; present if flags bit 0 is set"),
        _row("", CHECKSUM_SIZE, "crc32", "over all preceding bytes"),
    ]
    return "\n".join(["| offset | bytes | field | |", "|---|---|---|---|", *rows])


def schema() -> str:
    """Text of the schema and its checksum."""
    return f"The CRC-32 is **0x{SCHEMA:08X}**.\n\n```text\n{SCHEMA_TEXT}```"


def messages() -> str:
    """One section per message."""
    sections = []
    for kind, layout in MESSAGES.items():
        fields = with_offsets((*layout.fields, *layout.items))
        rows = [_row(at, field.name, field.type, field.meaning) for at, field in fields]
        head = ["| offset | field | type | |", "|---|---|---|---|"]
        table = "\n".join([*head, *rows]) if rows else "No payload."
        note = f"\n\n{layout.note}" if layout.note else ""
        sections.append(f"### {kind.name} {int(kind)}, {layout.sender}\n\n{table}{note}")
    return "\n\n".join(sections)


def updated(text: str) -> str:
    """The document with its generated parts made anew."""
    for make in (header, schema, messages):
        begin, end = f"<!-- generated: {make.__name__} -->\n", "\n<!-- end -->"
        before, found, rest = text.partition(begin)
        _, closed, after = rest.partition(end)
        assert found and closed, make.__name__
        text = before + begin + make() + end + after
    return text


if __name__ == "__main__":
    PROTOCOL_FILE.write_text(updated(PROTOCOL_FILE.read_text(encoding="utf-8")), encoding="utf-8")
