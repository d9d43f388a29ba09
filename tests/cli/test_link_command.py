"""`omnimj link fuzz` and `omnimj device`: what they count, and when they fail."""

from __future__ import annotations

import json
import socket

import pytest

from omnimj.cli import link
from omnimj.cli.main import main
from omnimj.link.check import fuzz as fuzzing
from omnimj.link.device.server import DeviceServer

SHORT = ("link", "fuzz", "--frames", "2000", "--noise", "100000", "--seed", "4")


def test_a_sound_link_exits_with_0_and_every_count_is_given(capsys):
    assert main([*SHORT, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["frames"], found["seed"], found["passed"]) == (2000, 4, True)
    assert found["noise_bytes"] >= 100_000 and found["accepted_wrongly"] == 0
    assert found["accepted"] == found["came_whole"] > 2000 and found["drops"]["checksum"] > 0
    assert main(SHORT) == 0
    printed = capsys.readouterr().out
    assert "accepted wrongly" in printed and f"{found['accepted']:,}" in printed, "one seed gives one run"


def test_a_decoder_that_accepts_anything_exits_with_1(capsys, monkeypatch):
    right = fuzzing.decode
    monkeypatch.setattr(fuzzing, "decode", lambda packet, key=None: right(packet, None))
    assert main(SHORT) == 1
    assert "NO" in capsys.readouterr().out


def test_growing_memory_exits_with_1(capsys, monkeypatch):
    monkeypatch.setattr(link, "_MAX_GROWTH", -1.0)
    assert main([*SHORT, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["passed"] is False


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (("link",), "required: COMMAND"),
        (("link", "fizz"), "unknown command 'fizz'; did you mean 'fuzz'?"),
        (("link", "fuzz", "--frame", "3"), "did you mean '--frames'?"),
        (("link", "fuzz", "--frames", "0"), "at least 1"),
        (("link", "fuzz", "--noise", "1e6"), "whole number"),
    ],
)
def test_impossible_arguments_are_refused_in_one_line(capsys, argv, expected):
    assert main(argv) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and expected in err and err.startswith("omnimj link")


def test_a_device_prints_its_counts_as_json_and_nothing_else(capsys, monkeypatch):
    def interrupted(self, goes_on):
        self.frames = 7
        raise KeyboardInterrupt

    monkeypatch.setattr(DeviceServer, "run", interrupted)
    for clock, names in (("--lock-step", set()), ("--real-time", {"periods", "missed", "skipped"})):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        assert main(["device", "--udp", f"127.0.0.1:{port}", "--plant", "planar", clock, "--json"]) == 130
        printed = capsys.readouterr()
        found = json.loads(printed.out)
        assert (found["frames"], found["dropped"], found["fault"]) == (7, 0, None) and names <= set(found)
        assert "device ready" in printed.err
