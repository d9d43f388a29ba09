"""The replay of rig runs: what repeats with the turn of the wheel keeps its phase."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from omnimj.effects import apply_effects, with_effects
from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.rig.replay import RigReplay, true_angle
from omnimj.parameters import read_floors, read_rig
from omnimj.plant.interface import RIG_CHANNELS
from omnimj.plant.planar_rig import PlanarRig
from omnimj.recording.dataset import Dataset, Run
from omnimj.simulate.driving import drive_rig

PERIOD = 0.001


def ripple_replay() -> tuple[RigReplay, np.ndarray]:
    """Replay of one run of a planar rig with ripple, and the true wheel angle at every sample."""
    rig, floors = read_rig(), read_floors()
    true = with_effects(rig, {"roller_ripple": {"amplitude": 3.0}})
    plant = PlanarRig(true, "natural_stone", seed=3, floors=floors)
    trace = drive_rig(plant, np.concatenate([np.zeros(100), np.full(1200, 0.9)]))
    columns = {name: trace[name] for name in ("time", *RIG_CHANNELS, "current_target")}
    conditions = {"floor": "natural_stone", "mass": rig.rig.masses[0]}
    run = Run("run", columns, {}, conditions, "run")
    dataset = Dataset(Path("runs"), "quarter_rig", (run,))
    return RigReplay(dataset, rig, floors), np.cumsum(trace["true_wheel_speed"]) * PERIOD


def test_the_angle_behind_the_readings_is_the_true_one():
    """The filter of the speed and a scale error are undone: 0.1 rad is a twentieth of a roller's period."""
    replay, true = ripple_replay()
    assert true_angle(replay._runs, _plain(replay), {})[-1] == pytest.approx(true[-1], abs=0.1)


def test_a_ripple_keeps_its_phase_where_the_simulated_wheel_runs_away():
    """With a torque constant 10 % off the simulated wheel turns much farther; the ripple stays in phase."""
    replay, _ = ripple_replay()
    names = [b.name for b in replay.base]
    right = np.array([b.nominal for b in replay.base])
    wrong = right.copy()
    wrong[names.index("motor.torque_constant")] *= 1.1
    ripple = {"roller_ripple": np.array([3.0])}

    def effect_of_ripple(base):
        off, on = replay.simulate([Setting(base), Setting(base, ripple)])
        return (on - off)[:, 1]

    assert np.corrcoef(effect_of_ripple(right), effect_of_ripple(wrong))[0, 1] > 0.9


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("winding_heating", {"rate": 0.1}),
        ("supply_sag", {"resistance": 4.0}),
        ("torque_constant", {"scale": 0.85}),
        ("gear_loss", {"viscous": 2e-3, "load": 0.05}),
        ("rail_viscous", {"coefficient": 2.0}),
    ],
)
def test_a_hidden_effect_is_reproduced_in_every_channel_at_its_true_values(effect, values):
    """At top speed the supply limits the current that is delivered, which cools and sags with the machine."""
    rig, floors = read_rig(), read_floors()
    true = with_effects(rig, {effect: values})
    plant = PlanarRig(true, "natural_stone", seed=3, floors=floors)
    trace = drive_rig(plant, np.concatenate([np.zeros(100), np.full(1500, 1.5)]))
    columns = {name: trace[name] for name in ("time", *RIG_CHANNELS, "current_target")}
    conditions = {"floor": "natural_stone", "mass": rig.rig.masses[0]}
    replay = RigReplay(
        Dataset(Path("runs"), "quarter_rig", (Run("run", columns, {}, conditions, "run"),)), rig, floors
    )
    base = np.array([b.nominal for b in replay.base])
    label, shapes = next((c.label, c.parameters) for c in replay.candidates if c.effect == effect)
    own = np.array([values.get(s.name, s.null_value or 0.0) for s in shapes])
    (simulated,) = replay.simulate([Setting(base, {label: own})])
    for k, channel in enumerate(replay.channels):
        left = np.nanstd((replay.measured - simulated)[:, k])
        assert left < 0.04 * np.nanstd(replay.measured[:, k]), channel.name


def _plain(replay: RigReplay):
    return apply_effects(replay.based(Setting(np.array([b.nominal for b in replay.base]))).machine)
