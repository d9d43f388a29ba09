"""Seal of the benchmark's truth: compressed and encrypted, with the key in a separate file.

It prevents workflow and users from seeing the truth by accident; only scoring opens it.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import secrets
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from omnimj.errors import InputError, write_failure
from omnimj.recording.folder import atomic_file

_KEY, _TAG = 32, 32  # bytes


def seal(folder: Path, labels: Sequence[dict[str, Any]]) -> None:
    """Write `labels.sealed` and `labels.key`, which only its owner can read."""
    sealed, key_file = _files(folder)
    key = secrets.token_bytes(_KEY)
    text = _text(labels)
    packed = zlib.compress(text, 9)
    hidden = bytes(a ^ b for a, b in zip(packed, _stream(key, len(packed)), strict=True))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(key_file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "wb") as file:
            file.write(key)
        with atomic_file(sealed) as temporary:
            temporary.write_bytes(_tag(key, text) + hidden)
    except FileExistsError:
        raise InputError(key_file, "exists already", "a seal is made once") from None
    except OSError as error:
        raise write_failure(folder, error) from None


def is_sealed(folder: Path) -> bool:
    """Return whether both files exist."""
    return all(file.is_file() for file in _files(folder))


def seals_labels(folder: Path, labels: Sequence[dict[str, Any]]) -> bool:
    """Return whether these labels are the sealed ones, without opening the seal."""
    sealed, key_file = _files(folder)
    key, content = _read(key_file), _read(sealed)
    return hmac.compare_digest(content[:_TAG], _tag(key, _text(labels)))


def open_seal(folder: Path) -> list[dict[str, Any]]:
    """Return the labels, for scoring only.

    Raises:
      InputError: A file is missing or was changed.
    """
    sealed, key_file = _files(folder)
    key, content = _read(key_file), _read(sealed)
    hidden = content[_TAG:]
    packed = bytes(a ^ b for a, b in zip(hidden, _stream(key, len(hidden)), strict=True))
    try:
        text = zlib.decompress(packed)
    except zlib.error:
        text = b""
    if not hmac.compare_digest(content[:_TAG], _tag(key, text)):
        raise InputError(f"{sealed}", "is broken, or was sealed with another key", "start in another folder")
    return json.loads(text)


def _files(folder: Path) -> tuple[Path, Path]:
    return folder / "labels.sealed", folder / "labels.key"


def _text(labels: Sequence[dict[str, Any]]) -> bytes:
    return json.dumps(list(labels), sort_keys=True, allow_nan=False).encode("utf-8")


def _stream(key: bytes, length: int) -> bytes:
    return hashlib.shake_256(b"omnimj labels" + key).digest(length)


def _tag(key: bytes, text: bytes) -> bytes:
    return hmac.new(key, text, hashlib.sha256).digest()


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise InputError(f"{file}", f"cannot be read ({error.strerror})") from None
