"""The linear axis' model file: what is shipped is sound, what is wrong is named."""

from __future__ import annotations

import pytest

from omnimj.errors import InputError, UnknownNameError
from omnimj.resources import models_folder
from omnimj.simulate.machine.linear_axis import read_axis

SHIPPED = (models_folder() / "linear_axis" / "axis.toml").read_text()


def changed(tmp_path, old, new):
    assert old in SHIPPED
    path = tmp_path / "axis.toml"
    path.write_text(SHIPPED.replace(old, new, 1))
    return path


def test_a_quantity_is_as_uncertain_as_stated():
    widths = {one.name: (one.value, one.half_width) for one in read_axis().uncertain}
    assert widths == {"mass": (95.0, 3.0), "coulomb": (20.0, 3.0), "viscous": (200.0, 20.0)}


def test_friction_may_be_really_missing(tmp_path):
    axis = read_axis(changed(tmp_path, "value = 20.0", "value = 0.0"))
    assert axis.values["joint", "carriage", "frictionloss"] == 0.0


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("value = 95.0", "value = -1.0", "axis.mass"),
        ("value = 40.0", "value = 95.0", "axis.drive_mass"),
        ('unit = "N/A"', 'unit = "N"', "axis.force_constant.unit"),
        ("coulomb =", "columb =", "columb"),
        ("[sensors]", "[sensor]", "sensor"),
        ('plant = "linear_axis"', 'plant = "quarter_rig"', "plant"),
        ("value = 1, unit", "value = 2, unit", "encoder_at_drive"),
    ],
)
def test_a_wrong_entry_is_named_in_one_line(tmp_path, old, new, named):
    path = changed(tmp_path, old, new)
    with pytest.raises((InputError, UnknownNameError), match=named) as caught:
        read_axis(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_table_is_named(tmp_path):
    path = tmp_path / "axis.toml"
    path.write_text('plant = "linear_axis"\n')
    with pytest.raises(InputError, match=r"\[axis\] is missing"):
        read_axis(path)


def test_effects_come_with_the_file(tmp_path):
    table = "\n[effects.stribeck]\n"
    table += 'force = { value = 5.0, unit = "N", source = "identified", low = 4, high = 6 }\n'
    table += 'velocity = { value = 0.02, unit = "m/s", source = "identified" }\n'
    path = tmp_path / "axis.toml"
    path.write_text(SHIPPED + table)
    assert read_axis(path).effects == {"stribeck": {"force": 5.0, "velocity": 0.02}}
