import mujoco
import numpy as np
import pytest
from servo_logs import SERVO

from omnimj.effects import Interval
from omnimj.effects.parts import Payload
from omnimj.errors import InputError, UnknownNameError
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.plant.mujoco.machine_writer import new_machine_files
from omnimj.plant.mujoco.quantities import with_masses

BODY = '<body name="b"><joint name="j"{joint}/><geom size="0.1"/>{more}</body>'


def written(folder, body=BODY, joint="", more="", rest=""):
    file = folder / "machine.xml"
    world = body.replace("{joint}", joint).replace("{more}", more)
    file.write_text(f"<mujoco><worldbody>{world}</worldbody>{rest}</mujoco>")
    return file


def load(folder, files):
    for name, text in files.items():
        (folder / name).write_text(text)
    return read_machine_file(folder / next(iter(files)))


def numbers(model):
    skipped = ("names", "paths", "text", "opt", "stat", "vis", "names_map", "sig")
    names = [n for n in dir(model) if not n.startswith("_") and n not in skipped]
    arrays = {n: getattr(model, n) for n in names}
    return {n: np.array(v) for n, v in arrays.items() if isinstance(v, np.ndarray)}


def test_only_what_the_search_changed_differs_in_plain_mujoco(tmp_path):
    machine = read_machine_file(SERVO)
    effects = {"stribeck": {"joint": "shaft", "force": Interval(0.1, 0.05, 0.15, "N.m"), "velocity": 0.3}}
    files = new_machine_files(machine, {("joint", "shaft", "damping"): 0.0123456789012345}, effects, "model")
    found = load(tmp_path, files)
    before, after = numbers(machine.mj_model), numbers(mujoco.MjModel.from_xml_path(str(found.file)))
    changed = {name for name in before if not np.array_equal(before[name], after[name])}
    assert changed == {"dof_damping"} and after["dof_damping"][0] == 0.0123456789012345
    assert found.effects["stribeck"]["force"] == 0.1
    assert [u.part for u in found.uncertain] == [u.part for u in machine.uncertain]


def test_effects_that_mjcf_can_say_are_said_in_mjcf(tmp_path):
    machine = read_machine_file(SERVO)
    effects = {
        "coulomb": {"joint": "shaft", "force": 0.03},
        "quadratic_friction": {"joint": "shaft", "coefficient": 0.002},
        "armature": {"joint": "shaft", "inertia": 0.001},
        "payload": {"body": "arm", "mass": 0.1, "distance": 0.1},
        "torque_constant": {"actuator": "motor", "scale": 0.8},
        "actuator_lag": {"actuator": "motor", "time_constant": 0.01},
        "grade": {"axis": "y", "slope": 0.1},
    }
    m = load(tmp_path, new_machine_files(machine, {}, effects, "model")).mj_model
    assert m.dof_frictionloss[0] == pytest.approx(0.05) and m.dof_armature[0] == pytest.approx(0.0015)
    assert m.dof_dampingpoly[0, 0] == pytest.approx(0.002)
    assert m.actuator_gainprm[0, 0] == pytest.approx(0.08)
    assert m.actuator_biasprm[0, 2] == pytest.approx(0.8**2 * -0.04)
    assert m.actuator_dynprm[0, 0] == pytest.approx(0.01)
    assert m.opt.gravity == pytest.approx([-9.81 * np.sin(0.1), 0.0, -9.81 * np.cos(0.1)])
    more = inertia_about_the_joint(m) - inertia_about_the_joint(machine.mj_model)
    assert more == pytest.approx(0.001 + 0.1 * 0.1**2, rel=1e-6)


def inertia_about_the_joint(model):
    data = mujoco.MjData(model)
    model.opt.gravity[:] = model.dof_frictionloss[:] = 0.0
    data.qacc[:] = 1.0
    mujoco.mj_inverse(model, data)
    return float(data.qfrc_inverse[0])


_MOTOR = '<motor joint="j"/>'


def test_an_actuator_without_a_name_has_that_of_its_joint_and_is_found_again_in_the_file(tmp_path):
    machine = read_machine_file(written(tmp_path, rest=f"<actuator>{_MOTOR}</actuator>"))
    (drive,) = machine.drives
    assert (drive.name, drive.gain) == ("j", 1.0)
    files = new_machine_files(machine, {("actuator", "j", "gain"): 0.9}, {}, "new")
    (tmp_path / "new.xml").write_text(files["new.xml"])
    (changed,) = read_machine_file(tmp_path / "new.xml").drives
    assert (changed.name, changed.gain) == ("j", 0.9)


def test_structures_that_cannot_be_replayed_are_refused_in_one_line_with_the_part(tmp_path):
    cases = [
        ({"joint": ' type="free"'}, "joint 'j' of body 'b': is a free joint; the forces on a floating base"),
        ({"joint": ' type="ball"'}, "is a ball joint; its position is no single number: write three hinges"),
        ({"body": '<body name="b"><joint/><geom size="0.1"/></body>'}, "has no name"),
        (
            {"rest": '<tendon><fixed name="t" frictionloss="1"><joint joint="j" coef="1"/></fixed></tendon>'},
            "tendon 't': has frictionloss; its springs and dampers can be replayed, nothing else",
        ),
        (
            {"rest": '<equality><joint name="e" joint1="j"/></equality>'},
            "equality 'e': couples joint 'j' to a constant; how coupled joints share their load is in no log",
        ),
        ({"rest": '<equality><connect name="e" body1="b" anchor="0 0 1"/></equality>'}, "closes a loop"),
        ({"rest": '<equality><weld body1="b"/></equality>'}, "equality '1': closes a loop (weld)"),
        ({"rest": f"<actuator>{2 * _MOTOR}</actuator>"}, "actuator 2: has no name"),
        ({"body": '<geom size="1"/>'}, "has no joints"),
        ({"body": "<nonsense/>"}, "is not an MJCF model"),
        (
            {"rest": '<actuator><motor name="a" joint="j"/><motor name="c" joint="j"/></actuator>'},
            "actuator 'c': drives joint 'j', which 'a' drives",
        ),
    ]
    for given, words in cases:
        with pytest.raises(InputError) as caught:
            read_machine_file(written(tmp_path, **given))
        assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "rest",
    [
        '<equality><connect body1="b" anchor="0 0 1" active="false"/></equality>',
        '<tendon><fixed stiffness="2" damping="1"><joint joint="j" coef="1"/></fixed></tendon>',
    ],
)
def test_a_constraint_that_is_switched_off_and_a_springy_tendon_are_no_hindrance(tmp_path, rest):
    assert read_machine_file(written(tmp_path, rest=rest)).joints == ("j",)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[uncertain.joint.k]\ndamping = {}", "unknown joint 'k'"),
        ("[uncertain.joint.j]\ndamp = {}", "did you mean 'damping'?"),
        ("[uncertain.wheel.j]\ndamping = {}", "unknown kind of part 'wheel'"),
        ("[uncertain.joint.j]\ndamping = 3", "found 3; write"),
        ('[uncertain.joint.j]\ndamping = { half_width = 1.0, unit = "N" }', "the unit is 'N.m.s/rad'"),
        ('[uncertain.joint.j]\ndamping = { half_width = -1.0, unit = "N.m.s/rad" }', "half_width"),
        ("[more]", "unknown table 'more'"),
        ('[sensors]\non_link = ["k"]', "unknown joint 'k'"),
        ('[sensors]\non_link = "j"', "must be a list of joints"),
        ('[sensors]\non_motor = ["j"]', "unknown key 'on_motor'"),
        ('[effects.coulomb]\njoint = "k"\nforce = { value = 1.0, unit = "N.m", source = "chosen" }', "'k'"),
        ('[effects.coulomb]\njoint = "j"\nforce = { value = 1.0, unit = "N", source = "chosen" }', "'N.m'"),
        ('[effects.coulomb]\nforce = { value = 1.0, unit = "N.m", source = "chosen" }', "joint"),
        ("[effects.sticky]", "unknown effect of mjcf 'sticky'"),
    ],
)
def test_wrong_entries_beside_the_file_give_one_line_with_the_choices(tmp_path, text, words):
    file = written(tmp_path)
    file.with_suffix(".toml").write_text(text)
    with pytest.raises(InputError) as caught:
        read_machine_file(file)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_an_encoder_is_on_the_motor_unless_it_is_said_to_be_on_the_link(tmp_path):
    file = written(tmp_path)
    assert read_machine_file(file).encoders_on_links == ()
    file.with_suffix(".toml").write_text('[sensors]\non_link = ["j"]')
    assert read_machine_file(file).encoders_on_links == ("j",)


def test_a_file_that_is_missing_is_said_to_be(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_machine_file(tmp_path / "none.xml")
    with pytest.raises(InputError, match=r"--model FILE\.xml"):
        read_machine_file(None)


def test_a_motor_with_a_resistance_states_its_constant(tmp_path):
    rest = '<actuator><dcmotor name="a" joint="j" motorconst="0.3" resistance="3"/></actuator>'
    machine = read_machine_file(written(tmp_path, rest=rest))
    values = {key: value for (kind, _, key), value in machine.values.items() if kind == "actuator"}
    assert values["torque_constant"] == pytest.approx(0.3) and values["resistance"] == pytest.approx(3.0)
    with pytest.raises(UnknownNameError):
        machine.file.with_suffix(".toml").write_text("[uncertain.actuator.a]\nback_emf = {}")
        read_machine_file(machine.file)


def test_a_payload_on_a_body_whose_frame_is_its_inertial_one_adds_its_mass_to_the_slide(tmp_path):
    file = tmp_path / "finger.xml"
    file.write_text(
        '<mujoco><worldbody><body name="finger"><joint name="slide" type="slide" axis="1 0 0"/>'
        '<geom name="pad" type="box" size=".01 .02 .04" mass=".12"/></body></worldbody></mujoco>'
    )
    machine = read_machine_file(file)
    loaded = with_masses(machine.mj_model, machine.values, [Payload("finger", 0.2, 0.05)])
    data = mujoco.MjData(loaded)
    mujoco.mj_setConst(loaded, data)
    data.qfrc_applied[0] = 1.0
    mujoco.mj_forward(loaded, data)
    assert data.qacc[0] == pytest.approx(1.0 / 0.32)
