"""`omnimj report-bug`: versions, machine and last command as text for a bug report, without private data."""

from __future__ import annotations

import argparse
import contextlib
import importlib.metadata
import json
import os
import platform
import re
from pathlib import Path
from typing import Any

import omnimj
from omnimj.cli.arguments import Command
from omnimj.cli.terminal import format_json
from omnimj.resources import cache_root

_FILE = "last_command.json"
_MAX_SIZE = 100_000
_ADDRESS = re.compile(r"\b(udp|tcp|tls):(//)?(\[[^\]]*\]|[^\s:/]+):(\d+)")
_PUNCTUATION = re.compile(r"([('\"]*)(.*?)([)'\":;,]*)", re.DOTALL)
_SECRET = ("--key-file",)
_LIBRARIES = (
    "mujoco",
    "numpy",
    "scipy",
    "numba",
    "llvmlite",
    "rerun-sdk",
    "pyarrow",
    "bokeh",
    "pillow",
    "jinja2",
    "tomlkit",
    "pyserial",
    "cma",
    "distributed",
    "gymnasium",
    "mcap",
    "rosbags",
)
_ENVIRONMENT = (
    "MUJOCO_GL",
    "NUMBA_DISABLE_JIT",
    "NUMBA_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj report-bug`."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of Markdown")


def run(arguments: Any) -> int:
    """Print the report."""
    content = {
        "omnimj": omnimj.__version__,
        "python": f"{platform.python_version()} ({platform.python_implementation()})",
        "machine": _machine(),
        "libraries": _versions(),
        "environment": {name: os.environ[name] for name in _ENVIRONMENT if name in os.environ},
        "last command": read_last_command(),
    }
    print(format_json(content) if arguments.json else _markdown(content))
    return 0


def _machine() -> str:
    return f"{platform.system()} {platform.release()}, {platform.machine()}, {os.cpu_count()} logical cores"


def _versions() -> dict[str, str]:
    found = {}
    for name in _LIBRARIES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def _markdown(content: dict[str, Any]) -> str:
    last = content["last command"]
    lines = [
        "### Versions and machine",
        "",
        f"- omnimj {content['omnimj']}, Python {content['python']}",
        f"- {content['machine']}",
        f"- {', '.join(f'{name} {version}' for name, version in content['libraries'].items())}",
    ]
    if content["environment"]:
        lines.append(f"- {', '.join(f'{name}={value}' for name, value in content['environment'].items())}")
    lines += ["", "### Last command", ""]
    if last:
        lines += [
            "```",
            last["command"],
            *([last["error"]] if last["error"] else []),
            f"exit code {last['code']}",
        ]
        lines += ["```"]
    else:
        lines.append("none is known")
    lines += ["", "### What happened, and what you expected", "", "…"]
    return "\n".join(lines)


def without_private_data(words: list[str]) -> str:
    """Join a command line, with file names only, without folders, hosts and keys."""
    shown = ["FILE" if before in _SECRET else word for before, word in zip(["", *words], words, strict=False)]
    return _plain(" ".join(shown))


def _plain(text: str) -> str:
    """Text without folders and hosts; ports such as /dev/ttyACM0 identify no person."""
    return " ".join(map(_plain_word, text.split(" ")))


def _plain_word(word: str) -> str:
    if _ADDRESS.search(word) or "serial:/dev/" in word:
        return _ADDRESS.sub(r"\1:\2HOST:\4", word)
    key, equals, value = word.rpartition("=")
    start, core, end = _PUNCTUATION.fullmatch(value).groups()  # type: ignore[union-attr]  # matches any word
    return key + equals + start + re.split(r"[/\\]", core)[-1] + end


def store_last_command(words: list[str], code: int, error: str = "") -> None:
    """Keep the command line and its end for a bug report; a failure to do so is ignored."""
    folder = cache_root()
    if folder is None or words[1:2] == [REPORT_BUG.name]:
        return
    content = {"command": without_private_data(words), "code": code, "error": _plain(error)}
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        temporary = folder / f".{_FILE}.{os.getpid()}"
        temporary.write_text(json.dumps(content), encoding="utf-8")
        temporary.replace(folder / _FILE)


def read_last_command() -> dict[str, Any] | None:
    """Read the last command with its exit code and error; None if it is unknown."""
    folder = cache_root()
    if folder is None:
        return None
    file = Path(folder) / _FILE
    try:
        if not file.is_file() or file.stat().st_size > _MAX_SIZE:
            return None
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(found, dict) or not all(isinstance(found.get(k), str) for k in ("command", "error")):
        return None
    return {"command": found["command"], "code": found.get("code"), "error": found["error"]}


REPORT_BUG = Command(
    "report-bug",
    "print versions, machine and last command for a bug report, without private data",
    "example:\n  omnimj report-bug",
    add_arguments,
    run,
)
