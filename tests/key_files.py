"""Key files of a link."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from omnimj.link.codec.key import KEY_SIZE


def make_key_file(path: str | Path) -> None:
    """Write a new random key to a new file with mode 0600."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(secrets.token_hex(KEY_SIZE).encode("ascii") + b"\n")
