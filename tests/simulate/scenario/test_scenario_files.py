"""Scenario files: what they may hold, and how bad ones are refused in one clear line."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.errors import InputError, UnknownNameError
from omnimj.resources import scenarios_folder
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.listing import list_scenarios, scenario_names
from omnimj.simulate.scenario.overrides import apply_override, split_override
from omnimj.simulate.scenario.scenario import read_scenario

NAMES = scenario_names()


def refused(*overrides, name="nylon_patch"):
    with pytest.raises(InputError) as caught:
        read_scenario(name, overrides)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_the_promised_scenarios_are_there():
    promised = {"nylon_patch", "degraded_motor", "circle_8m", "circle_8m_kinematic", "square_path"}
    promised |= {"square_path_open_loop", "square_path_kinematic", "square_path_kinematic_open_loop"}
    assert promised | {"rig_constant_current", "rig_lateral", "rig_slip", "rig_motor"} <= set(NAMES)


def test_a_scene_that_is_not_there_is_refused():
    assert "choices: obstacles, scene" in refused("scene=obstacle", name="ramp")
    assert "there is no file" in refused("scene=none.xml", name="ramp")
    assert "kinematic level" in refused("scene=obstacles", name="circle_8m_kinematic")


def test_the_planar_plant_refuses_a_scene():
    with pytest.raises(InputError, match="flat floor only"):
        run_scenario(read_scenario("ramp"), "planar")


@pytest.mark.parametrize("text", ["<mujoco><worldbody", "<mujoco/>", "<mujoco><body/></mujoco>"])
def test_a_broken_scene_beside_its_scenario_is_one_line(tmp_path, text):
    (tmp_path / "own.xml").write_text(text)
    source = (scenarios_folder() / "ramp.toml").read_text().replace('"obstacles"', '"own.xml"')
    (tmp_path / "own.toml").write_text(source)
    with pytest.raises(InputError, match=r"own\.xml|MJCF") as caught:
        run_scenario(read_scenario(tmp_path / "own.toml"), "twin")
    assert "\n" not in str(caught.value)


def test_the_list_has_one_line_per_scenario():
    described = list_scenarios()
    assert list(described) == sorted(NAMES)
    assert all(text and "\n" not in text for text in described.values())


def test_overrides_reach_the_scenario():
    overrides = ["floor=pvc", "drive.speed=0.8", "checks.max_yaw_excursion=0.5", "duration=2"]
    scenario = read_scenario(
        "nylon_patch", [*overrides, "patches.0.center.1=0.5", "checks.peak_speed.min=0.1"]
    )
    assert scenario.floor == "pvc"
    assert scenario.duration == 2.0
    assert scenario.patches[0].center == (0.25, 0.5)
    assert {(c.name, c.bound, c.limit) for c in scenario.checks} >= {
        ("max_yaw_excursion", "max", 0.5),
        ("peak_speed", "min", 0.1),
    }
    fault = read_scenario(
        "degraded_motor", ["faults.0.wheel=3", "faults.0.loss=0.3", "faults.0.end=2.0"]
    ).faults[0]
    assert (fault.wheel, fault.numbers["loss"], fault.end) == (3, 0.3, 2.0)


def test_a_value_is_a_toml_value_or_else_a_bare_string():
    assert split_override("a=0.5") == ("a", 0.5)
    assert split_override("a=[1, 2]") == ("a", [1, 2])
    assert split_override("a=true") == ("a", True)
    assert split_override('a="0.5"') == ("a", "0.5")
    assert split_override("a=pvc") == ("a", "pvc")
    assert split_override("a=1\nb=2") == ("a", "1\nb=2")
    assert split_override("a=b=c") == ("a", "b=c")


def test_a_mistyped_key_lists_the_known_ones_and_is_not_added():
    assert "did you mean 'floor'" in refused("flor=pvc")
    assert "did you mean 'speed'" in refused("drive.sped=0.5")
    assert "did you mean 'loss'" in refused("faults.0.los=0.5", name="degraded_motor")
    assert "did you mean 'size'" in refused("patches.0.sise=[1, 1]")
    message = refused("checks.path_eror_max=0.1", name="circle_8m")
    assert "did you mean 'path_error_max'" in message and "peak_speed" in message
    assert "did you mean 'weights'" in refused("kinematics.weigts=[1,1,1,1]", name="circle_8m_kinematic")


def test_a_key_of_another_kind_is_refused_with_the_keys_of_this_kind():
    message = refused("faults.0.grip=0.5", name="degraded_motor")
    assert "degraded_motor.toml: faults.0" in message and "loss" in message
    message = refused("drive.diameter=3.0")
    assert "profile" in message and "direction" in message


def test_an_index_out_of_range_is_refused_with_the_number_of_entries():
    assert "'faults' has 1" in refused("faults.1.wheel=3", name="degraded_motor")
    assert "'faults' has 0" in refused("faults.0.wheel=3")
    assert "'patches' has 1" in refused(f"patches.{'9' * 5000}.floor=pvc")
    assert "is not an index" in refused("faults.first.wheel=3", name="degraded_motor")


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("nylon_patch", "floor=ice_cream", "unknown floor 'ice_cream'"),
        ("nylon_patch", "floor=[1]", "one line of text"),
        ("nylon_patch", "duration=0", "at least 0.01"),
        ("nylon_patch", "duration=nan", "at least 0.01"),
        ("nylon_patch", "duration=long", "a number is needed"),
        ("nylon_patch", "level=dream", "choices: kinematic, physics"),
        ("nylon_patch", "patches.0.size=[0.0, 1.0]", "above 0"),
        ("nylon_patch", "patches.0.floor=[1, 2]", "unknown floor"),
        ("nylon_patch", "patches.0.center=[0.0]", "two numbers"),
        ("nylon_patch", "patches=5", "[[patches]]"),
        ("nylon_patch", "checks=5", "a table is needed"),
        ("nylon_patch", "checks.peak_speed=fast", "a number is needed"),
        ("nylon_patch", "checks.peak_speed={ min = 2, max = 1 }", "min 2 is above max 1"),
        ("nylon_patch", "checks.peak_speed={ least = 2 }", "choices: max, min"),
        ("nylon_patch", "checks.peak_speed={}", "give min, max or both"),
        ("nylon_patch", "checks.path_error_max=0.1", "unknown metric 'path_error_max'"),
        ("nylon_patch", "drive=5", "a table is needed"),
        ("nylon_patch", "plant=quarter_rig", "belongs to its plant"),
        ("nylon_patch", "drive.speed.low=1", "single value"),
        ("nylon_patch", "nothing", "KEY=VALUE"),
        ("nylon_patch", "a..b=1", "KEY=VALUE"),
        ("nylon_patch", "kinematics.plant=published", "level = 'kinematic'"),
        ("degraded_motor", "faults.0.wheel=9", "at most 4"),
        ("degraded_motor", "faults.0.kind=gremlin", "choices: all_wheel_slip"),
        ("degraded_motor", "faults.0=7", "a table is needed"),
        ("circle_8m_kinematic", "kinematics.lost_wheel=5", "at most 4"),
        ("circle_8m_kinematic", "kinematics.weights=[1.0]", "4 numbers"),
        ("circle_8m_kinematic", "kinematics.weights.2=0.0", "at least 1e-09"),
        ("circle_8m_kinematic", "kinematics.plant=best", "choices: corrected, published"),
        (
            "circle_8m_kinematic",
            'faults=[{kind = "free", wheel = 1, onset = 0}]',
            "no effect at the kinematic",
        ),
        ("circle_8m_kinematic", "drive.heading_hold=true", "kinematic level"),
        ("circle_8m_kinematic", "drive.creep_floor=pvc", "the kinematic level has no creep"),
        ("circle_8m", "drive.creep_floor=sand", "drive.creep_floor: unknown floor 'sand'; choices:"),
        ("circle_8m", "drive.creep_floor=3", "a string is needed"),
        ("circle_8m", "floors=sand.toml", "there is no file"),
        ("circle_8m", "floors=3", "a string is needed"),
        ("circle_8m_kinematic", "checks.rms_current=1.0", "unknown metric"),
        ("rig_lateral", "current=1.6", "at most 1.5"),
        ("rig_lateral", "mass=-1", "above"),
        ("rig_lateral", "lateral_speed=0.6", "at most 0.5"),
        ("rig_lateral", "drive.speed=1", "unknown key 'drive'"),
    ],
)
def test_a_bad_value_is_refused_with_place_value_and_rule(name, text, expected):
    assert expected in refused(text, name=name)


def test_an_unknown_scenario_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match=r"did you mean 'nylon_patch'.*choices: circle_8m"):
        read_scenario("nylon_path")
    with pytest.raises(InputError, match="no such scenario file"):
        read_scenario("nowhere/at_all.toml")


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"plant = ", "is not valid TOML"),
        (b"\xff\xfe", "is not valid TOML"),
        (b"", "plant: is missing"),
        (b'plant = "submarine"', "choices: quarter_rig, uto_robot"),
        (b'plant = "uto_robot"\nspeed = 1', "unknown key of a uto_robot scenario 'speed'"),
        (b'plant = "uto_robot"', "is missing"),
        (b'plant = "uto_robot"\nfloor = "pvc"\nduration = 1.0\ndescription = "x"', "[drive] is missing"),
        (b'plant = "quarter_rig"\nfloor = "pvc"\nduration = 1.0\ndescription = "x"', "current: is missing"),
    ],
)
def test_a_broken_file_is_refused_by_name(tmp_path, content, expected):
    path = tmp_path / "mine.toml"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_scenario(path)
    assert expected in str(caught.value) and "mine.toml" in str(caught.value)


def test_a_scenario_may_lie_anywhere(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes((scenarios_folder() / "nylon_patch.toml").read_bytes())
    assert read_scenario(str(path)).name == "mine"


def test_another_model_file_changes_the_robot(tmp_path):
    shipped = (scenarios_folder().parent / "models/uto_robot/robot.toml").read_text(encoding="utf-8")
    path = tmp_path / "heavy.toml"
    path.write_text(shipped.replace("value = 15.837", "value = 20.0"), encoding="utf-8")
    robot = read_scenario("nylon_patch", model_file=path).constants
    assert robot.file == path


MAT = (
    *("description = 'x'", "law = 'creep_ratio'", "source = 'x'", "mu = 0.5", "creep_stiffness = 9.0"),
    *("relaxation_length = 0.01", "damping_time = 0.0"),
)


def test_floors_of_a_scenario_lie_beside_it_or_among_the_shipped_models(tmp_path):
    shipped = read_scenario("circle_8m", ["floors=robotino/soft_floors.toml", "floor=gray"])
    assert shipped.floors["gray"].numbers["turnover"] > 0.0
    text = (scenarios_folder() / "circle_8m.toml").read_text(encoding="utf-8")
    path, mats = tmp_path / "mine.toml", "[mat]\n" + "\n".join(MAT)
    path.write_text('floors = "mats.toml"\n' + text, encoding="utf-8")
    (tmp_path / "mats.toml").write_text(mats, encoding="utf-8")
    (tmp_path / "others.toml").write_text(mats.replace("0.5", "0.6"), encoding="utf-8")
    assert read_scenario(path).floors["mat"].numbers["mu"] == 0.5
    # a file given beside the scenario replaces floors of the same name
    assert read_scenario(path, floors_file=tmp_path / "others.toml").floors["mat"].numbers["mu"] == 0.6


def test_the_diagnosis_expects_the_hall_s_floor_where_a_given_file_describes_it(tmp_path):
    mats = tmp_path / "mats.toml"
    mats.write_text("[mat]\n" + "\n".join(MAT), encoding="utf-8")
    on_mat = read_scenario("circle_8m", ["floor=mat"], floors_file=mats)
    assert on_mat.expected_floor == on_mat.floors["mat"]
    assert read_scenario("circle_8m", floors_file=mats).expected_floor is None
    assert read_scenario("circle_8m").expected_floor is None
    other = read_scenario("circle_8m", ["floor=mat", "diagnosis.floor=linoleum"], floors_file=mats)
    assert other.expected_floor == other.floors["linoleum"]


# fmt: off
KEYS = st.sampled_from([
    "floor", "duration", "level", "drive", "faults", "faults.0", "faults.0.loss", "faults.0.kind",
    "faults.0.wheel", "faults.0.end", "checks", "checks.peak_speed", "checks.peak_speed.min", "patches",
    "kinematics", "drive.kind", "drive.speed", "drive.speed.x", "drive.start", "description", "current",
    "x",
])
# fmt: on
# a number of hundreds of digits is the business of `parameters.reading`
VALUES = st.one_of(
    st.text(max_size=40),
    st.floats().map(str),
    st.integers(-1000, 1000).map(str),
    st.sampled_from(["[]", "{}", "[[1, 2]]", "true", "1979-05-27", '"', "'''", "{ min = 1 }", "inf", "-0.0"]),
)


@pytest.mark.slow
@given(key=st.one_of(KEYS, st.text(max_size=12)), value=VALUES)
def test_any_override_gives_a_scenario_or_one_clear_line(key, value):
    try:
        scenario = read_scenario("degraded_motor", [f"{key}={value}"])
    except InputError as error:
        assert str(error)
    else:
        assert scenario.duration <= 1800.0


TREES = st.recursive(
    st.one_of(st.integers(), st.text(max_size=5)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.text("ab0.", min_size=1, max_size=3), inner, max_size=3),
    ),
    max_leaves=8,
)


@given(tree=st.dictionaries(st.text("ab", min_size=1, max_size=2), TREES, max_size=3), data=st.data())
def test_an_override_changes_one_value_and_adds_no_key(tree, data):
    key = ".".join(data.draw(st.lists(st.sampled_from(["a", "b", "ab", "0", "1"]), min_size=1, max_size=3)))
    before = repr(sorted(tree))
    try:
        apply_override(tree, key, "new", {})
    except InputError:
        assert repr(sorted(tree)) == before
        return
    node = tree
    for part in key.split("."):
        node = node[int(part)] if isinstance(node, list) else node[part]
    assert node == "new"
    assert repr(sorted(tree)) == before


@given(st.binary(max_size=200))
def test_any_bytes_are_a_scenario_or_one_clear_line(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("hostile") / "any.toml"
    path.write_bytes(content)
    with pytest.raises(InputError):
        read_scenario(path)


def test_shipped_files_hold_no_key_that_nothing_reads():
    for name in NAMES:
        tree = tomllib.loads((scenarios_folder() / f"{name}.toml").read_text(encoding="utf-8"))
        assert read_scenario(name).description == tree["description"]
