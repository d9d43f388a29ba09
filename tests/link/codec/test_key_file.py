"""A key is private, or it is none."""

from __future__ import annotations

import hashlib
import os

import pytest

from omnimj.errors import InputError
from omnimj.link.codec.key import Key, SessionKeys, read_key
from omnimj.link.codec.layout import DropReason

pytestmark = pytest.mark.skipif(os.name != "posix", reason="file modes are of POSIX")
DIGITS = "0123456789abcdefABCDEF" + hashlib.blake2s(b"digits").hexdigest()[:42]


@pytest.fixture
def written(tmp_path):
    def write(text: str, mode: int = 0o600):
        path = tmp_path / "key"
        path.write_text(text)
        path.chmod(mode)
        return path

    return write


@pytest.mark.parametrize("mode", [0o600, 0o400])
@pytest.mark.parametrize("end", ["", "\n", "\r\n"])
def test_a_private_file_of_64_digits_is_a_key(written, mode, end):
    key = read_key(written(DIGITS + end, mode))
    expected = hashlib.blake2s(b"content", key=bytes.fromhex(DIGITS), digest_size=16).digest()
    assert key.tag(b"content") == expected == key.tag(b"content")
    assert key.verify(b"content", expected) is None
    assert key.verify(b"Content", expected) is DropReason.TAG
    assert DIGITS.lower() not in repr(key).lower()


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o660, 0o606, 0o700, 0o601, 0o4600])
def test_a_file_that_others_may_touch_is_refused(written, mode):
    with pytest.raises(InputError, match="0600"):
        read_key(written(DIGITS, mode))


@pytest.mark.parametrize(
    "text", ["", DIGITS[:-1], DIGITS + "0", DIGITS[:-1] + "g", DIGITS[:-2] + " 1", "é" * 32, DIGITS * 5]
)
def test_anything_else_is_no_key_and_its_content_is_not_printed(written, text):
    with pytest.raises(InputError) as caught:
        read_key(written(text))
    assert "64 hexadecimal digits" in str(caught.value)
    assert not text or text not in str(caught.value)


def test_what_is_no_plain_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe", 0o600)
    for path in (tmp_path / "none", tmp_path, tmp_path / "pipe"):
        with pytest.raises(InputError, match="key file is needed"):
            read_key(path)


@pytest.mark.parametrize(
    "secret",
    [
        bytes(32),
        b"\xff" * 32,
        bytes(range(32)),
        bytes(range(0, 256, 8)),
        b"password" * 4,
        b"0123456789abcdef" * 2,
    ],
)
def test_a_key_that_is_zero_repeats_or_counts_is_refused_in_one_line(written, secret):
    for make in (lambda: Key(secret), lambda: read_key(written(secret.hex()))):
        with pytest.raises(InputError, match="too regular to be random") as caught:
            make()
        assert len(str(caught.value).splitlines()) == 1 and secret.hex() not in str(caught.value)


def test_a_session_has_a_key_of_its_own_that_depends_on_device_and_nonces():
    link, connection = Key(bytes.fromhex(DIGITS)), bytes(24)
    connections = [connection, *(connection[:i] + b"\1" + connection[i + 1 :] for i in range(24))]
    tags = {link.session_key(one).tag(b"content") for one in connections} | {link.tag(b"content")}
    assert len(tags) == 26


def test_frames_without_a_session_have_the_key_of_the_link_and_all_others_that_of_the_session():
    link = Key(bytes.fromhex(DIGITS))
    now = [b"a" * 24]
    keys = SessionKeys(link, lambda: now[0])
    outside, inside = bytes(40), b"\2\4\1\0\7" + bytes(35)
    assert keys.tag(outside) == link.tag(outside)
    first = keys.tag(inside)
    assert first == link.session_key(now[0]).tag(inside) and keys.verify(inside, first) is None
    now[0] = b"b" * 24
    assert keys.verify(inside, first) is DropReason.TAG and keys.verify(outside, link.tag(outside)) is None


def test_a_key_has_32_bytes():
    with pytest.raises(InputError, match="31 bytes"):
        Key(bytes(31))
