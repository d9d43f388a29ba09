"""`omnimj link check` against emulated devices."""

from __future__ import annotations

import io
import json

import pytest
from wired_devices import planar, served

from omnimj.cli.main import main
from omnimj.link.check.motions import MotionSequence
from omnimj.link.check.wiring import WiringFinding
from omnimj.link.device.emulated import WiringDefect

LOCK_STEP = ("--lock-step", "--on-floor", "--yes", "--json")


def checked(capsys, address, *options):
    code = main(["link", "check", "--plant", address, *options])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_a_robot_that_is_wired_well_passes_over_a_real_wire(capsys):
    with served(planar(), "udp") as address:
        code, found = checked(capsys, address, *LOCK_STEP)
    assert code == 0 and found["passed"] and found["wiring"] == []


def test_what_the_motions_show_is_reported_by_name_and_fails_the_check(capsys, monkeypatch):
    found = [WiringFinding("motor_4", "sign", "motor 4 is inverted")]
    monkeypatch.setattr(MotionSequence, "_record", lambda *_: None)
    monkeypatch.setattr("omnimj.link.check.wiring.judge_wiring", lambda *_: found)
    with served(planar(), "udp") as address:
        code, told = checked(capsys, address, *LOCK_STEP)
    assert code == 1 and not told["passed"]
    assert told["wiring"] == [{"place": "motor_4", "kind": "sign", "words": "motor 4 is inverted"}]
    assert {"step": "motor_4", "found": "motor 4 is inverted", "ok": False} in told["steps"]


@pytest.mark.slow
def test_wrong_signs_are_reported_by_name_and_the_check_fails(capsys):
    defects = [WiringDefect("sign", "wheel_speed_2"), WiringDefect("sign", "motor_4")]
    with served(planar(), "udp", defects=defects) as address:
        code, found = checked(capsys, address, *LOCK_STEP)
    assert code == 1 and not found["passed"]
    assert {(f["place"], f["kind"]) for f in found["wiring"]} == {
        ("wheel_speed_2", "sign"),
        ("motor_4", "sign"),
    }


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["--plant", "twin", "--yes"], "--plant: found 'twin'; must be serial:DEVICE"),
        (["--plant", "udp:127.0.0.1:9"], "there is no terminal for questions"),
        (["--plant", "udp:127.0.0.1:9", "--yes", "--current", "-1"], "found '-1'; must be above 0"),
        (["--plant", "udp:127.0.0.1", "--yes"], "--plant"),
    ],
)
def test_what_cannot_be_checked_is_refused_in_one_line(argv, words, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert _code(["link", "check", *argv]) == 2
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert words in line


def _code(argv):
    try:
        return main(argv)
    except SystemExit as ended:
        return ended.code


@pytest.mark.slow
def test_a_device_that_does_not_answer_ends_the_check_with_its_own_code(capsys):
    code, found = checked(capsys, "udp:127.0.0.1:9", "--yes", "--on-floor", "--json")
    assert code == 3
    assert "does not answer" in found["steps"][-1]["found"] and found["steps"][-1]["ok"] is False
