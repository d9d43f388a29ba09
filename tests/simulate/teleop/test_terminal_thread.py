"""A terminal that keeps its reader waiting keeps no robot waiting."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Callable

import pytest

from omnimj.simulate.teleop import devices as room
from omnimj.simulate.teleop.devices import Terminal

pytest.importorskip("termios")
SLOW = 0.3  # [s]


@pytest.fixture
def screen():
    far, near = os.openpty()
    yield far, near
    for end in (far, near):
        with contextlib.suppress(OSError):  # a test has closed it
            os.close(end)


def comes(holds: Callable[[], bool]) -> bool:
    until = time.monotonic() + 10.0
    while not holds():
        if time.monotonic() > until:
            return False
        time.sleep(0.002)
    return True


def test_a_slow_terminal_delays_no_control_step(screen, monkeypatch):
    """As on a busy machine: every question and every write takes 0.3 s of no computing."""
    far, near = screen
    ask, write = room.select.select, os.write

    def slow_ask(*arguments):
        time.sleep(SLOW)
        return ask(*arguments)

    def slow_write(to, content):
        time.sleep(SLOW if to == near else 0.0)
        return write(to, content)

    with Terminal(near, near) as terminal:
        monkeypatch.setattr(room.select, "select", slow_ask)
        monkeypatch.setattr(os, "write", slow_write)
        took, typed = 0.0, b""
        write(far, b"w")
        until = time.monotonic() + 10.0
        while typed != b"w" and time.monotonic() < until:
            begin = time.monotonic()
            typed += terminal.read() or b""
            terminal.show("x")
            took = max(took, time.monotonic() - begin)
            time.sleep(0.002)
        monkeypatch.undo()
    assert typed == b"w" and took < SLOW / 2.0


def test_keys_come_in_their_order_and_those_typed_before_the_start_are_discarded(screen):
    far, near = screen
    with Terminal(near, near) as terminal:
        os.write(far, b"www")
        assert comes(lambda: bool(room.select.select([near], [], [], 0.0)[0]))
        terminal.drain()
        assert terminal.read() == b""
        typed = b""
        for key in (b"a", b"\x1b[A", b"q"):
            os.write(far, key)

        def all_there() -> bool:
            nonlocal typed
            typed += terminal.read() or b""
            return typed == b"a\x1b[Aq"

        assert comes(all_there)
        terminal.show("+0.30 m/s")
        shown = b""

        def is_shown() -> bool:
            nonlocal shown
            shown += os.read(far, 4096)
            return b"+0.30 m/s" in shown

        assert comes(is_shown)
    assert not any(thread.name == "terminal" for thread in threading.enumerate())


def test_the_end_of_a_terminal_is_reported_after_its_last_keys(screen):
    far, near = screen
    with Terminal(near, near) as terminal:
        assert terminal.read() == b""
        os.close(far)
        assert comes(lambda: terminal.read() is None)
        assert terminal.read() is None
        terminal.show("nobody sees it")
