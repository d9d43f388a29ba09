"""Handshake of a device: a hello must return a cookie before any state is kept for its sender.

A cookie is a keyed hash of sender and nonce, so that the device recognises it without having stored it. It
proves that the sender receives what is sent to its address, and that its hello is not a replay: the hash
also covers a number that increases with every session, a coarse time, and a secret drawn at power-up.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import struct

from omnimj.link.codec.messages import Challenge, Hello

COOKIE_LIFETIME = 2.0
"""Shortest lifetime of a cookie; the longest is twice as long [s]."""
_INPUT, _CONNECTION = struct.Struct("<QIQ"), struct.Struct("<QQQ")


class Handshake:
    """Stateless answers to hellos, and the connection of the newest session."""

    def __init__(self, identity: int, secret: bytes | None = None):
        """Power up.

        Args:
          identity: Identity of the device, 64 bits; drawn if 0.
          secret: 32 random bytes; drawn if None.
        """
        self.identity = identity or secrets.randbits(64) or 1
        self._secret = secrets.token_bytes(32) if secret is None else secret
        self._sessions = 0
        self.hello = Hello(0, 0, self.identity)
        """Hello that began the newest session."""
        self.peer = b""
        """Sender of the hello that began the newest session."""

    @property
    def connection(self) -> bytes:
        """Identity, nonce of the host and cookie of the newest session, from which its key is derived."""
        return _CONNECTION.pack(self.identity, self.hello.nonce, self.hello.cookie)

    def challenge(self, now: float, hello: Hello, peer: bytes) -> Challenge:
        """Answer to a hello without a valid cookie."""
        return Challenge(hello.nonce, self._cookie(now, hello.nonce, peer), self.identity)

    def is_valid(self, now: float, hello: Hello, peer: bytes) -> bool:
        """True if a hello returns a cookie of this device, made for its sender and nonce not long ago."""
        found = hello.cookie.to_bytes(8, "little")
        allowed = [self._cookie(time, hello.nonce, peer) for time in (now, now - COOKIE_LIFETIME)]
        # both are compared, each in constant time
        matches = [hmac.compare_digest(found, cookie.to_bytes(8, "little")) for cookie in allowed]
        return hello.device == self.identity and any(matches)

    def is_newest(self, hello: Hello, peer: bytes) -> bool:
        """True if a hello repeats the one that began the newest session."""
        return (hello, peer) == (self.hello, self.peer)

    def begin_session(self, hello: Hello, peer: bytes) -> None:
        """Note who began a new session; all cookies made before become worthless."""
        self._sessions += 1
        self.hello, self.peer = hello, peer

    def _cookie(self, now: float, nonce: int, peer: bytes) -> int:
        era = int(max(0.0, now + COOKIE_LIFETIME) / COOKIE_LIFETIME)
        content = _INPUT.pack(nonce, self._sessions & 0xFFFFFFFF, era) + peer
        digest = hashlib.blake2s(content, key=self._secret, digest_size=8).digest()
        return int.from_bytes(digest, "little") or 1
