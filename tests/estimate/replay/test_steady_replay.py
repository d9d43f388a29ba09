"""Steady driving with a measured pose: blocks of real logs, and effects hidden in simulated ones."""

import itertools
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from measured_logs import unpack

from omnimj.effects import apply_effects, with_effects
from omnimj.errors import InputError
from omnimj.estimate.gap.files import new_floors_text, new_model_files
from omnimj.estimate.gap.find import DatasetSummary, analyse_replay
from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.steady.replay import SteadyReplay, steady_model
from omnimj.estimate.replay.steady.runs import direction_sectors, steady_runs
from omnimj.parameters import read_floors, read_robot
from omnimj.physics.equilibrium import steady_rows
from omnimj.physics.kinematics import rolling_matrix
from omnimj.recording.dataset import Dataset, Run

FLOOR, OTHER = "natural_stone", "paperboard"
HIDDEN = {
    "creep_ratio": {"compliance": 0.5, "slip_speed": 0.0},
    "soft_floor": {"resistance": 0.12},
    "load_offset": {"x": -0.025, "y": 0.004},
}
RATE = 32.0


def robot():
    return read_robot("robotino")


def steady_twist_of(machine, floor, speeds):
    """Twist and currents of a machine with its effects, from the packed kernels directly."""
    changed = apply_effects(machine)
    rows = np.zeros((1, 6))
    steady_rows(steady_model(changed, changed.floor(read_floors()[floor])), speeds[None], np.zeros(0), rows)
    return rows[0]


def log(machine, floor, direction, speed, rng):
    nominal = robot()
    aim = speed * np.array([np.cos(direction), np.sin(direction), 0.0])
    rims = rolling_matrix(nominal.wheel_positions, nominal.rolling_directions) @ aim
    speeds = rims / nominal.wheel.radius
    vx, vy, rate, *currents = steady_twist_of(machine, floor, speeds)
    time = np.arange(0.0, 8.0, 1.0 / RATE)
    heading = rate * time
    # exact integrals of a constant twist
    turned = time if abs(rate) < 1e-9 else np.sin(heading) / rate
    side = 0.5 * rate * time**2 if abs(rate) < 1e-9 else (1.0 - np.cos(heading)) / rate
    columns = {
        "time": time,
        "x": vx * turned - vy * side + rng.normal(0.0, 2e-4, len(time)),
        "y": vx * side + vy * turned + rng.normal(0.0, 2e-4, len(time)),
        "heading": heading + rng.normal(0.0, 2e-3, len(time)),
    }
    for i in range(3):
        columns[f"wheel_speed_{i + 1}"] = speeds[i] + rng.normal(0.0, 0.02, len(time))
        columns[f"current_{i + 1}"] = currents[i] + rng.normal(0.0, 0.03, len(time))
    return columns


def dataset(machine, seed=0, floors=(FLOOR,)):
    rng, runs = np.random.default_rng(seed), []
    for floor, k, speed in itertools.product(floors, range(24), (0.1, 0.25)):
        columns = log(machine, floor, 2.0 * np.pi * k / 24.0, speed, rng)
        conditions = MappingProxyType({"floor": floor})
        runs.append(Run(f"{floor}_{k:02}_{speed:g}", columns, MappingProxyType({}), conditions))
    made = Dataset(Path("made"), "uto_robot", tuple(runs), (), 3, True)
    return direction_sectors(made, robot())


@pytest.fixture(scope="module")
def hidden():
    return dataset(with_effects(robot(), HIDDEN))


@pytest.fixture(scope="module")
def found(hidden):
    return analyse_replay(SteadyReplay(hidden, robot(), read_floors()), DatasetSummary("made"), seed=3)


@pytest.mark.slow
def test_hidden_effects_of_a_soft_floor_are_named_with_their_sizes(found):
    named = {e.effect: e for e in found.effects}
    assert found.verdict in ("named", "ambiguous")
    assert set(HIDDEN) <= set(named)
    offset, soft = named["load_offset"].parameters, named["soft_floor"].parameters["resistance"]
    assert offset["x"].value == pytest.approx(-0.025, abs=0.005)
    assert soft.value == pytest.approx(0.12, rel=0.2)
    after = [gap.after for name, gap in found.heldout.items() if name.startswith("velocity")]
    assert max(value for value in after if value is not None) < 0.002


def test_a_robot_without_anything_hidden_has_no_gap():
    replay = SteadyReplay(dataset(robot(), 1), robot(), read_floors())
    found = analyse_replay(replay, DatasetSummary("made"), seed=1)
    assert found.verdict == "no_gap"
    assert not found.effects


def with_turned_marker(runs, floor, angle):
    """The dataset with a heading that reads too much by an angle in the runs on a floor."""
    turned = [
        replace(run, columns={**run.columns, "heading": run.columns["heading"] + angle})
        if run.conditions["floor"] == floor
        else run
        for run in runs.runs
    ]
    return replace(runs, runs=tuple(turned))


@pytest.mark.slow
def test_effects_of_several_floors_are_named_for_the_floor_that_has_them(tmp_path):
    hidden = {
        "load_offset": {"x": -0.025, "y": 0.004},
        "creep_ratio": {"compliance": 0.5, "slip_speed": 0.0, "floor": OTHER},
        "soft_floor": {"resistance": 0.12, "roller_resistance": 0.2, "floor": OTHER},
    }
    made = dataset(with_effects(robot(), hidden), floors=(FLOOR, OTHER))
    made = with_turned_marker(made, OTHER, 0.02)
    found = analyse_replay(SteadyReplay(made, robot(), read_floors()), DatasetSummary("made"), seed=3)
    named = {(e.effect, e.selectors.get("floor")): e.parameters for e in found.effects}
    assert set(named) == {("load_offset", None), ("creep_ratio", OTHER), ("soft_floor", OTHER)}
    soft = named["soft_floor", OTHER]
    assert soft["resistance"].value == pytest.approx(0.12, abs=0.03)
    assert soft["roller_resistance"].value == pytest.approx(0.2, abs=0.05)
    assert named["load_offset", None]["x"].value == pytest.approx(-0.025, abs=0.003)
    angles = {p.name: p.fitted for p in found.refitted if p.name.endswith(".heading")}
    assert angles[f"{OTHER}.heading"] == pytest.approx(0.02, abs=0.003)
    assert angles[f"{FLOOR}.heading"] == pytest.approx(0.0, abs=0.003)


@pytest.mark.slow
def test_effects_of_a_floor_become_numbers_of_this_floor_and_those_of_the_robot_its_effects(
    hidden, found, tmp_path
):
    files = tmp_path / "model.toml", tmp_path / "floors.toml"
    new_model = new_model_files(found, robot().file)["model.toml"]
    texts = new_model, new_floors_text(found, read_floors(), robot().file)
    for file, text in zip(files, texts, strict=True):
        file.write_text(text)
    model, floor = read_robot(files[0]), read_floors(files[1])[FLOOR]
    assert not {"creep_ratio", "soft_floor"} & set(model.effects)
    assert "load_offset" in model.effects
    soft = next(e for e in found.effects if e.effect == "soft_floor").parameters["resistance"].value
    assert floor.numbers["rolling_resistance"] == pytest.approx(soft, rel=1e-5)
    replay = SteadyReplay(hidden, model, {FLOOR: floor})
    (simulated,) = replay.simulate([Setting(np.array([b.nominal for b in replay.base]))])
    errors = np.sqrt(np.nanmean((hidden_blocks(hidden) - simulated) ** 2, axis=0))
    assert errors[:2].max() < 0.002


def hidden_blocks(runs):
    return steady_runs(runs, robot(), read_floors()).measured


def test_a_turned_marker_turns_the_velocity_back_and_a_scale_scales_it(hidden):
    replay = SteadyReplay(hidden, robot(), read_floors())
    base = np.array([b.nominal for b in replay.base])
    plain, turned, scaled = replay.simulate(
        [
            Setting(base),
            Setting(base, {"heading_offset": np.array([0.2])}),
            Setting(base, {"pose_scale": np.array([0.9])}),
        ]
    )
    v, w = plain[:, 0] + 1j * plain[:, 1], turned[:, 0] + 1j * turned[:, 1]
    assert np.allclose(w, v * np.exp(-0.2j))
    assert np.allclose(scaled[:, :2], 0.9 * plain[:, :2])
    assert np.allclose(turned[:, 2:], plain[:, 2:])


def test_whole_sectors_of_directions_are_one_condition(hidden):
    by_condition = {}
    for run in hidden.runs:
        by_condition.setdefault(run.condition, []).append(run.name)
    assert len(by_condition) == 12
    assert all(len(names) == 4 for names in by_condition.values())


def test_too_little_steady_driving_is_refused_in_one_line(hidden):
    few = replace(hidden, runs=hidden.runs[:5])
    with pytest.raises(InputError, match="5 runs of steady driving"):
        steady_runs(few, robot(), read_floors())
    short = [
        replace(run, columns={name: values[:64] for name, values in run.columns.items()})
        for run in hidden.runs
    ]
    with pytest.raises(InputError, match="0 runs of steady driving"):
        steady_runs(replace(hidden, runs=tuple(short)), robot(), read_floors())


def test_a_run_that_changes_its_speed_gives_no_block(hidden):
    run = hidden.runs[0]
    columns = {**run.columns}
    for i in range(1, 4):
        columns[f"wheel_speed_{i}"] = columns[f"wheel_speed_{i}"] * (1.0 + np.sin(2.0 * np.pi * run.time))
    changed = replace(hidden, runs=(replace(run, columns=columns), *hidden.runs[1:]))
    names = {segment.run for segment in steady_runs(changed, robot(), read_floors()).segments}
    assert run.name not in names
    assert len(names) == len(hidden.runs) - 1


def test_blocks_of_a_real_log_have_the_mean_velocity_between_its_first_and_last_pose(tmp_path):
    from omnimj.recording.importing.workflow import ImportConfig, plan_import, write_import
    from omnimj.recording.read_dataset import read_dataset

    folder = unpack("robotino", tmp_path)
    floors = {"table": read_floors()[FLOOR]}
    files = tuple(sorted(folder.glob("table/*.csv")))
    write_import(plan_import(ImportConfig(files, folder / "robotino.mapping.toml")), tmp_path / "set")
    read = read_dataset(tmp_path / "set", floors)
    # its six runs are two too few for a search
    whole = replace(read, runs=(*read.runs, *(replace(r, name=f"{r.name}_again") for r in read.runs)))
    blocks = steady_runs(direction_sectors(whole, robot()), robot(), floors)
    assert len(blocks.segments) == 12
    for segment, measured in zip(blocks.segments[:6], blocks.measured[:6], strict=True):
        run = next(r for r in read.runs if r.name == segment.run)
        last = run.time >= run.time[0] + 1.2
        x, y, heading, time = (run.columns[name][last] for name in ("x", "y", "heading", "time"))
        straight = np.hypot(x[-1] - x[0], y[-1] - y[0]) / (time[-1] - time[0])
        assert np.hypot(*measured[:2]) == pytest.approx(straight, rel=0.02)
        turned = np.unwrap(heading)
        assert measured[2] == pytest.approx((turned[-1] - turned[0]) / (time[-1] - time[0]), abs=0.003)
