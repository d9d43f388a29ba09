"""Secret key of a link and its file, which only its owner may read; a key is never an argument."""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import stat
from pathlib import Path

from omnimj.errors import InputError
from omnimj.link.codec.layout import TAG_SIZE, DropReason

KEY_SIZE = 32
"""Length of a key [bytes]."""
_MAX_FILE_SIZE = 200
_PRIVATE = (0o600, 0o400)


class Key:
    """Secret of 32 bytes that authenticates the frames of a link; never printed."""

    __slots__ = ("_keyed",)

    def __init__(self, secret: bytes):
        if len(secret) != KEY_SIZE:
            raise InputError("key", f"{len(secret)} bytes", f"{KEY_SIZE} are needed")
        self._keyed = hashlib.blake2s(key=secret, digest_size=TAG_SIZE)

    def tag(self, content: bytes) -> bytes:
        """Authentication tag: keyed BLAKE2s of the content, 16 bytes."""
        digest = self._keyed.copy()
        digest.update(content)
        return digest.digest()

    def verify(self, content: bytes, tag: bytes) -> DropReason | None:
        """Reason to reject the tag, or None; the comparison takes constant time."""
        return None if hmac.compare_digest(self.tag(content), tag) else DropReason.TAG

    def __repr__(self) -> str:
        return "Key(…)"


def read_key(path: str | Path) -> Key:
    """Read a key file: 64 hexadecimal digits, readable by its owner only (mode 0600).

    Raises:
      InputError: No regular file, readable by others, or not 64 digits; the content is never shown.
    """
    try:
        # non-blocking, since a named pipe would wait; checked through the open descriptor
        with os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise InputError(path, "no regular file", "a key file is needed")
            mode = stat.S_IMODE(status.st_mode)
            if os.name == "posix" and mode not in _PRIVATE:
                raise InputError(path, f"mode {mode:04o}", "a key file must have mode 0600 (chmod 600)")
            digits = file.read(_MAX_FILE_SIZE).strip()
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "a key file is needed") from None
    if len(digits) != 2 * KEY_SIZE or digits.strip(b"0123456789abcdefABCDEF"):
        raise InputError(path, "no key", f"{2 * KEY_SIZE} hexadecimal digits are needed")
    return Key(bytes.fromhex(digits.decode("ascii")))


def make_key_file(path: str | Path) -> None:
    """Write a new random key to a new file with mode 0600.

    Raises:
      InputError: The file exists or cannot be written.
    """
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(secrets.token_hex(KEY_SIZE).encode("ascii") + b"\n")
    except OSError as error:
        raise InputError(
            path, f"cannot be made ({error.strerror})", "a key file is always a new file"
        ) from None
