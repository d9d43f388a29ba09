"""Reads a TOML file, or says in one line why it cannot be read."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omnimj.errors import InputError

_INTEGERS = range(-(2**63), 2**63)


def read_toml(path: Path) -> dict[str, Any]:
    """Parses a TOML file.

    Raises:
      InputError: The file is missing, cannot be read or is not TOML; the message names file and line.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise InputError(path, "no such file") from None
    except IsADirectoryError:
        raise InputError(path, "is a folder", "a TOML file is needed") from None
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})") from None
    except ValueError:  # a null byte
        raise InputError(path, "is no file name") from None
    try:
        # a TOML file has no byte order mark, but some editors write one
        return parse_toml(content.decode("utf-8-sig"))
    except RecursionError:
        raise InputError(path, "is not valid TOML", "it is nested too deeply") from None
    except ValueError as error:
        raise InputError(path, "is not valid TOML", str(error)) from None


def parse_toml(text: str) -> dict[str, Any]:
    """Parses TOML text; whole numbers are bound to 64 bits as TOML 1.0 has it, which Python's parser is not.

    Raises:
      ValueError: It is not TOML.
      RecursionError: It is nested too deeply.
    """
    tree = tomllib.loads(text)
    waiting: list[Any] = [tree]
    while waiting:  # no recursion: dotted keys nest to any depth
        node = waiting.pop()
        if isinstance(node, Mapping):
            waiting.extend(node.values())
        elif isinstance(node, list):
            waiting.extend(node)
        elif isinstance(node, int) and node not in _INTEGERS:
            # it may be too large for a float, and even for being printed
            raise ValueError("a whole number has more than 64 bits")
    return tree
