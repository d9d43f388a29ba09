"""The hardware for ros2_control compiles against ROS 2's interfaces and drives the emulated device over UDP.

ROS 2 itself is not needed: `stubs` has the parts of its headers that the example uses.
"""

from __future__ import annotations

import contextlib
import re
import shutil
import subprocess
import xml.etree.ElementTree
from pathlib import Path

import numpy as np
import pytest
from key_files import make_key_file
from wired_devices import WIRING, planar, served

import omnimj
import omnimj.link
from omnimj.errors import LinkLost
from omnimj.link.calibration import canonical_text
from omnimj.link.codec.key import read_key
from omnimj.link.codec.messages import FaultCode, Status
from omnimj.link.host.link import open_link
from omnimj.parameters import read_robot
from omnimj.signals import CurrentCommand

HERE = Path(__file__).parent
PACKAGE = Path(omnimj.__file__).parent / "docs" / "ros2_control"
FIRMWARE = Path(omnimj.link.__file__).parent / "firmware"
COMPILER = shutil.which("g++") or shutil.which("clang++") or ""
STRICT = ("-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O0")
BUSY = re.compile(r"older than 20 ms|acknowledged for 40 ms|fault (1|19)\b")
"""Ends of a drive that a scheduler may cause: late telemetry, late acknowledgement, old or stale commands."""
EFFORT = 0.2  # [Nm], 0.4 A by the torque constant of the driver

pytestmark = pytest.mark.skipif(not COMPILER, reason="no C++ compiler here")


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The package, and a program that does with it what a controller manager does."""
    out = tmp_path_factory.mktemp("ros2_control") / "drive"
    places = [f"-I{place}" for place in (PACKAGE / "include", FIRMWARE, HERE / "stubs")]
    sources = [*sorted((PACKAGE / "src").glob("*.cpp")), HERE / "drive.cpp"]
    done = subprocess.run(
        [COMPILER, *STRICT, *places, *map(str, sources), "-o", str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture
def calibration(tmp_path):
    path = tmp_path / "calibration.txt"
    path.write_bytes(canonical_text(WIRING).encode("ascii"))
    return path


def driven(program, address: str, calibration: Path, key: Path | str = "", cycles=200, *more: str):
    """Exit code, states by name, and complaint of a drive."""
    port = address.rpartition(":")[2]
    argv = [str(program), port, str(calibration), str(key), str(EFFORT), str(cycles), *more]
    done = subprocess.run(argv, capture_output=True, text=True, check=False, timeout=60)
    states = dict(line.split() for line in done.stdout.splitlines())
    return done.returncode, {name: float(value) for name, value in states.items()}, done.stderr


@pytest.mark.slow
def test_the_package_compiles_without_a_warning(program):
    assert program.is_file()


def test_its_files_name_each_other():
    plugin = xml.etree.ElementTree.parse(PACKAGE / "omnimj_ros2_control.xml").getroot()
    kind = plugin[0].attrib["type"]
    assert f"PLUGINLIB_EXPORT_CLASS({kind}, " in (PACKAGE / "src" / "system.cpp").read_text()
    urdf = (PACKAGE / "urdf" / "robot.ros2_control.xacro").read_text()
    assert f"<plugin>{plugin[0].attrib['name']}</plugin>" in urdf
    xml.etree.ElementTree.fromstring(urdf)
    cmake = (PACKAGE / "CMakeLists.txt").read_text()
    name = xml.etree.ElementTree.parse(PACKAGE / "package.xml").getroot().findtext("name")
    assert f"project({name} CXX)" in cmake and plugin.attrib["path"] == name
    assert set(re.findall(r"src/\w+\.cpp", cmake)) == {f"src/{p.name}" for p in (PACKAGE / "src").iterdir()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("omnimj calibration 1", "other", "does not begin with 'omnimj calibration 1'"),
        ("output 2", "output 7", "an output is not whole, or out of order"),
        ("input current_1 current", "input current_1 smell", "unknown quantity 'smell'"),
        ("input current_1 current volts 0", "input current_1 current volts 77", "an input is not whole"),
    ],
)
def test_a_wrong_calibration_is_refused_before_anything_is_sent(program, tmp_path, old, new, words):
    text = canonical_text(WIRING)
    assert old in text
    path = tmp_path / "wrong.txt"
    path.write_text(text.replace(old, new, 1))
    code, _, complaint = driven(program, "udp:127.0.0.1:9", path)
    assert code == 3 and words in complaint and complaint.count("\n") == 1


def warm(plant):
    """The plant with its native code compiled, which would make the first telemetry late."""
    plant.reset()
    plant.step(CurrentCommand(np.zeros(4)))
    return plant


def telemetry_of(address: str):
    """The newest telemetry, for another host; a device that is still armed has it wait."""
    for _ in range(20):
        link = open_link(address, read_robot())
        try:
            link.connect()
            return link.reading.telemetry
        except LinkLost as error:
            assert "another host has the armed device" in str(error)
            link.listen(link.now + 0.05, lambda: False)
        finally:
            link.close()
    raise AssertionError("the device remains armed")


@contextlib.contextmanager
def undisturbed(program, calibration, key: Path | None = None, *more: str):
    """A device after a drive, and its last states; a drive that a busy machine has ended is repeated."""
    secret = None if key is None else read_key(key)
    for _ in range(6):
        with served(warm(planar()), "udp", lock_step=False, key=secret) as address:
            code, states, complaint = driven(program, address, calibration, key or "", 200, *more)
            if code == 5 and BUSY.search(complaint):
                continue
            assert (code, complaint) == (0, "")
            yield address, states
            return
    raise AssertionError("the machine is too busy for real time")


@pytest.mark.slow
def test_the_wheels_turn_while_active_and_a_stop_ends_it(program, calibration):
    with undisturbed(program, calibration) as (address, states):
        for k in (1, 2, 3, 4):
            assert states[f"wheel_{k}/velocity"] > 0.5 and states[f"wheel_{k}/position"] > 0.05
            assert states[f"wheel_{k}/effort"] == pytest.approx(EFFORT, rel=0.2)
        seen = telemetry_of(address)
        assert not seen.status & (Status.ARMED | Status.CURRENT_FLOWS)
        assert seen.status & Status.STOPPED and seen.fault is FaultCode.NONE
        # the next activation resets the stop
        ends = (driven(program, address, calibration, "", 0) for _ in range(6))
        assert any(code == 0 for code, _, complaint in ends if code == 0 or BUSY.search(complaint))


@pytest.mark.slow
def test_a_program_that_dies_leaves_a_latched_fault_that_no_activation_resets(program, calibration):
    with undisturbed(program, calibration, None, "kill") as (address, _):
        seen = telemetry_of(address)
        assert not seen.status & (Status.ARMED | Status.CURRENT_FLOWS)
        assert seen.fault is FaultCode.COMMAND_TOO_OLD
        code, _, complaint = driven(program, address, calibration)
        assert code == 4 and "look for its cause" in complaint


@pytest.mark.slow
def test_a_device_of_another_calibration_is_not_driven(program, calibration):
    text = calibration.read_text()
    calibration.write_text(text.replace("output 1 0 1", "output 1 0 -1"))
    with served(planar(), "udp", lock_step=False) as address:
        code, _, complaint = driven(program, address, calibration)
    assert code == 3 and "it was commissioned with another one" in complaint


@pytest.mark.slow
def test_with_a_key_every_frame_has_a_tag_and_without_it_the_device_is_silent(program, calibration, tmp_path):
    make_key_file(tmp_path / "key")
    with undisturbed(program, calibration, tmp_path / "key") as (address, states):
        assert states["wheel_3/velocity"] > 0.5
        code, _, complaint = driven(program, address, calibration)
    assert code == 3 and "the device does not answer" in complaint


@pytest.mark.slow
def test_no_device_and_a_key_that_others_may_read_are_one_line(program, calibration, tmp_path):
    code, _, complaint = driven(program, "udp:127.0.0.1:9", calibration)
    assert code == 3 and "the device does not answer" in complaint and complaint.count("\n") == 1
    make_key_file(tmp_path / "key")
    (tmp_path / "key").chmod(0o644)
    code, _, complaint = driven(program, "udp:127.0.0.1:9", calibration, tmp_path / "key")
    assert code == 3 and "others may read it; set its mode to 0600" in complaint
