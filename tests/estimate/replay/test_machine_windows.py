"""Free windows of the replay of any machine against closed forms."""

import numpy as np
import pytest

from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.estimate.replay.mjcf.rigid import RigidBodies
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.dataset import Dataset, Run

MASS, DAMPING, DRY, FORCE = 2.0, 16.0, 3.0, 40.0
SLIDE = f"""<mujoco><option gravity="0 0 0"/><worldbody><body name="carriage">
  <joint name="slide" type="slide" axis="1 0 0" damping="{DAMPING}" frictionloss="{DRY}"/>
  <geom name="block" type="box" size=".1 .1 .1" mass="{MASS}"/></body></worldbody>
  <actuator><motor name="drive" joint="slide"/></actuator></mujoco>"""


@pytest.fixture(params=["closed form", "MuJoCo"], autouse=True)
def route(request, monkeypatch):
    """Both ways to simulate a window of a machine with a single joint."""
    if request.param == "MuJoCo":
        monkeypatch.setattr(RigidBodies, "one_joint", lambda *_: None)


def pushed(time):
    """Position of the slide under a constant force, m v' = F − D − b v, from 0.2 m/s on."""
    steady, rate = (FORCE - DRY) / DAMPING, DAMPING / MASS
    return steady * time + (0.2 - steady) / rate * (1.0 - np.exp(-rate * time))


def swung(time):
    """Position of the slide under F cos 9 t without dry friction, at its steady oscillation."""
    return (FORCE * np.exp(9.0j * time) / (DAMPING * 9.0j - MASS * 81.0)).real


def error_of_windows(tmp_path, motion, force, period, dry):
    """RMS error of the position in free windows of the true slide, noise-free logs [m]."""
    file = tmp_path / "slide.xml"
    file.write_text(SLIDE.replace(f'frictionloss="{DRY}"', f'frictionloss="{dry}"'))
    time = np.arange(0.0, 2.0, period)
    columns = {"time": time, "position:slide": motion(time), "control:drive": force(time)}
    found = MachineReplay(Dataset(file, "mjcf", (Run("a", columns, {}, {}),)), read_machine_file(file))
    (simulated,) = found.simulate([Setting(np.array([b.nominal for b in found.base]))])
    names = [c.name for c in found.channels]
    wrong = (found.measured - simulated)[:, names.index("position:slide")]
    return float(np.sqrt(np.nanmean(wrong**2)))


def constant(time):
    return np.full(len(time), FORCE)


def cosine(time):
    return FORCE * np.cos(9.0 * time)


@pytest.mark.parametrize(
    ("motion", "force", "dry"), [(pushed, constant, DRY), (swung, cosine, 0.0)], ids=["pushed", "swung"]
)
def test_the_true_machine_ends_its_windows_where_the_closed_form_does(tmp_path, motion, force, dry, measured):
    wrong = error_of_windows(tmp_path, motion, force, 0.005, dry)
    travel = float(np.ptp(motion(np.arange(0.0, 2.0, 0.005))))
    measured("position after a free window at 200 Hz, over the travel [1]", wrong / travel, 5e-4)
    assert wrong < 5e-4 * travel


@pytest.mark.slow
def test_half_the_period_leaves_a_quarter_of_the_error_of_a_window(tmp_path):
    coarse, fine = (error_of_windows(tmp_path, swung, cosine, h, 0.0) for h in (0.005, 0.0025))
    assert 3.0 < coarse / fine < 6.0
