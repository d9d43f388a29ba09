"""Recordings of healthy machines through the sensor chain, and the same with one thing spoilt."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from omnimj.control.cascade.controller import Controller
from omnimj.parameters import read_floors, read_rig, read_robot
from omnimj.plant.mujoco.twin import RigTwin, RobotTwin
from omnimj.recording.dataset import Dataset, Run
from omnimj.simulate.driving import drive, drive_rig
from omnimj.simulate.machine.drive import declared_values, logged_run, machine_loop, simulated_rows
from omnimj.simulate.machine.linear_axis import as_axis_log, read_axis
from omnimj.simulate.machine.truth import machine_truth
from omnimj.simulate.scenario.drive import read_drive

_RIG = (
    "time",
    "current",
    "current_target",
    "wheel_speed",
    "carriage_speed",
    "carriage_acceleration",
    "lateral_speed",
)


def _dataset(plant, rows):
    runs = tuple(Run(f"run_{k}", columns, {}, conditions) for k, (conditions, columns) in enumerate(rows))
    return Dataset(Path("measured"), plant, runs)


@cache
def rig_steps(seed=0):
    """Steps of current from rest, straight and sideways, three floors."""
    rig, floors = read_rig(), read_floors()
    rows = []
    for k, (floor, current, side) in enumerate(
        [
            ("natural_stone", 0.15, 0.0),
            ("natural_stone", 0.9, 0.0),
            ("pvc", 0.6, 0.0),
            ("pvc", 1.5, 0.0),
            ("paperboard", 1.2, 0.0),
            ("natural_stone", 0.9, -0.5),
            ("natural_stone", 0.9, 0.35),
            ("natural_stone", 0.0, 0.0),
        ]
    ):
        set_currents = np.where(np.arange(1200) < 100, 0.0, current)
        rows.append((floor, _rig_run(rig, floors[floor], set_currents, side, 100 * seed + k)))
    return _dataset("quarter_rig", [({"floor": floor}, columns) for floor, columns in rows])


@cache
def rig_reversals(seed=0):
    """Currents that change their sign, by steps and as a sine."""
    rig, floors = read_rig(), read_floors()
    time = np.arange(2500) * 1e-3
    waves = [(a, p, np.sin(2.0 * np.pi * time / p)) for a, p in ((0.6, 0.8), (1.2, 1.2))]
    set_currents = [a * np.sign(w) for a, _, w in waves] + [a * w for a, _, w in waves]
    rows = [
        ({"floor": "pvc"}, _rig_run(rig, floors["pvc"], current, 0.0, 100 * seed + k))
        for k, current in enumerate(set_currents)
    ]
    return _dataset("quarter_rig", rows)


def _rig_run(rig, floor, set_currents, side, seed):
    columns = drive_rig(RigTwin(rig, floor, lateral_speed=side, seed=seed), set_currents).columns
    found = {name: columns[name] for name in _RIG}
    found["carriage_position"] = np.cumsum(found["carriage_speed"]) * 1e-3
    found["wheel_angle"] = np.cumsum(found["wheel_speed"]) * 1e-3
    return found


@cache
def robot_missions(seed=0):
    """Straight, turning, on a polygon, and standing still."""
    robot, floors = read_robot(), read_floors()
    own = {"kind": "profile", "acceleration": 1.0, "start_time": 0.4}
    turning = own | {
        "speed": 0.6,
        "direction": 0.6,
        "cruise_time": 1.5,
        "yaw_rate": 1.0,
        "yaw_cruise_time": 3.0,
    }
    fast = own | {
        "speed": 0.4,
        "direction": 2.6,
        "cruise_time": 2.0,
        "yaw_rate": -2.5,
        "yaw_cruise_time": 3.0,
    }
    points = {"kind": "waypoints", "points": [[0.0, 0.0], [1.0, 0.5], [0.2, 1.0], [0.0, 0.0]]}
    polygon = points | {"speed": 0.7, "acceleration": 0.8, "start_time": 0.4}
    drives = [(turning, "natural_stone", 6.0), (fast, "pvc", 6.0), (polygon, "natural_stone", 8.0)]
    drives.append(({"kind": "hold"}, "natural_stone", 1.0))
    rows = []
    for k, (table, floor, duration) in enumerate(drives):
        planned = read_drive(table, "drive", duration, 1e-3)
        loops = {"yaw_loop": planned.yaw_loop, "heading_feedback": planned.heading_feedback, "period": 1e-3}
        twin = RobotTwin(robot, floors[floor], seed=100 * seed + k, start=planned.start)
        columns = drive(twin, Controller(robot, heading_hold=False, **loops), planned.reference).columns
        names = [n for n in columns if n.startswith(("current_", "wheel_speed_"))]
        names += ["time", "acceleration_x", "acceleration_y", "yaw_rate", "yaw"]
        rows.append(({"floor": floor}, {n: columns[n] for n in names}))
    return _dataset("uto_robot", rows)


@cache
def axis_runs(seed=0, rate=1000.0, with_velocity=True):
    """Smooth motion of several frequencies, and moves with stops, under position control."""
    axis, rows = read_axis(), []
    loop, truth = machine_loop(axis, 1.0 / rate), machine_truth(axis, declared_values(axis))
    for k in range(3):
        random = np.random.default_rng([seed, k])
        time = np.arange(int(5.0 * rate) + 1) / rate
        if k < 2:
            waves = [
                0.025 / f * np.sin(2.0 * np.pi * f * time + random.uniform(0.0, 6.0))
                for f in (0.3, 0.7, 1.3, 2.1)
            ]
            place = np.sum(waves, axis=0) * np.minimum(1.0, time / 0.5) ** 2
        else:
            stops = np.repeat(np.concatenate([[0.0], random.uniform(-0.15, 0.15, 6)]), 2)
            window = np.hanning(int(0.2 * rate) | 1)
            raw = np.interp(time, np.linspace(0.0, 5.0, len(stops)), stops)
            place = np.convolve(np.pad(raw, len(window) // 2, mode="edge"), window / window.sum(), "valid")
        plan = loop.follow(np.asarray(place, float)[:, None])
        log = logged_run("", truth, simulated_rows(truth, loop.loop, plan), 10 * seed + k, loop.period, True)
        names = ("time", "force", "position", "velocity")[: 4 if with_velocity else 3]
        rows.append(({}, {n: as_axis_log(log).columns[n] for n in names}))
    return _dataset("linear_axis", rows)


def spoilt(dataset, change):
    """The same with `change(columns)` done to fresh columns of every run."""
    runs = tuple(
        replace(run, columns=change({n: np.array(v) for n, v in run.columns.items()})) for run in dataset.runs
    )
    return replace(dataset, runs=runs)


def both(*changes):
    def change(c):
        for one in changes:
            c = one(c)
        return c

    return change


def scaled(names, factor):
    names = (names,) if isinstance(names, str) else names
    return lambda c: c | {name: c[name] * factor for name in names}


def without(name):
    return lambda c: {n: v for n, v in c.items() if n != name}


def at_rate_over(number):
    """Every n-th sample, as a slower logger records it."""
    return lambda c: {name: values[::number] for name, values in c.items()}


def with_time_of_all_samples(number):
    """Every n-th sample, with the times of the first ones: a logger that counts rows."""
    return lambda c: {n: v[: len(v[::number])] if n == "time" else v[::number] for n, v in c.items()}


def with_stale_rows(samples):
    def change(c):
        k = int(0.4 * len(c["time"]))
        for name, values in c.items():
            if name != "time":
                values[k : k + samples] = values[k]
        return c

    return change


def shifted(name, offset):
    return lambda c: c | {name: c[name] + offset}


def late(name, delay):
    return lambda c: (
        c | {name: np.interp(c["time"] - delay, c["time"], np.unwrap(c[name]) if name == "yaw" else c[name])}
    )


def swapped(first, second):
    return lambda c: c | {first: c[second], second: c[first]}


def frozen(name, samples):
    def change(c):
        k = int(0.4 * len(c["time"]))
        c[name][k : k + samples] = c[name][k]
        return c

    return change


def cut_off(name, level):
    return lambda c: c | {name: np.clip(c[name], -level, level)}


def counted(name, modulus):
    return lambda c: c | {name: np.mod(c[name], modulus)}


def with_bursts(name, size):
    def change(c):
        for k in range(50, len(c["time"]) - 50, 300):
            c[name][k : k + 2] += size
        return c

    return change


def with_repeated_rows(every):
    def change(c):
        k = np.arange(len(c["time"]))
        taken = np.where(k % every == every - 1, k - 1, k)
        return {name: values if name == "time" else values[taken] for name, values in c.items()}

    return change
