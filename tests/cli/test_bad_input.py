"""Bad input of every kind: one clear line on stderr, exit code 2, nothing driven and nothing written."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from omnimj.cli.main import GROUPS, main
from omnimj.resources import models_folder, scenarios_folder

NYLON = (scenarios_folder() / "nylon_patch.toml").read_text(encoding="utf-8")
ON_ROBOT = ("run", "nylon_patch", "--plant", "planar")
ON_RIG = ("run", "rig_lateral", "--plant", "planar")
DEEP = "[" * 100_000
Refused = Callable[..., str]
COMMANDS = sorted(command.name for group in GROUPS.values() for command in group)


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (["--nope"], "required: COMMAND"),
        (
            ["fly"],
            f"unknown command 'fly'; choices: {', '.join(COMMANDS)}",
        ),
        (["run"], "required: scenario"),
        (["run", "nylon_patch", "extra"], "omnimj run: found 'extra', one argument too many"),
        (["run", "nylon_patch", "--sede", "1"], "unknown option '--sede'; did you mean '--seed'?"),
        (["run", "nylon_patch", "--outt=x"], "unknown option '--outt'; did you mean '--out'?"),
        (["scenarios", "nylon_patch"], "omnimj scenarios: found 'nylon_patch'"),
        (["run", ""], "unknown scenario ''; choices: circle_8m"),
        (["run", "."], "unknown scenario '.'"),
        (["run", "nylon_path"], "did you mean 'nylon_patch'?"),
        (["run", "nylon_patch\n"], "unknown scenario 'nylon_patch\\n'"),
        (["run", "x" * 300], "unknown scenario 'xxx"),
        (["run", "nylon_patch.toml"], "nylon_patch.toml: no such scenario file; give the path"),
        (["run", "no/such"], "no/such: no such scenario file"),
        (["run", "../empty"], "../empty: is a folder"),
        (["run", "/" + "y" * 5000 + ".toml"], "File name too long"),
    ],
)
def test_an_unknown_command_or_scenario_is_refused_in_one_line(refused: Refused, argv, expected):
    assert expected in refused(*argv)


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        *(
            (["--seed", seed], f"argument --seed: found '{seed}'")
            for seed in ("x", "-1", "1.5", "", "1_0", "inf")
        ),
        (["--seed", "9" * 5000], "must be a whole number, at least 0"),
        (["--seed", str(2**63)], f"at most {2**63 - 1}"),
        (["--seed"], "expected one argument"),
        (
            ["--plant", ""],
            "--plant: unknown plant ''; choices: planar, serial:DEVICE?baud=N, twin, udp:HOST:PORT",
        ),
        (["--plant", "Twin"], "did you mean 'twin'?"),
        (
            ["--plant", "serial:/dev/no-such-port?baud=1"],
            "cannot be opened, no such file or directory; python",
        ),
        (["--plant", "udp:192.0.2.1:9000"], "a key file is required"),
        (["--method", "best"], "--method: unknown method 'best'; did you mean 'robust'?; choices: off, pub"),
        (["--method", ""], "--method: unknown method ''; choices: off, published, robust"),
        (["--force"], "--force: there is no --out"),
        (["--model", "no_such.toml"], "no_such.toml: no such file"),
        (["--model", "."], ".: is a folder; a TOML file is needed"),
        (["--model", "/dev/null"], "/dev/null: is a pipe or a device; a regular file is needed"),
    ],
)
def test_an_option_out_of_its_range(refused: Refused, argv, expected):
    assert expected in refused(*ON_ROBOT[:2], *argv)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("duration", "--set 'duration': is not KEY=VALUE; e.g. --set faults.0.wheel=3"),
        ("=1", "is not KEY=VALUE"),
        ("a..b=1", "is not KEY=VALUE"),
        ("a=", "--set a: unknown key 'a'; choices: checks, description, diagnosis, drive, duration"),
        ("__class__=1", "unknown key '__class__'"),
        ("floor.x=1", "'floor' is a single value"),
        ("patches.1.floor=oil", "there is no patches.1"),
        ("patches.-1.floor=oil", "'-1' is not an index"),
        ("patches.²=1", "is not an index"),
        ("duration=", "omnimj: --set duration: found ''; a number is needed"),
        ("duration=nan", "found nan; must be at least 0.01 and at most 1800"),
        ("duration=1e9", "found 1000000000.0; must be at least 0.01 and at most 1800"),
        ("duration=true", "found True; a number is needed"),
        ("duration=1979-05-27", "a number is needed"),
        ("duration=0x" + "f" * 5000, "a number is needed"),
        ("duration=" + "9" * 5000, "a number is needed"),
        ("floor=" + DEEP, "unknown floor"),
        ("floor=" + "x" * 100_000, "unknown floor"),
        ("floor=lava", "floor: unknown floor 'lava'; choices: dry_asphalt"),
        ("floor=5", "floor: found 5; must be one line of text"),
        ("level=dream", "level: unknown level 'dream'; choices: kinematic, physics"),
        ("description=", "description: found ''; must be one line of text"),
        ("drive=5", "drive: found 5; a table is needed"),
        ("drive.kind=fly", "unknown drive 'fly'; choices: circle, hold"),
        ("drive.speed=0", "drive.speed: found 0; must be above 0"),
        ("drive.sped=1", "did you mean 'speed'?"),
        ("drive.start=[1]", "two numbers [x, y] are needed"),
        ("drive.yaw_loop=1", "must be true or false"),
        ("faults=5", "write [[faults]]"),
        ("faults=[5]", "faults.0: found 5; a table is needed"),
        ("faults=[{}]", "faults.0: 'kind' is missing; choices: all_wheel_slip"),
        ('faults=[{kind="slip", onset=0, wheel=1, floor="lava"}]', "faults.0.floor: unknown floor 'lava'"),
        (
            'faults=[{kind="slip", onset=0, wheel=5, grip=0.1}]',
            "wheel: found 5; must be at least 1 and at most 4",
        ),
        (
            'faults=[{kind="slip", onset=99, wheel=1, grip=0.1}]',
            "onset: found 99; must be at least 0 and at most 4",
        ),
        ('faults=[{kind="motor", onset=0, wheel=1, loss=1.5}]', "loss: found 1.5"),
        ('faults=[{kind="payload", onset=0, mass=101}]', "mass: found 101"),
        ('faults=[{kind="sensor", onset=0, channel="nose", mode="bias", size=1}]', "unknown channel 'nose'"),
        ("patches.0.floor=lava", "patches.0.floor: unknown floor 'lava'"),
        ("patches.0.size=[0, 1]", "patches.0.size[0]: found 0; must be above 0"),
        ("patches.0.center=[inf, 1]", "patches.0.center[0]: found inf"),
        ("checks.peak_sped=1", "did you mean 'peak_speed'?"),
        ("checks.peak_speed=nan", "checks.peak_speed: found nan"),
        ("checks.peak_speed={}", "give min, max or both"),
        ("plant=quarter_rig", "a scenario belongs to its plant"),
        ("current=1", "unknown key 'current'"),
        ("kinematics.plant=published", "it needs level = 'kinematic'"),
    ],
)
def test_an_impossible_override_is_refused_in_one_line(refused: Refused, text, expected):
    message = refused(*ON_ROBOT, "--set", text)
    assert expected in message and len(message) < 1000


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("current=1.6", "current: found 1.6; must be at least -1.5 and at most 1.5"),
        ("mass=0.35", "mass: found 0.35; must be above 0.35"),
        ("lateral_speed=9", "lateral_speed: found 9; must be at least -0.5 and at most 0.5"),
        ("drive.kind=hold", "unknown key 'drive'"),
        ('faults=[{kind="payload", onset=0, mass=-9}]', "faults.0.mass: found -9; must be above -3.6"),
        ('faults=[{kind="free", onset=0, wheel=2}]', "wheel: found 2"),
        ('faults=[{kind="sensor", onset=0, channel="yaw", mode="freeze"}]', "unknown channel 'yaw'"),
        ("checks.max_yaw_excursion=1", "unknown key 'max_yaw_excursion'; choices: detection_delay"),
    ],
)
def test_an_impossible_override_of_the_rig_is_refused_in_one_line(refused: Refused, text, expected):
    assert expected in refused(*ON_RIG, "--set", text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("kinematics=5", "kinematics: found 5; a table is needed"),
        (
            "kinematics.weights=[1e-320, 1, 1, 1]",
            "kinematics.weights[0]: found 1e-320; must be at least 1e-09",
        ),
        ("kinematics.lost_wheel=0", "must be at least 1 and at most 4"),
        ("kinematics.misalignment=[1, 1, 1, 1]", "at most 0.5"),
        ('faults=[{kind="free", wheel=1, onset=0}]', "no effect at the kinematic level"),
        ("checks.rms_current=1", "unknown metric 'rms_current'"),
    ],
)
def test_an_impossible_override_at_the_kinematic_level_is_refused_in_one_line(
    refused: Refused, text, expected
):
    assert expected in refused("run", "circle_8m_kinematic", "--set", text)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "plant: is missing; a scenario has one; choices: quarter_rig, uto_robot"),
        (b"plant = ", "is not valid TOML"),
        (bytes(range(256)), "is not valid TOML; it is not UTF-8 text, at byte 128"),
        (NYLON.encode("utf-16"), "is not valid TOML"),
        (f"a = {DEEP}".encode(), "nested too deeply"),
        (b"a." * 5000 + b"a = 1", "plant: is missing"),
        (b"plant = 0x" + b"f" * 5000, "a whole number has more than 64 bits"),
        (b"plant = 1" + b"0" * 5000, "is not valid TOML"),
        (NYLON.replace("duration = 4.0", "").encode(), "duration: is missing; a number is needed"),
        (NYLON.replace("duration", "durration", 1).encode(), "'durration'; did you mean 'duration'?"),
        (NYLON.replace("[drive]", "[driv]").encode(), "unknown key of a uto_robot scenario 'driv'"),
        (NYLON.replace("[[patches]]", "[patches]").encode(), "write [[patches]], with two brackets"),
        (NYLON.replace("uto_robot", "submarine").encode(), "unknown plant 'submarine'"),
        (NYLON.replace("uto_robot", "quarter_rig").encode(), "unknown key of a quarter_rig scenario 'drive'"),
        (NYLON[:150].encode(), "mine.toml"),
    ],
)
def test_a_file_that_is_no_scenario_is_refused_in_one_line(refused: Refused, tmp_path, content, expected):
    (tmp_path / "mine.toml").write_bytes(content)
    message = refused("run", str(tmp_path / "mine.toml"), "--plant", "planar")
    assert "mine.toml" in message and expected in message


def test_a_file_that_may_not_be_read_is_refused_in_one_line(refused: Refused, tmp_path, monkeypatch):
    def forbidden(self, *_):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "read_bytes", forbidden)
    assert "nylon_patch.toml: cannot be read (Permission denied)" in refused(*ON_ROBOT)


def test_an_output_folder_that_cannot_be_a_run_is_refused_in_one_line(refused: Refused, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("precious")
    (tmp_path / "taken" / "run.rrd").mkdir(parents=True)
    (tmp_path / "link").symlink_to("nowhere")
    file = str(tmp_path / "full" / "mine.txt")
    for out, force, expected in (
        (tmp_path / "full", (), "is not empty; choose another folder, or --force"),
        (file, (), "is a file; a folder is needed"),
        (file, ("--force",), "is a file; a folder is needed"),
        (f"{file}/below", (), "mine.txt is a file; a folder is needed"),
        (tmp_path / "link", (), "is a link that leads nowhere"),
        (tmp_path / "taken", ("--force",), "has a folder run.rrd"),
        (tmp_path / ("n" * 300), (), "File name too long"),
    ):
        assert expected in refused(*ON_ROBOT, "--out", str(out), *force)
    assert (tmp_path / "full" / "mine.txt").read_text() == "precious"


def test_an_output_folder_without_write_permission_is_refused_in_one_line(
    refused: Refused, tmp_path, monkeypatch
):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    (tmp_path / "shut").mkdir()
    for out in ("shut", "shut/a/run"):
        message = refused(*ON_ROBOT, "--out", str(tmp_path / out), code=1)
        assert f"cannot be written, {tmp_path / 'shut'} is read-only" in message


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (
            ["run", "nylon_patch", "--set", "drive.speed=-3"],
            "omnimj: --set drive.speed: found -3; must be above 0",
        ),
        (
            ["run", "nylon_patch", "--set", "floor=pvvc"],
            "omnimj: --set floor: unknown floor 'pvvc'; did you mean 'pvc'?",
        ),
        (["rn", "nylon_patch"], "omnimj: unknown command 'rn'; did you mean 'run'?"),
        (
            ["sensitivity", "nylon_pach", "--out", "x"],
            "SCENARIO: unknown scenario 'nylon_pach'; did you mean",
        ),
        (
            ["run", "nylon_patch", "--thresholds", "published"],
            "holds thresholds of the published method; those of the robust one are needed",
        ),
        (["run", "circle_8m_kinematic", "--gains", "g.toml"], "is at the kinematic level; it has no cascade"),
        (
            ["record", "rig_currents", "--effect", "rail_viscous:coefficient=1e9", "--out", "x"],
            "--effect rail_viscous.coefficient: found 1000000000.0; must be at least 0",
        ),
    ],
)
def test_the_error_names_the_entry_that_was_wrong(refused, argv, expected):
    published = str(models_folder() / "published_thresholds.toml")
    assert expected in refused(*[published if one == "published" else one for one in argv])


def test_a_run_without_checks_is_not_reported_as_passed_and_shows_its_metrics(capsys):
    argv = ["run", "nylon_patch", "--plant", "planar", "--method", "off"]
    assert main([*argv, "--set", "duration=0.3", "--set", "checks={}"]) == 0
    out = capsys.readouterr().out
    assert "passed" not in out and out.splitlines()[-1] == "not judged: there is nothing to check"
    assert "tracking_error_max" in out and "with duration=0.3, checks={}" in out
