"""Numbers in ROS 2 messages (CDR), read by the message's definition without making objects or code.

Every field that holds a number becomes a value with a path, `pose.pose.position.x`. Sequences get an index,
`data[0]`, or the name that a list of names in the same message gives them, `velocity[wheel_1]`. Texts,
covariances and arrays of more than `MOST_ENTRIES` entries are skipped.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from omnimj.errors import InputError

MOST_ENTRIES = 64
"""Largest array whose entries become columns."""
NAME_FIELDS = ("name", "names", "joint_names")
"""Fields that name the entries of the other lists of their message."""
_ELEMENT_NAMES = ("child_frame_id", "name")
_DEEPEST, _MOST_FIELDS = 12, 4096
_LENGTH = struct.Struct("<I")
_CODES: Mapping[str, tuple[str, int]] = {
    "bool": ("?", 1),
    "byte": ("B", 1),
    "char": ("B", 1),
    "int8": ("b", 1),
    "uint8": ("B", 1),
    "int16": ("h", 2),
    "uint16": ("H", 2),
    "int32": ("i", 4),
    "uint32": ("I", 4),
    "int64": ("q", 8),
    "uint64": ("Q", 8),
    "float32": ("f", 4),
    "float64": ("d", 8),
}
_WHOLE = "bBhHiIqQ?"

Definitions = Mapping[str, tuple[Any, list[tuple[str, Any]]]]
"""Types by name, as `rosbags` parses them: constants, and fields with their descriptions."""


class _Step(Protocol):
    def walk(self, buffer: memoryview, at: int, values: list[float], key: list[Any]) -> int:
        """Read from `at`; append numbers to `values`, and what their names depend on to `key`."""
        ...

    def names(self, key: Iterator[Any], labels: dict[str, tuple[str, ...]]) -> list[str]:
        """Paths of the values that `walk` has appended."""
        ...


@dataclass(frozen=True)
class _Run:
    """Fields of fixed size, read at once; `layouts` by position modulo 8, since CDR aligns."""

    layouts: tuple[struct.Struct, ...]
    paths: tuple[str, ...]

    def walk(self, buffer: memoryview, at: int, values: list[float], key: list[Any]) -> int:
        layout = self.layouts[at & 7]
        values += layout.unpack_from(buffer, at)
        return at + layout.size

    def names(self, key: Iterator[Any], labels: dict[str, tuple[str, ...]]) -> list[str]:
        return list(self.paths)


def _run(fields: list[tuple[str | None, str, int, int]]) -> _Run:
    """Make a run of fields: path (None: skipped), code, size and count."""
    layouts = []
    for start in range(8):
        at, text = start, "<"
        for path, code, size, count in fields:
            gap = -at % size
            text += f"{gap}x" * (gap > 0) + (f"{size * count}x" if path is None else f"{count}{code}")
            at += gap + size * count
        layouts.append(struct.Struct(text))
    paths = [
        path if count == 1 else f"{path}[{k}]"
        for path, _, _, count in fields
        if path is not None
        for k in range(count)
    ]
    return _Run(tuple(layouts), tuple(paths))


@dataclass(frozen=True)
class _Text:
    """A text, skipped unless it names its element."""

    path: str
    kept: bool

    def walk(self, buffer: memoryview, at: int, values: list[float], key: list[Any]) -> int:
        at, text = _read_text(buffer, at, self.kept)
        if self.kept:
            key.append(text)
        return at

    def names(self, key: Iterator[Any], labels: dict[str, tuple[str, ...]]) -> list[str]:
        if self.kept:
            labels[self.path] = (next(key),)
        return []


@dataclass(frozen=True)
class _Texts:
    """A list of texts, kept where they name the entries of the lists beside it."""

    scope: str
    kept: bool
    count: int | None

    def walk(self, buffer: memoryview, at: int, values: list[float], key: list[Any]) -> int:
        at, count = _read_count(buffer, at, 5) if self.count is None else (at, self.count)
        kept = self.kept and count <= MOST_ENTRIES
        texts = []
        for _ in range(count):
            at, text = _read_text(buffer, at, kept)
            texts.append(text)
        if self.kept:
            key.append(tuple(texts) if kept else ())
        return at

    def names(self, key: Iterator[Any], labels: dict[str, tuple[str, ...]]) -> list[str]:
        if self.kept:
            labels[self.scope] = next(key)
        return []


@dataclass(frozen=True)
class _Numbers:
    """A list of numbers."""

    path: str
    scope: str
    code: str
    size: int

    def walk(self, buffer: memoryview, at: int, values: list[float], key: list[Any]) -> int:
        at, count = _read_count(buffer, at, self.size)
        if count:
            at += -at % self.size
        end = at + count * self.size
        if end > len(buffer):
            raise ValueError(f"{self.path} claims {count} entries")
        kept = count <= MOST_ENTRIES and self.path != ""
        key.append(count if kept else 0)
        if kept:
            values += struct.unpack_from(f"<{count}{self.code}", buffer, at)
        return end

    def names(self, key: Iterator[Any], labels: dict[str, tuple[str, ...]]) -> list[str]:
        count, given = next(key), labels.get(self.scope, ())
        unique = len(set(given)) == count == len(given)
        return [f"{self.path}[{given[k] if unique else k}]" for k in range(count)]


@dataclass(frozen=True)
class _Messages:
    """A list of messages."""

    path: str
    steps: tuple[_Step, ...]
    count: int | None

    def walk(self, buffer: memoryview, at: int, values: list[float], key: list[Any]) -> int:
        at, count = _read_count(buffer, at, 1) if self.count is None else (at, self.count)
        kept = count <= MOST_ENTRIES
        key.append(count if kept else 0)
        for _ in range(count):
            into, what = (values, key) if kept else ([], [])
            for step in self.steps:
                at = step.walk(buffer, at, into, what)
        return at

    def names(self, key: Iterator[Any], labels: dict[str, tuple[str, ...]]) -> list[str]:
        found = []
        for k in range(next(key)):
            inner: dict[str, tuple[str, ...]] = {}
            below = [name for step in self.steps for name in step.names(key, inner)]
            label = next((inner[n][0] for n in _ELEMENT_NAMES if n in inner), "") or f"{k}"
            found += [f"{self.path}[{label}].{name}" for name in below]
        return found


def _read_count(buffer: memoryview, at: int, least: int) -> tuple[int, int]:
    """Number of entries, each of at least so many bytes."""
    at += -at % 4
    (count,) = _LENGTH.unpack_from(buffer, at)
    if count * least > len(buffer) - at:
        raise ValueError(f"a list claims {count} entries")
    return at + 4, count


def _read_text(buffer: memoryview, at: int, kept: bool) -> tuple[int, str]:
    at += -at % 4
    (length,) = _LENGTH.unpack_from(buffer, at)
    end = at + 4 + length
    if end > len(buffer):
        raise ValueError(f"a text claims {length} bytes")
    text = str(buffer[at + 4 : max(end - 1, at + 4)], "utf-8", "replace") if kept else ""
    return end, text if text.isprintable() else repr(text)


class CdrNumbers:
    """Reader of the numbers in messages of one type."""

    def __init__(self, type_name: str, types: Definitions):
        """Prepare the reading.

        Raises:
          InputError: A type is not defined, contains itself, or has too many fields.
        """
        self._type, self._types, self._fields = type_name, types, 0
        self._whole: set[str] = set()
        self._steps = self._compiled(type_name)
        first = types[type_name][1][:1]
        self._stamped = bool(first) and first[0][1][1] in (
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        )

    @property
    def whole(self) -> frozenset[str]:
        """Paths of fixed fields with whole numbers or switches."""
        return frozenset(self._whole)

    def read(self, payload: memoryview) -> tuple[int | None, tuple[Any, ...], list[float]]:
        """Read one message.

        Returns:
          Stamp in its header [ns], None without one; what the names of the values depend on; the values.

        Raises:
          ValueError: The message is shorter than its definition, or not little-endian CDR.
        """
        if len(payload) < 4 or payload[0] != 0 or payload[1] != 1:
            raise ValueError("the message is not little-endian CDR")
        values: list[float] = []
        key: list[Any] = []
        buffer, at = payload[4:], 0
        for step in self._steps:
            at = step.walk(buffer, at, values, key)
        if not self._stamped:
            return None, tuple(key), values
        return int(values[0]) * 1_000_000_000 + int(values[1]), tuple(key), values[2:]

    def names(self, key: tuple[Any, ...]) -> tuple[str, ...]:
        """Paths of the values that `read` returned with this key."""
        labels: dict[str, tuple[str, ...]] = {}
        left = iter(key)
        found = [name for step in self._steps for name in step.names(left, labels)]
        return tuple(found[2:] if self._stamped else found)

    def _compiled(self, type_name: str, depth: int = 0, in_list: bool = False) -> tuple[_Step, ...]:
        steps: list[_Step] = []
        pending: list[tuple[str | None, str, int, int]] = []
        for step in self._flat(type_name, "", depth, in_list):
            if isinstance(step, tuple):
                pending.append(step)
                continue
            if pending:
                steps.append(_run(pending))
                pending = []
            steps.append(step)
        return (*steps, _run(pending)) if pending else tuple(steps)

    def _flat(self, type_name: str, prefix: str, depth: int, in_list: bool) -> Iterator[Any]:
        """Yield fixed fields as tuples and everything else as steps, in the order of the message."""
        if type_name not in self._types:
            raise InputError(self._type, f"its part {type_name} is not defined")
        fields = self._types[type_name][1]
        if depth > _DEEPEST:
            raise InputError(self._type, "contains itself, or is nested too deeply")
        if not fields:  # an empty message has one byte, since IDL knows no empty structures
            yield None, "B", 1, 1
        for name, (kind, about) in fields:
            self._fields += 1
            if self._fields > _MOST_FIELDS:
                raise InputError(self._type, f"has more than {_MOST_FIELDS} fields")
            path = f"{prefix}{name}"
            if kind.name == "NAME":
                yield from self._flat(about, f"{path}.", depth + 1, in_list)
            elif kind.name == "BASE":
                yield self._base(path, about[0], in_list and name in _ELEMENT_NAMES)
            else:
                yield from self._list(kind.name, path, prefix, name, about, depth)

    def _base(self, path: str, base: str, names_element: bool) -> Any:
        if base == "string":
            return _Text(path, names_element)
        if base not in _CODES:
            raise InputError(self._type, f"field {path} is of type {base}", "it is not read")
        code, size = _CODES[base]
        if code in _WHOLE:
            self._whole.add(path)
        return None if "covariance" in path else path, code, size, 1

    def _list(self, kind: str, path: str, prefix: str, name: str, about: Any, depth: int) -> Iterator[Any]:
        (inner, what), length = about
        count = length if kind == "ARRAY" else None
        if inner.name == "NAME":
            yield _Messages(path, self._compiled(what, depth + 1, True), count)
        elif what[0] == "string":
            yield _Texts(prefix, name in NAME_FIELDS, count)
        elif what[0] not in _CODES:
            raise InputError(self._type, f"field {path} is of type {what[0]}", "it is not read")
        else:
            code, size = _CODES[what[0]]
            left_out = "covariance" in path
            if count is None:
                yield _Numbers("" if left_out else path, prefix, code, size)
            elif count:
                skipped = left_out or count > MOST_ENTRIES
                yield None if skipped else path, code, size, count
