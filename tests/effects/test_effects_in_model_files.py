"""Model files with effects: written, read, and refused in one line where they are wrong."""

import dataclasses
import re
import tomllib
from pathlib import Path

import pytest
from driven_plants import RIG, ROBOT
from hypothesis import given
from hypothesis import strategies as st

from omnimj.effects import Interval, check_effects, effects_of, with_effects
from omnimj.effects.model_writer import format_model
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_floors, read_rig, read_robot
from omnimj.resources import models_folder

RIG_FILE = models_folder() / "quarter_rig" / "rig.toml"
ROBOT_FILE = models_folder() / "uto_robot" / "robot.toml"
READERS = {RIG_FILE: read_rig, ROBOT_FILE: read_robot}
PLANTS = [(RIG_FILE, RIG), (ROBOT_FILE, ROBOT)]


def write_model(path: Path, file: Path, effects, changed=None) -> None:
    path.write_text(format_model(file, effects, changed), encoding="utf-8")


def read_again(folder: Path, file: Path, effects, changed=None):
    path = folder / "mine.toml"
    write_model(path, file, effects, changed)
    machine = READERS[file](path)
    check_effects(machine)
    return machine


@pytest.mark.slow
@pytest.mark.parametrize(("file", "machine"), PLANTS)
def test_every_effect_is_read_as_it_was_written(tmp_path, file, machine):
    plant = "quarter_rig" if machine is RIG else "uto_robot"
    for name, effect in effects_of(plant).items():
        chosen = {s.name: s.on(machine.wheel_count)[-1] for s in effect.selectors if s.choices}
        values = {p.name: p.typical for p in effect.parameters}
        fitted = {key: Interval(value, value - 0.1, value + 0.1) for key, value in values.items()}
        read = read_again(tmp_path, file, {name: {**fitted, **chosen}})
        assert read.effects == {name: {**chosen, **values}}
        assert read.provenance[f"effects.{name}.{effect.parameters[0].name}"].source == "identified"
        again = dataclasses.replace(read, effects={}, provenance=machine.provenance, file=machine.file)
        assert repr(again) == repr(machine)  # nothing else has changed


def test_changed_values_are_replaced_and_the_rest_of_the_text_stays(tmp_path):
    changed = {"rig.rail_friction": 0.35, "motor.torque_constant": 0.041, "rig.masses": [3.9, 2.9]}
    text = format_model(RIG_FILE, {"grade": {"slope": 0.01}}, changed)
    own = RIG_FILE.read_text(encoding="utf-8").splitlines()
    kept = [line for line in own if line in text.splitlines()]
    assert len(kept) == len(own) - 2  # rail_friction and masses; the motor is the parts' file's
    read = read_again(tmp_path, RIG_FILE, {"grade": {"slope": 0.01}}, changed)
    assert (read.rig.rail_friction, read.motor.torque_constant) == (0.35, 0.041)
    assert read.rig.masses == (3.9, 2.9) and read.motor.resistance == RIG.motor.resistance
    for name in changed:
        assert read.provenance[name].source == "identified"
        assert read.provenance[name].uncertainty == RIG.provenance[name].uncertainty


def test_a_written_file_can_be_the_start_of_the_next(tmp_path):
    first = tmp_path / "first.toml"
    write_model(first, RIG_FILE, {"grade": {"slope": 0.01}, "payload": {"mass": 0.2}}, {"motor.supply": 23.0})
    second = tmp_path / "second.toml"
    write_model(second, first, {"grade": {"slope": 0.03}}, {"motor.supply": 22.0, "motor.viscous": 4e-6})
    read = read_rig(second)
    assert read.effects == {"payload": {"mass": 0.2}, "grade": {"slope": 0.03}}
    assert (read.motor.supply, read.motor.viscous) == (22.0, 4e-6)
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["first.toml", "second.toml"]


def test_parts_beside_the_original_are_found_from_another_folder(tmp_path):
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    parts = (models_folder() / "parts.toml").read_text(encoding="utf-8")
    (here / "parts.toml").write_text(parts.replace("value = 24.0", "value = 20.0"), encoding="utf-8")
    (here / "rig.toml").write_text(RIG_FILE.read_text(encoding="utf-8"), encoding="utf-8")
    write_model(there / "mine.toml", here / "rig.toml", {"grade": {"slope": 0.01}})
    assert read_rig(there / "mine.toml").motor.supply == 20.0


def test_what_cannot_be_written_is_refused():
    with pytest.raises(UnknownNameError, match="effect of quarter_rig 'roller_friction'"):
        format_model(RIG_FILE, {"roller_friction": {"roller_dry": 0.1}})
    with pytest.raises(
        UnknownNameError, match=r"quantity 'motor\.torque'; did you mean.*motor\.torque_constant"
    ):
        format_model(RIG_FILE, {}, {"motor.torque": 1.0})
    with pytest.raises(InputError, match=r"at most 0\.3 rad"):
        format_model(RIG_FILE, {"grade": {"slope": 9.0}})


def test_a_file_of_any_layout_can_be_changed_and_keeps_its_comments(tmp_path):
    own = RIG_FILE.read_text(encoding="utf-8")
    dotted = re.sub(r"(?m)^(\w+) = \{", r"rig.\1 = {", own.replace("[rig]\n", ""))
    spread = (
        own
        + "\n[effects.grade] # measured\nslope.value = 0.01\nslope.unit = 'rad'\nslope.source = 'chosen'\n"
    )
    for name, text in (("dotted", dotted), ("spread", spread), ("crlf", own.replace("\n", "\r\n"))):
        file, written = tmp_path / f"{name}.toml", tmp_path / f"{name}_changed.toml"
        file.write_bytes(text.encode("utf-8"))
        write_model(written, file, {"payload": {"mass": 0.2}}, {"rig.rail_friction": 0.35})
        read = read_rig(written)
        assert read.rig == dataclasses.replace(RIG.rig, rail_friction=0.35)
        assert read.effects["payload"] == {"mass": 0.2} and ("grade" in read.effects) == (name == "spread")
        comments = re.findall("#[^\r\n]*", text)
        assert set(comments) <= set(re.findall("#[^\r\n]*", written.read_text(encoding="utf-8")))


GOOD = '[effects.rail_viscous]\ncoefficient = { value = 2.0, unit = "N.s/m", source = "identified" }\n'


@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        ("effects = 3", "effects: found 3"),
        ("[effects]\ngrade = 3", "effects.grade: found 3"),
        (GOOD.replace("rail_viscous", "rail_viscos"), "did you mean 'rail_viscous'"),
        (GOOD.replace("coefficient", "force"), "choices: coefficient"),
        (GOOD.replace("N.s/m", "N"), "the unit is 'N.s/m'"),
        (GOOD.replace("2.0", "-2.0"), "must be at least 0 and at most 20"),
        (GOOD.replace("2.0", "nan"), "must be finite"),
        (GOOD.replace("2.0", "'2'"), "a number is needed"),
        (GOOD.replace("identified", "guessed"), "unknown source 'guessed'"),
        (GOOD.replace(" }", ", low = 3.0, high = 4.0 }"), "must lie between its low 3 and high 4"),
        (GOOD.replace(" }", ", lower = 3.0 }"), "unknown key 'lower'"),
        (GOOD.replace(" }", ", uncertainty = -1.0 }"), "uncertainty: found -1.0"),
        ("[effects.rail_viscous]\ncoefficient = 2", "write { value"),
        ("[effects.rail_viscous]\ncoefficient = 2.0", "write { value"),
        ("[effects.rail_viscous]", "give at least one of its amplitudes"),
        (
            '[effects.sensor_delay]\ndelay = { value = 0.01, unit = "s", source = "chosen" }',
            "'channel' is missing",
        ),
    ],
)
def test_a_wrong_table_is_explained_in_one_line_that_names_the_file(tmp_path, lines, complaint):
    path = tmp_path / "mine.toml"
    before = f"{lines}\n" if lines.startswith("effects") else ""
    after = "" if before else f"\n{lines}\n"
    path.write_text(before + RIG_FILE.read_text(encoding="utf-8") + after, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(complaint)) as caught:
        check_effects(read_rig(path))
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


VALUES = st.one_of(
    st.floats().map(repr),
    st.integers().map(str),
    st.sampled_from(["true", "[]", "{}", "''", "1979-05-27", "[1.0]", "{ value = 1.0 }", "0x10"]),
)


@given(name=st.sampled_from(["rail_viscous", "grade", "floor_patch", "nothing", "payload_2"]), value=VALUES)
def test_any_effect_table_is_read_or_refused(tmp_path_factory, name, value):
    path = tmp_path_factory.mktemp("models") / "mine.toml"
    parameter = {"grade": "slope", "floor_patch": "scale", "payload_2": "mass"}.get(name, "coefficient")
    unit = {"grade": "rad", "floor_patch": "1", "payload_2": "kg"}.get(name, "N.s/m")
    table = f'[effects.{name}]\n{parameter} = {{ value = {value}, unit = "{unit}", source = "chosen" }}\n'
    path.write_text(RIG_FILE.read_text(encoding="utf-8") + "\n" + table, encoding="utf-8")
    try:
        rig = read_rig(path)
        check_effects(rig)
    except InputError as error:
        assert str(error).startswith(str(path)) and "\n" not in str(error)
        return
    assert with_effects(RIG, rig.effects).effects[name][parameter] == float(
        tomllib.loads(f"v = {value}")["v"]
    )


def test_base_quantities_that_are_not_known_exactly_are_marked_as_such():
    stated = {
        "motor.torque_constant": 0.03,
        "motor.no_load_torque": 0.15,
        "motor.rotor_inertia": 0.05,
        "bearing.dry": 0.2,
        "wheel.radius": 0.003,
    }
    of_rig, of_robot = {"rig.rail_friction": 0.1}, {"body.mass": 0.01, "body.yaw_inertia": 0.05}
    for machine, names in ((RIG, {**stated, **of_rig}), (ROBOT, {**stated, **of_robot})):
        for name, share in names.items():
            table, key = name.split(".")
            value = getattr(getattr(machine, table), key)
            assert machine.provenance[name].uncertainty == pytest.approx(share * value, rel=0.02)
    assert RIG.provenance["rig.masses"].uncertainty == pytest.approx(0.005 * RIG.rig.masses[0], rel=0.02)
    assert {name: floor.uncertainty for name, floor in read_floors().items() if floor.uncertainty} == {
        "natural_stone": 0.05,
        "pvc": 0.05,
        "paperboard": 0.05,
    }
