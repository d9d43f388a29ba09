"""What logs and structure of a machine let the search find: contacts, stops, excitation, what cannot show."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from omnimj.effects import MJCF, effects_of
from omnimj.errors import InputError
from omnimj.estimate.gap.plants import find_plant
from omnimj.estimate.replay.interface import EXCITED, NOT_SOUGHT, Setting
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.dataset import Dataset, Run

LEG = """<mujoco><compiler angle="radian"/><option timestep="0.001"/>
  <worldbody>{floor}
    <body name="thigh" pos="0 0 1"><joint name="hip" axis="0 1 0" damping="0.1" {hip}/>
      <geom name="upper" type="capsule" size="0.03" fromto="0 0 0 0 0 -0.5" mass="1"
        contype="0" conaffinity="0"/>
      <body name="shin" pos="0 0 -0.5"><joint name="knee" axis="0 1 0" damping="0.1" {knee}/>
        <geom name="lower" type="capsule" size="0.02" fromto="0 0 0 0 0 -0.4" mass="0.5"
          contype="0" conaffinity="0"/>
        <geom name="foot" size="0.05" pos="0 0 -0.4" mass="0.1"/></body></body>
  </worldbody>
  {rest}
  <actuator>{actuators}</actuator></mujoco>"""
MOTORS = '<motor name="hip_motor" joint="hip"/><motor name="knee_motor" joint="knee"/>'
FLOOR = '<geom name="floor" type="plane" size="2 2 0.1" pos="0 0 {}"/>'
TIME = np.arange(0.0, 4.0, 0.004)
HIP, KNEE = 0.6 * np.sin(3.0 * TIME), 0.5 * np.sin(5.0 * TIME + 1.0)


def leg(folder, name="leg", actuators=MOTORS, floor="", hip="", knee="", rest=""):
    """The machine of a leg on a stand."""
    file: Path = folder / f"{name}.xml"
    file.write_text(LEG.format(actuators=actuators, floor=floor, hip=hip, knee=knee, rest=rest))
    return read_machine_file(file)


def logs(machine, hip=HIP, knee=KNEE, kind="control", runs=1):
    """Motion of hip and knee, driven by what inverse dynamics needs for it."""
    m, d = machine.mj_model, mujoco.MjData(machine.mj_model)
    m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    q = np.stack([hip, knee], axis=1)
    v = np.gradient(q, TIME, axis=0)
    a = np.gradient(v, TIME, axis=0)
    forces = np.empty(q.shape)
    for k in range(len(TIME)):
        d.qpos[:], d.qvel[:], d.qacc[:] = q[k], v[k], a[k]
        mujoco.mj_inverse(m, d)
        forces[k] = d.qfrc_inverse
    m.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    columns = {"time": TIME, "position:hip": hip, "position:knee": knee}
    columns |= {f"{kind}:{d.name}": forces[:, machine.joints.index(d.joint)] for d in machine.drives}
    return Dataset(machine.file, MJCF, tuple(Run(f"run_{k}", columns, {}, {}) for k in range(runs)))


def test_rows_in_which_a_foot_is_on_the_floor_are_left_out_and_the_others_agree(tmp_path):
    machine = leg(tmp_path, floor=FLOOR.format(0.08))
    replay = MachineReplay(logs(machine), machine)
    (note,) = [n for n in replay.notes if "touch" in n]
    assert "'floor' and 'foot' touch at" in note and "% of it is left out" in note
    heights = 1.0 - 0.5 * np.cos(replay.log.position[:, 0]) - 0.4 * np.cos(replay.log.position.sum(axis=1))
    assert heights.min() > 0.08 + 0.05
    lifted = leg(tmp_path, "lifted")
    whole = MachineReplay(logs(lifted), lifted)
    assert 0.2 * len(whole.log.times) < len(replay.log.times) < 0.95 * len(whole.log.times)
    (found,) = replay.simulate([Setting(np.array([b.nominal for b in replay.base]))])
    size = np.nanmax(np.abs(replay.measured), axis=0)
    assert np.nanmax(np.abs(found - replay.measured) / size) < 0.02


def test_a_foot_that_stays_on_the_floor_is_refused_with_the_reason(tmp_path):
    machine = leg(tmp_path, floor=FLOOR.format(0.5))
    with pytest.raises(InputError) as caught:
        find_plant(MJCF).require(logs(machine, runs=2), machine)
    said = str(caught.value)
    assert (
        "run 'run_0': 'floor' and 'foot' touch at 0 s, as in all runs; the force between them is in no log"
        in said
    )
    assert "lift what touches" in said and "\n" not in said


def test_rows_in_which_a_joint_is_at_its_stop_are_left_out(tmp_path):
    machine = leg(tmp_path, hip='range="-0.55 1" limited="true"')
    replay = MachineReplay(logs(machine), machine)
    assert replay.log.position[:, 0].min() > -0.56
    assert any("joint 'hip' is beyond its range, -0.55 to 1, at" in note for note in replay.notes)
    narrow = leg(tmp_path, "narrow", hip='range="-0.001 0.001" limited="true"')
    with pytest.raises(InputError, match="the force of a stop is in no log"):
        MachineReplay(logs(narrow), narrow)


def test_a_tendon_that_is_a_spring_and_damper_acts_as_those_of_the_joint(tmp_path):
    tendon = (
        '<tendon><fixed name="t" stiffness="3" damping="0.2"><joint joint="knee" coef="1"/></fixed></tendon>'
    )
    with_tendon, bare = leg(tmp_path, "tendon", rest=tendon), leg(tmp_path, "bare")
    same = leg(tmp_path, "same", knee='stiffness="3" springref="0"')
    same.mj_model.dof_damping[1] += 0.2
    data = logs(same)
    measured = [replay_of(data, machine) for machine in (with_tendon, bare)]
    knee = [c.name for c in measured[0][0].channels].index("control:knee_motor")
    sizes = [np.nanmax(np.abs(found - replay.measured)[:, knee]) for replay, found in measured]
    assert sizes[0] < 0.02 * sizes[1]


def replay_of(data, machine):
    replay = MachineReplay(Dataset(machine.file, MJCF, data.runs), machine)
    (found,) = replay.simulate([Setting(np.array([b.nominal for b in replay.base]))])
    return replay, found


def test_notes_name_the_excited_joints_and_those_that_hardly_move(tmp_path):
    machine = leg(tmp_path)
    still = 1e-5 * np.random.default_rng(0).standard_normal(len(TIME))
    replay = MachineReplay(logs(machine, knee=still), machine)
    (excited,) = [note for note in replay.notes if note.startswith(EXCITED)]
    assert "hip (over 1.2 rad, up to 1.8 rad/s)" in excited and "knee" not in excited
    (resting,) = [note for note in replay.notes if "hardly moves" in note]
    assert resting.startswith(f"{NOT_SOUGHT}: joint knee") and "move it over its range" in resting


def test_a_joint_that_never_turns_back_is_named(tmp_path):
    machine = leg(tmp_path)
    replay = MachineReplay(logs(machine, hip=0.5 * TIME + 0.05 * np.sin(3.0 * TIME)), machine)
    (note,) = [n for n in replay.notes if "turns back" in n]
    assert "joint hip never turns back" in note and "move it both ways" in note


@pytest.mark.slow
@pytest.mark.parametrize(
    ("actuators", "kind", "rest", "words"),
    [
        (
            '<motor name="hip_motor" joint="hip"/>',
            "control",
            "",
            "compliance, backlash on joint knee: it has no actuator",
        ),
        (
            '<motor name="hip_motor" joint="hip"/>',
            "control",
            "",
            "load_friction on joint knee: without an actuator it transmits nothing but its own friction",
        ),
        (
            MOTORS,
            "control",
            "",
            "torque_constant, back_emf on actuator hip_motor: the file does not drive it by",
        ),
        (
            MOTORS,
            "force",
            "",
            "on actuator knee_motor: force:knee_motor was measured behind them; log control:",
        ),
        (MOTORS, "control", '<option gravity="0 0 0"/>', "grade: leg.xml has no gravity"),
    ],
)
def test_every_effect_that_the_structure_cannot_have_is_named_with_reason_and_remedy(
    tmp_path, actuators, kind, rest, words
):
    machine = leg(tmp_path, actuators=actuators, rest=rest)
    replay = MachineReplay(logs(machine, kind=kind), machine)
    assert any(note.startswith(NOT_SOUGHT) and words in note for note in replay.notes), replay.notes
    sought = {candidate.effect for candidate in replay.candidates}
    said = " ".join(note for note in replay.notes if note.startswith(NOT_SOUGHT))
    of_channels = {name for name, effect in effects_of(MJCF).items() if effect.where == "sensors"}
    assert [n for n in effects_of(MJCF) if n not in sought | of_channels and n not in said] == []
