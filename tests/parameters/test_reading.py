"""Model files: whatever is in them is either read or refused in one line that names the file."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from omnimj.errors import InputError
from omnimj.parameters import read_floors, read_rig, read_robot
from omnimj.parameters.reading import SOURCES, Rule, check_number, read_toml
from omnimj.resources import models_folder

SHIPPED = {
    "robot.toml": models_folder() / "uto_robot" / "robot.toml",
    "rig.toml": models_folder() / "quarter_rig" / "rig.toml",
    "floors.toml": models_folder() / "floors.toml",
    "parts.toml": models_folder() / "parts.toml",
}
NAMES = st.sampled_from(list(SHIPPED))
CONTENT = {name: path.read_bytes() for name, path in SHIPPED.items()}


def read(folder: Path, name: str, content: bytes) -> Any:
    """Reads the folder's file `name` with this content, through the file that names it."""
    (folder / "parts.toml").unlink(missing_ok=True)
    (folder / name).write_bytes(content)
    if name == "floors.toml":
        return read_floors(folder / name)
    if name == "rig.toml":
        return read_rig(folder / name)
    if name == "parts.toml":
        (folder / "robot.toml").write_bytes(CONTENT["robot.toml"])
    return read_robot(folder / "robot.toml")


def read_or_refused(folder: Path, name: str, content: bytes) -> Any:
    """What was read; None if it was refused in the one way that is allowed."""
    try:
        return read(folder, name, content)
    except InputError as error:
        message = str(error)
        # with other text around a mistake the error may name the model file that lacks what the parts lost
        assert message.startswith((str(folder / name), str(folder / "robot.toml")))
        assert len(message) < 2000
        assert "\n" not in message
        return None


def numbers_of(record: Any) -> list[float]:
    """Every number in a record of records."""
    if dataclasses.is_dataclass(record):
        return [x for f in dataclasses.fields(record) for x in numbers_of(getattr(record, f.name))]
    if isinstance(record, tuple | list):
        return [x for entry in record for x in numbers_of(entry)]
    if isinstance(record, dict):
        return [x for entry in record.values() for x in numbers_of(entry)]
    return [record] if isinstance(record, int | float) else []


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("models")


@pytest.mark.parametrize("name", SHIPPED)
def test_a_copy_in_any_folder_has_the_same_values(tmp_path, name):
    shipped = {"floors.toml": read_floors, "rig.toml": read_rig}.get(name, read_robot)()
    copy = read(tmp_path, name, CONTENT[name])
    if name != "floors.toml":
        copy = dataclasses.replace(copy, file=shipped.file)
    assert repr(copy) == repr(shipped)


def test_what_a_reader_does_with_its_tables_does_not_reach_other_readers(tmp_path):
    path = tmp_path / "tables.toml"
    path.write_text("[a]\nb = [1, 2]\n", encoding="utf-8")
    first = read_toml(path)
    first["a"]["b"].append(3)
    assert read_toml(path) == {"a": {"b": [1, 2]}}
    path.write_text("[a]\nb = [4]\n", encoding="utf-8")
    assert read_toml(path) == {"a": {"b": [4]}}


@given(name=NAMES, cut=st.integers(0, 10_000))
def test_a_truncated_file_is_read_or_refused(folder, name, cut):
    read_or_refused(folder, name, CONTENT[name][: cut % len(CONTENT[name])])


@given(name=NAMES, place=st.integers(0, 10_000), flip=st.integers(1, 255))
def test_a_flipped_byte_is_read_or_refused(folder, name, place, flip):
    damaged = bytearray(CONTENT[name])
    damaged[place % len(damaged)] ^= flip
    found = read_or_refused(folder, name, bytes(damaged))
    assert all(map(math.isfinite, numbers_of(found)))


@given(name=NAMES, content=st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(folder, name, content):
    found = read_or_refused(folder, name, content)
    assert found is None or name == "floors.toml"  # an empty file is a list of no floors


VALUES = st.one_of(
    st.sampled_from(
        [
            "nan",
            "inf",
            "-inf",
            "0",
            "-1",
            "0.0",
            "-0.0",
            "true",
            "[]",
            "{}",
            "''",
            "[[1]]",
            "1979-05-27",
            "1e400",
        ]
    ),
    st.sampled_from(
        ["0x" + "f" * 5000, "9" * 400, "9" * 5000, "[" * 3000, "{ value = 1 }", "1e-320", "1e300"]
    ),
    st.floats().map(repr),
    st.integers().map(str),
    st.lists(st.floats(-1, 1), max_size=3).map(repr),
    st.text(max_size=20).map(repr),
)


@pytest.mark.slow
@settings(max_examples=200)
@given(name=NAMES, line=st.integers(0, 200), value=VALUES)
@example(name="robot.toml", line=0, value="0x" + "f" * 5000)
@example(name="floors.toml", line=1, value="0x" + "f" * 5000)
def test_a_retyped_value_is_read_or_refused(folder, name, line, value):
    lines = CONTENT[name].decode().splitlines()
    settable = [k for k, text in enumerate(lines) if " = " in text and not text.startswith("#")]
    k = settable[line % len(settable)]
    before, equals, after = lines[k].partition("value = " if "value = " in lines[k] else " = ")
    end = after.index(", unit") if "value = " in equals else len(after)
    lines[k] = before + equals + value + after[end:]
    found = read_or_refused(folder, name, "\n".join(lines).encode("utf-8", "replace"))
    assert all(map(math.isfinite, numbers_of(found)))


TREES = st.recursive(
    st.one_of(st.integers(-5, 5), st.text(max_size=3), st.booleans(), st.just(float("nan"))),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text("ab"), inner, max_size=3)),
    max_leaves=6,
)


@given(
    value=TREES, low=st.floats(-10, 10), width=st.floats(0, 10), whole=st.booleans(), open_low=st.booleans()
)
def test_a_number_that_passes_keeps_its_rule(value, low, width, whole, open_low):
    rule = Rule(low, low + width, open_low)
    try:
        found = check_number("here", value, rule, whole)
    except InputError as error:
        assert str(error).startswith("here: found ")
        return
    assert found == value and not isinstance(value, bool)
    assert low <= found <= low + width and not (open_low and found == low)
    assert isinstance(found, int) if whole else isinstance(found, float)


@pytest.mark.parametrize(("name", "reader"), [("robot.toml", read_robot), ("rig.toml", read_rig)])
def test_every_number_has_its_unit_and_a_known_source(name: str, reader: Callable[[], Any]):
    provenance = reader().provenance
    tree = {**tomllib.loads(CONTENT["parts.toml"].decode()), **tomllib.loads(CONTENT[name].decode())}
    tables = {key: value for key, value in tree.items() if isinstance(value, dict) and key != "hardware"}
    stated = {f"{table}.{key}" for table, entries in tables.items() for key in entries}
    assert stated == {key for key in provenance if not key.startswith("wheels.")}
    assert all(origin.source in SOURCES and origin.unit for origin in provenance.values())


def test_a_table_of_the_model_file_goes_before_the_same_of_the_parts(tmp_path):
    mine = '\n[motor]\nresistance = { value = 7.0, unit = "ohm", source = "measured" }\n'
    robot = read(tmp_path, "robot.toml", CONTENT["robot.toml"] + mine.encode())
    assert robot.motor.resistance == 7.0 and robot.provenance["motor.resistance"].source == "measured"
    assert robot.motor.torque_constant == read_robot().motor.torque_constant


def test_a_byte_order_mark_is_no_mistake(tmp_path):
    (tmp_path / "mine.toml").write_text("a = 1", encoding="utf-8-sig")
    assert read_toml(tmp_path / "mine.toml") == {"a": 1}


def test_the_largest_whole_numbers_of_toml_are_read(tmp_path):
    (tmp_path / "mine.toml").write_text(f"a = [{2**63 - 1}, {-(2**63)}]")
    assert read_toml(tmp_path / "mine.toml") == {"a": [2**63 - 1, -(2**63)]}
    for beyond in (2**63, -(2**63) - 1):
        (tmp_path / "mine.toml").write_text(f"a.b = [{{ c = {beyond} }}]")
        with pytest.raises(
            InputError, match=r"mine\.toml: is not valid TOML; a whole number has more than 64 bits"
        ):
            read_toml(tmp_path / "mine.toml")


def test_a_folder_here_does_not_hide_the_shipped_model_of_its_name(tmp_path, monkeypatch):
    (tmp_path / "three_wheel").mkdir()
    (tmp_path / "mine").mkdir()
    monkeypatch.chdir(tmp_path)
    assert len(read_robot("three_wheel").wheels) == 3
    with pytest.raises(InputError, match="mine: is a folder"):
        read_robot("mine")
