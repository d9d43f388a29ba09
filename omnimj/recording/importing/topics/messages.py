"""Channels of recorded messages, and what the readers of files give to their caller."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from omnimj.errors import InputError, MissingLibrary

LARGEST_RECORD = 256 * 2**20
"""Largest record or chunk that is held in memory [bytes]: a damaged or hostile file can claim any size."""

OnMessage = Callable[[int, memoryview], None]
"""Function of the time at which a message was logged [ns] and of its content."""


@dataclass(frozen=True)
class Channel:
    """One topic as a file describes it."""

    topic: str
    type_name: str
    """Name of the message's type without `/msg/`: `sensor_msgs/Imu`; empty if the file has none."""
    encoding: str
    """Encoding of the messages: `cdr`, `json` …"""
    definition_format: str = ""
    """`ros2msg`, `ros2idl`, `jsonschema` …; empty without a definition."""
    definition: str = ""
    """Definition of the type, as text."""
    metadata: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))


OpenChannel = Callable[[Channel], OnMessage | None]
"""Function called at the first sight of a channel; None leaves its messages out."""

Progress = Callable[[float], None]
"""Function of the share of a file that is read."""


def plain_type(name: str) -> str:
    """Name of a message type without `msg/`, as ROS 1 and people write it."""
    return name.replace("/msg/", "/")


def require_module(place: object, name: str, library: str) -> Any:
    """Import a module of an optional library."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingLibrary(place, library, "import") from None


def not_whole(path: Path, kind: str, error: object, rule: str = "") -> InputError:
    """Return the error that reports a damaged file."""
    reason = " ".join(str(error).split())[:120] or type(error).__name__
    return InputError(path, f"is not a whole {kind} ({reason})", rule)
