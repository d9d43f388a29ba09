"""The tables [hardware] of a robot's model file: the shipped ones, and one clear line for each mistake."""

import math
import re
from typing import Any

import pytest

from omnimj.errors import InputError
from omnimj.parameters import read_robot
from omnimj.resources import models_folder

SHIPPED = (models_folder() / "uto_robot" / "robot.toml").read_text(encoding="utf-8")
FIRST = SHIPPED.index("# How the robot is wired")


def read(folder, text) -> Any:
    path = folder / "robot.toml"
    path.write_text(text, encoding="utf-8")
    return read_robot(path)


def changed(old, new, count=1):
    """The shipped file with one change inside [hardware]."""
    wiring = SHIPPED[FIRST:]
    assert old in wiring
    return SHIPPED[:FIRST] + wiring.replace(old, new, count)


def test_the_shipped_robot_is_wired_to_monitors_of_ten_volts_over_their_ranges():
    robot: Any = read_robot()
    wiring, sensors = robot.hardware, robot.sensors
    gains = {i.name: i.gain for i in wiring.inputs}
    for wheel in range(1, 5):
        assert gains[f"current_{wheel}"] == sensors.current_monitor_range / 10.0
        speed = sensors.speed_monitor_range / robot.motor.gear_ratio / 10.0
        assert gains[f"wheel_speed_{wheel}"] == pytest.approx(speed, rel=1e-15)
    assert gains["acceleration_x"] == gains["acceleration_y"]
    assert gains["yaw_rate"] == pytest.approx(sensors.gyro_range / 10.0, rel=1e-15)
    assert gains["acceleration_x"] == pytest.approx(sensors.accelerometer_range / 10.0, rel=1e-15)
    assert gains["yaw"] == 2.0 * math.pi / 10.0
    assert {o.unit for o in wiring.outputs} == {"V/A"}
    assert all(o.gain * sensors.current_monitor_range == 10.0 for o in wiring.outputs)
    assert [i.channel for i in wiring.inputs] == list(range(12))
    assert {p.source for p in wiring.provenance.values()} == {"chosen", "text"}


def test_the_device_lets_through_what_the_controller_may_want():
    robot: Any = read_robot()
    limits, control = robot.hardware.limits, robot.control
    assert limits.current >= control.current_limit
    assert limits.current_rate >= control.current_rate_limit
    assert limits.wheel_speed > control.wheel_speed_limit
    # and the speed monitors can resolve
    assert limits.wheel_speed < robot.sensors.speed_monitor_range / robot.motor.gear_ratio
    assert limits.message_rate >= 2.0 * robot.sensors.sample_rate


def test_a_model_file_may_be_without_hardware(tmp_path):
    assert read(tmp_path, SHIPPED[:FIRST]).hardware is None


def test_entries_left_out_have_their_plain_defaults(tmp_path):
    wired = read(tmp_path, SHIPPED).hardware
    assert {(i.sign, i.offset, i.filter, i.wrap, i.raw) for i in wired.inputs} == {
        (1, 0.0, 0.0, 0.0, "volts")
    }
    assert [i.quantity for i in wired.inputs[:5]] == ["current"] * 4 + ["wheel_speed"]
    assert [i.wheel for i in wired.inputs] == [1, 2, 3, 4, 1, 2, 3, 4, 0, 0, 0, 0]


def test_every_optional_entry_of_the_hardware_tables_is_read(tmp_path):
    where = SHIPPED.index('name = "wheel_speed_2"')
    old = SHIPPED[where : SHIPPED.index(', source = "chosen"', where)]
    new = """name = "wheel_speed_2"
quantity = "wheel_angle"
raw = "counts"
channel = 15
sign = -1
wrap = { value = 65536, unit = "count", source = "datasheet" }
offset = { value = 3.0, unit = "count", source = "measured" }
filter = { value = 0.004, unit = "s", source = "chosen" }
gain = { value = 0.001, unit = "rad/count\""""
    text = changed(old, new)
    found = read(tmp_path, text).hardware.inputs[5]
    facts = (found.name, found.quantity, found.wheel, found.raw, found.channel, found.sign)
    assert facts == ("wheel_speed_2", "wheel_angle", 2, "counts", 15, -1)
    assert (found.gain, found.offset, found.filter, found.wrap) == (0.001, 3.0, 0.004, 65536.0)
    without = text.replace('wrap = { value = 65536, unit = "count", source = "datasheet" }\n', "")
    assert read(tmp_path, without).hardware.inputs[5].wrap == 2.0**32


MISTAKES = {
    "unknown key": ("channel = 3\n", "channel = 3\ngian = 1\n", "unknown key 'gian'"),
    "unknown table": ("[hardware.limits]", "[hardware.limit]", "unknown key 'limit'"),
    "unknown name": ('"current_3"', '"current_5"', "unknown name 'current_5'"),
    "name twice": ('"current_3"', '"current_2"', "name 'current_2' occurs twice"),
    "channel twice": ("channel = 7\n", "channel = 6\n", "channel 6 occurs twice"),
    "channel too high": ("channel = 11\n", "channel = 16\n", "at most 15"),
    "channel not whole": ("channel = 11\n", "channel = 1.5\n", "must be a whole number"),
    "channel missing": ("channel = 11\n", "", "'channel' is missing"),
    "sign 0": ("channel = 3\n", "channel = 3\nsign = 0\n", "found 0; must be 1 or -1"),
    "sign 2": ("channel = 3\n", "channel = 3\nsign = 2\n", "found 2; must be 1 or -1"),
    "sign true": ("channel = 3\n", "channel = 3\nsign = true\n", "found True; must be 1 or -1"),
    "gain 0": ("value = 9.81", "value = 0.0", "must be above 0"),
    "gain below 0": ("value = 9.81", "value = -9.81", "must be above 0"),
    "gain without unit": ('value = 9.81, unit = "m/s2/V"', "value = 9.81", "'unit' is missing"),
    "gain in another unit": ("m/s2/V", "m/s2/count", "the unit is 'm/s2/V'"),
    "raw unknown": ('raw = "volts"', 'raw = "bits"', "unknown raw 'bits'"),
    "raw no text": ('raw = "volts"', "raw = 3", "unknown raw 3"),
    "quantity of another": (
        'name = "yaw"\n',
        'name = "yaw"\nquantity = "yaw_rate"\n',
        "unknown quantity 'yaw_rate'",
    ),
    "wrap without angle": (
        'name = "yaw"\n',
        'name = "yaw"\nwrap = { value = 10.0, unit = "V", source = "chosen" }\n',
        "belongs to wheel_angle",
    ),
    "filter below 0": (
        'name = "yaw"\n',
        'name = "yaw"\nfilter = { value = -1.0, unit = "s", source = "chosen" }\n',
        "must be at least 0",
    ),
    "wheel twice": ("wheel = 3\n", "wheel = 2\n", "wheel 2 occurs twice"),
    "wheel too high": ("wheel = 3\n", "wheel = 5\n", "at most 4"),
    "output gain 0": ("value = 2.0, ", "value = 0.0, ", "must be above 0"),
    "output unit": ('"V/A"', '"V"', "unknown unit 'V'"),
    "units mixed": ('"V/A"', '"A/A"', "all must have the same unit"),
    "limit 0": ("value = 4000.0", "value = 0.0", "must be above 0"),
    "valid-for too long": ("value = 0.2,", "value = 0.3,", "at most 0.2"),
    "limit missing": ("heating =", "warming =", "unknown key 'warming'"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_each_mistake_is_refused_in_one_line(tmp_path, mistake):
    old, new, expected = MISTAKES[mistake]
    with pytest.raises(InputError, match=re.escape(expected)) as error:
        read(tmp_path, changed(old, new))
    assert str(error.value).startswith(f"{tmp_path / 'robot.toml'}: ")
    assert "hardware" in str(error.value)
    assert "\n" not in str(error.value)


def without(name, kind="inputs"):
    blocks = re.split(r"(?=\[\[hardware\.)", SHIPPED)
    return "".join(b for b in blocks if not (b.startswith(f"[[hardware.{kind}]]") and name in b))


def test_channels_and_wheels_that_are_missing_are_named(tmp_path):
    with pytest.raises(InputError, match="name 'yaw_rate' is missing"):
        read(tmp_path, without('"yaw_rate"'))
    with pytest.raises(InputError, match="wheel 2 is missing"):
        read(tmp_path, without("wheel = 2", "outputs"))


def test_currents_on_a_wire_fill_their_places(tmp_path):
    text = changed('"V/A"', '"A/A"', 99)
    assert {o.unit for o in read(tmp_path, text).hardware.outputs} == {"A/A"}
    where = text.index("wheel = 4\nchannel = 3")
    with pytest.raises(InputError, match=r"channel 3 is missing"):
        read(tmp_path, text[:where] + text[where:].replace("channel = 3", "channel = 4", 1))


@pytest.mark.parametrize("tables", ["hardware = 3\n", "[hardware]\nlimits = 1\ninputs = 2\noutputs = 3\n"])
def test_tables_of_another_form_are_refused(tmp_path, tables):
    text = tables + SHIPPED[:FIRST] if tables.startswith("hardware") else SHIPPED[:FIRST] + tables
    with pytest.raises(InputError, match="hardware"):
        read(tmp_path, text)


@pytest.mark.parametrize("name", ["inputs", "outputs"])
def test_lists_of_another_form_are_refused(tmp_path, name):
    blocks = re.split(r"(?=\[\[hardware\.)", SHIPPED)
    kept = "".join(b for b in blocks if not b.startswith(f"[[hardware.{name}]]"))
    text = kept.replace("[hardware.limits]", f"[hardware]\n{name} = [1]\n[hardware.limits]")
    with pytest.raises(InputError, match=rf"write tables \[\[hardware\.{name}\]\]"):
        read(tmp_path, text)
