"""Secret key of a link, the key of a session, and the key file, which only its owner may read."""

from __future__ import annotations

import hashlib
import hmac
import itertools
import os
import stat
from collections.abc import Callable
from pathlib import Path

from omnimj.errors import InputError
from omnimj.link.codec.layout import TAG_SIZE, DropReason

KEY_SIZE = 32
"""Length of a key [bytes]."""
MIN_DISTINCT = 16
"""Number of distinct bytes, and of distinct differences of neighbours, that a key needs.

A random key has fewer with a probability below 1e-15.
"""
_MAX_FILE_SIZE = 200
_PRIVATE = (0o600, 0o400)
_SESSION_OFFSET = 4  # of the session number in the header
_SESSION_LABEL = b"omnimj session 2"


class Key:
    """Secret of 32 bytes that authenticates the frames of a link; never printed."""

    __slots__ = ("_keyed", "_secret")

    def __init__(self, secret: bytes):
        if len(secret) != KEY_SIZE:
            raise InputError("key", f"{len(secret)} bytes", f"{KEY_SIZE} are needed")
        if is_weak(secret):
            raise InputError("key", "too regular to be random", "32 random bytes are needed")
        self._secret = secret
        self._keyed = hashlib.blake2s(key=secret, digest_size=TAG_SIZE)

    def tag(self, content: bytes) -> bytes:
        """Authentication tag: keyed BLAKE2s of the content, 16 bytes."""
        digest = self._keyed.copy()
        digest.update(content)
        return digest.digest()

    def verify(self, content: bytes, tag: bytes) -> DropReason | None:
        """Reason to reject the tag, or None; the comparison takes constant time."""
        return None if hmac.compare_digest(self.tag(content), tag) else DropReason.TAG

    def session_key(self, connection: bytes) -> Key:
        """Key of one session: keyed BLAKE2s of a label and the connection, 32 bytes.

        Args:
          connection: Identity of the device, nonce of the host, cookie; each u64, little endian.
        """
        return Key(hashlib.blake2s(_SESSION_LABEL + connection, key=self._secret).digest())

    def __repr__(self) -> str:
        return "Key(…)"


class SessionKeys:
    """Keys of one end of a link: frames of session 0 use the link's key, all others the session's."""

    def __init__(self, key: Key, connection: Callable[[], bytes]):
        """Prepare.

        Args:
          key: Key of the link.
          connection: Returns the present connection, see `Key.session_key`.
        """
        self._key, self._connection = key, connection
        self._of, self._session_key = b"", key

    def tag(self, content: bytes) -> bytes:
        """Authentication tag of header and payload, 16 bytes."""
        return self._key_of(content).tag(content)

    def verify(self, content: bytes, tag: bytes) -> DropReason | None:
        """Reason to reject the tag, or None; the comparison takes constant time."""
        return self._key_of(content).verify(content, tag)

    def _key_of(self, content: bytes) -> Key:
        if not any(content[_SESSION_OFFSET : _SESSION_OFFSET + 4]):
            return self._key
        connection = self._connection()
        if connection != self._of:
            self._of, self._session_key = connection, self._key.session_key(connection)
        return self._session_key


FrameKey = Key | SessionKeys
"""Source of the tags of frames."""


def is_weak(secret: bytes) -> bool:
    """True if bytes are all equal, repeat, or count up, so that they are no random key."""
    steps = {(b - a) % 256 for a, b in itertools.pairwise(secret)}
    return len(set(secret)) < MIN_DISTINCT or len(steps) < MIN_DISTINCT


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
                raise InputError(path, "is not a regular file", "a key file is needed")
            mode = stat.S_IMODE(status.st_mode)
            if os.name == "posix" and mode not in _PRIVATE:
                raise InputError(path, f"mode {mode:04o}", "a key file must have mode 0600 (chmod 600)")
            digits = file.read(_MAX_FILE_SIZE).strip()
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "a key file is needed") from None
    if len(digits) != 2 * KEY_SIZE or digits.strip(b"0123456789abcdefABCDEF"):
        raise InputError(path, "contains no key", f"{2 * KEY_SIZE} hexadecimal digits are needed")
    secret = bytes.fromhex(digits.decode("ascii"))
    if is_weak(secret):
        raise InputError(path, "too regular to be random", f"{KEY_SIZE} random bytes are needed")
    return Key(secret)
