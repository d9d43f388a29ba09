"""The protocol document and the C header agree with the table of messages."""

from __future__ import annotations

import re

import pytest
from make_protocol_tables import PROTOCOL_FILE, updated

from omnimj.link.codec.layout import MESSAGES
from omnimj.link.codec.messages import FaultCode, MessageType

TEXT = PROTOCOL_FILE.read_text(encoding="utf-8")
FIRMWARE = PROTOCOL_FILE.with_name("firmware")
HEADER_FILE = (FIRMWARE / "omnimj_link.h").read_text(encoding="ascii")


def test_the_protocol_document_is_made_from_the_table_of_messages():
    assert updated(TEXT) == TEXT, "run python tests/link/codec/make_protocol_tables.py"


C_TYPES = {"u8": "uint8_t", "u16": "uint16_t", "u32": "uint32_t", "u64": "uint64_t", "f32": "float"}


def _struct_of_c(name: str) -> dict[str, str]:
    """Fields of a struct of the header, with their types."""
    (body,) = re.findall(rf"typedef struct {{([^{{}}]*)}} {name};", HEADER_FILE)
    found = {}
    for kind, names in re.findall(r"(\w+) ([\w, \[\]]+);", body):
        found |= {re.sub(r"\[.*", "", one.strip()): kind for one in names.split(",")}
    return found


@pytest.mark.parametrize(
    "kind", [k for k in MessageType if len(MESSAGES[k].fields) > 1 and k.name != "CHALLENGE"]
)
def test_the_header_has_every_field_of_a_message_with_its_type(kind):
    own, limits, layout = _struct_of_c(f"omj_{kind.name.lower()}"), _struct_of_c("omj_limits"), MESSAGES[kind]
    expected = {}
    for field in layout.fields:
        if (field.attribute or "").startswith("limits."):
            assert limits[field.name] == C_TYPES[field.type]
            expected["limits"] = "omj_limits"
        elif field.name != "zero":
            expected[field.name] = C_TYPES[field.type]
    if layout.item_record is not None:
        expected["channel"] = "omj_channel"
        assert _struct_of_c("omj_channel") == {
            field.name: C_TYPES[field.type] for field in layout.items if field.name != "zero"
        }
    elif layout.items:
        (item,) = layout.items
        expected[item.name] = C_TYPES.get(item.type, "omj_reading")
    assert own == expected


def test_the_protocol_names_every_fault_that_a_device_may_raise():
    assert [code.name for code in FaultCode if TEXT.count(code.name) < 2] == ["NONE"]


def test_the_protocol_shows_the_loop_of_the_example():
    (loop,) = re.findall(r"```c\n(.*?)```", TEXT, re.DOTALL)
    assert loop in (FIRMWARE / "firmware_example.c").read_text(encoding="ascii")
