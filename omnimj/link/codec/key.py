"""The key that host and device share, and the file it lives in: for its owner's eyes, never an argument."""

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
"""Bytes."""
_LONGEST_FILE = 200
_PRIVATE = (0o600, 0o400)


class Key:
    """32 secret bytes that make the tags of a link; they are shown nowhere."""

    __slots__ = ("_keyed",)

    def __init__(self, secret: bytes):
        if len(secret) != KEY_SIZE:
            raise InputError("key", f"{len(secret)} bytes", f"{KEY_SIZE} are needed")
        self._keyed = hashlib.blake2s(key=secret, digest_size=TAG_SIZE)

    def tag(self, content: bytes) -> bytes:
        """BLAKE2s of the content with the key, 16 bytes."""
        begun = self._keyed.copy()
        begun.update(content)
        return begun.digest()

    def verify(self, content: bytes, tag: bytes) -> DropReason | None:
        """Reason to reject the tag, or None; the comparison takes constant time."""
        return None if hmac.compare_digest(self.tag(content), tag) else DropReason.TAG

    def __repr__(self) -> str:
        return "Key(…)"


def read_key(path: str | Path) -> Key:
    """The key in a file of 64 hexadecimal digits that nobody but its owner may read (mode 0600).

    Raises:
      InputError: no such file, not a plain one, open to others, or no 64 digits. What is in it is never told.
    """
    try:
        # opened without waiting, since a named pipe is no key file, and looked at as it was opened
        with os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
            about = os.fstat(file.fileno())
            if not stat.S_ISREG(about.st_mode):
                raise InputError(path, "no plain file", "a key file is needed")
            mode = stat.S_IMODE(about.st_mode)
            if os.name == "posix" and mode not in _PRIVATE:
                raise InputError(path, f"mode {mode:04o}", "a key file must have mode 0600 (chmod 600)")
            digits = file.read(_LONGEST_FILE).strip()
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "a key file is needed") from None
    if len(digits) != 2 * KEY_SIZE or digits.strip(b"0123456789abcdefABCDEF"):
        raise InputError(path, "no key", f"{2 * KEY_SIZE} hexadecimal digits are needed")
    return Key(bytes.fromhex(digits.decode("ascii")))


def make_key_file(path: str | Path) -> None:
    """Writes a new random key to a new file with mode 0600.

    Raises:
      InputError: there is such a file already, or it cannot be written.
    """
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(secrets.token_hex(KEY_SIZE).encode("ascii") + b"\n")
    except OSError as error:
        raise InputError(
            path, f"cannot be made ({error.strerror})", "a key file is always a new file"
        ) from None
