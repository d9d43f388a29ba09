"""Files of an identified robot: `identification.json`, `floors.toml`, and the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import omnimj
from omnimj.estimate.robot.records import (
    FloorCreep,
    RobotEstimate,
    RobotIdentification,
    Unexcited,
)
from omnimj.estimate.robot.uncertainty import LEVEL
from omnimj.parameters.floor import FLOOR_UNITS, Floor, format_floor, printable_line
from omnimj.recording.json_files import rounded_values
from omnimj.signals import Array

MODEL_FILE, FLOORS_FILE, THRESHOLDS_FILE = "model.toml", "floors.toml", "thresholds.toml"
JSON_FILE, REPORT_FILE = "identification.json", "report.md"
ROBOT_FILES = (MODEL_FILE, FLOORS_FILE, THRESHOLDS_FILE, JSON_FILE, REPORT_FILE)
_FAST = 1e-3  # [m] way over which a bristle of an identified floor stretches: below what the logs resolve
_SPEED = 0.5  # [m/s] rolling speed at which the covered slip is taken as a creep ratio
_MOST_GRIP = 1.0  # traction over load in full sliding where the logs do not show it
_RELAXATION, _DAMPING = 0.02, 0.005  # [m, s] of a law by creep ratio: those of the shipped floors


def identification_content(found: RobotIdentification, command: str = "") -> dict[str, Any]:
    """Content of `identification.json`."""
    names = ("acceleration_x", "acceleration_y", "yaw_acceleration")
    content = {
        "dataset": str(found.dataset),
        "model": str(found.robot.file),
        "omnimj": omnimj.__version__,
        "command": command,
        "confidence": LEVEL,
        "runs": found.runs,
        "seconds": found.seconds,
        "notes": found.notes,
        "parameters": {one.name: _estimate(one) for one in found.estimates},
        "not_excited": [_unexcited(one) for one in found.unexcited],
        "sensors": found.noise,
        "misfit": dict(zip(names, found.residual.tolist(), strict=True)),
        "floors": {one.floor: _creep(one) for one in found.floors},
        "without_creep": found.without_creep,
    }
    return rounded_values(content)


def _estimate(one: RobotEstimate) -> dict[str, Any]:
    names = ("value", "low", "high", "unit", "nominal", "source", "words")
    return {name: getattr(one, name) for name in names} | {"deviation_over_prior": one.left_of_prior}


def _unexcited(one: Unexcited) -> dict[str, Any]:
    return {
        "parameter": one.estimate.name,
        "deviation_over_prior": one.estimate.left_of_prior,
        "manoeuvre": one.manoeuvre or None,
        "deviation_after": one.left_after,
    }


def _creep(one: FloorCreep) -> dict[str, Any]:
    parameters = {}
    for name, value in one.chosen.numbers.items():
        low, high = one.intervals[name]
        parameters[name] = {"value": value, "low": low, "high": high}
    return {
        "form": one.chosen.name,
        "parameters": parameters,
        "forms": {f.name: {"held_out_rms": f.held_out, "parameters": f.numbers} for f in one.forms},
        "slip_range": [0.0, one.covered],
        "moves": one.moves,
        "runs": one.runs,
    }


def floors_text(found: RobotIdentification) -> str:
    """Content of `floors.toml`: one entry per floor with an identified creep law; may hold comments only."""
    head = (
        f"# Floors identified from {printable_line(str(found.dataset))} by omnimj {omnimj.__version__}.\n"
        f"{FLOOR_UNITS} Forms and intervals in {JSON_FILE}.\n"
    )
    lines = [f"# {printable_line(words)}" for words in found.without_creep]
    return "\n".join([head, *lines, *(format_floor(*as_floor(floor)) for floor in found.floors)])


def as_floor(creep: FloorCreep) -> tuple[Floor, tuple[str, ...]]:
    """A creep law as a floor of `floors.toml`, and remarks on it.

    LuGre in steady sliding is F/F_N = g + σ2 v with a stiff bristle. A slope that is the same at every slip
    is all σ2 and a level that hardly counts; one that falls with slip is a level g reached within the slip
    that the logs cover. A law of the creep ratio is the brush curve nearest to it over the same range.
    """
    form, numbers = creep.chosen, creep.chosen.numbers
    remarks = [f"form that fits held-out runs best: {form.name}"]
    if form.name.startswith("creep ratio"):
        law, written = "creep_ratio", _brush(numbers, creep.covered / _SPEED)
        if written["mu"] >= _MOST_GRIP:
            remarks.append(f"full sliding lies beyond the logs; mu = {_MOST_GRIP:g} is assumed")
    else:
        law, level = "lugre", max(numbers.get("ceiling", 0.0), 1e-3)
        written = {"mu_c": level, "mu_s": level, "V_s": 1.0, "sigma_0": level / _FAST, "sigma_1": 0.0}
        written["sigma_2"] = numbers["slope"]
    low, high = creep.intervals["slope"]
    doubt = min(max(0.5 * (high - low) / numbers["slope"], 0.01), 1.0)
    drives = f"{creep.moves} drives in {len(creep.runs)} runs"
    source = f"identified: {drives}, slip to {creep.covered:.3g} m/s"
    name = creep.floor
    return Floor(name, name.replace("_", " "), law, source, written, doubt), tuple(remarks)


def _brush(numbers: Mapping[str, float], covered: float) -> dict[str, float]:
    """Brush law μ [1 − (1 − ξ/ξ_s)³], ξ_s = 3 μ/C, nearest to c tanh(ξ/ξ₀) + σ ξ up to a creep ratio."""
    slope, ceiling, onset = numbers["slope"], numbers.get("ceiling", 0.0), numbers.get("onset", 1.0)
    creep = np.linspace(0.0, covered, 50)[1:]
    wanted = ceiling * np.tanh(creep / onset) + slope * creep
    steepest = slope + ceiling / onset

    def error(x: Array) -> Array:
        mu, stiffness = np.exp(x)
        sliding = np.minimum(creep * stiffness / (3.0 * mu), 1.0)
        return mu * sliding * (3.0 + sliding * (sliding - 3.0)) / wanted[-1] - wanted / wanted[-1]

    start = np.log([min(2.0 * wanted[-1], 0.5 * _MOST_GRIP), steepest])
    bounds = ([-np.inf, np.log(0.1 * steepest)], [np.log(_MOST_GRIP), np.log(10.0 * steepest)])
    mu, stiffness = np.exp(least_squares(error, start, bounds=bounds).x).tolist()
    if mu > 0.99 * _MOST_GRIP:
        mu = _MOST_GRIP
    length = {"relaxation_length": _RELAXATION, "damping_time": _DAMPING}
    return {"mu": mu, "creep_stiffness": stiffness, **length}


def report_text(found: RobotIdentification, command: str, thresholds: Sequence[str] = ()) -> str:
    """Content of `report.md`."""
    lines = [f"# Robot identified from {found.dataset.name}", "", *summary(found), ""]
    for title, names in _groups(found).items():
        lines += [f"## {title}", "", *_table([found[name] for name in names]), ""]
    lines += ["## What the drive did not excite", "", *excitation_lines(found), ""]
    lines += ["## Creep on the floors", "", *creep_lines(found), ""]
    if thresholds:
        lines += ["## Thresholds", "", *(f"- {words}" for words in thresholds), ""]
    return "\n".join([*lines, "## Command", "", "```", command, "```", ""])


def summary(found: RobotIdentification) -> list[str]:
    """Sentences on what the data determine and what the prior does."""
    k, mass, ratio = found["torque_constant"], found["mass"], found["mass_ratio"]
    lines = [
        f"{len(found.runs)} runs, {found.seconds:.4g} s; unexplained acceleration "
        f"{found.residual[0]:.2g}, {found.residual[1]:.2g} m/s² and {found.residual[2]:.2g} rad/s² RMS.",
        "Data determine ratios of masses, torques and losses: mass over traction per ampere "
        f"{ratio.value:.4g} kg.A/N ({ratio.low:.4g} … {ratio.high:.4g}).",
        f"Their common size rests on the model file's torque constant: {k.value:.4g} N.m/A "
        f"({k.low:.4g} … {k.high:.4g}), and with it the mass of {mass.value:.4g} kg "
        f"({mass.low:.4g} … {mass.high:.4g}). "
        "Weigh the robot and state `mass` under [defaults] of dataset.toml to fix it.",
    ]
    return [*(f"Note: {note}" for note in found.notes), *lines]


def excitation_lines(found: RobotIdentification) -> list[str]:
    """One line per number that the drive did not excite."""
    lines = []
    for one in found.unexcited:
        left = f"{one.estimate.words}: the data leave {one.estimate.left_of_prior:.0%} of its prior deviation"
        if one.manoeuvre:
            lines.append(f"- {left}; {one.manoeuvre} ten times: {one.left_after:.0%}")
        else:
            lines.append(f"- {left}, and no manoeuvre narrows it much: only a measurement of its own does")
    return lines or ["Everything was excited."]


def creep_lines(found: RobotIdentification) -> list[str]:
    """Sentences on the creep law of each floor."""
    lines = [f"- {words}" for words in found.without_creep]
    for one in found.floors:
        ends = {name: "{:.4g} … {:.4g}".format(*pair) for name, pair in one.intervals.items()}
        numbers = ", ".join(
            f"{name} {value:.4g} ({ends[name]})" for name, value in one.chosen.numbers.items()
        )
        lines.append(f"- {one.floor.replace('_', ' ')}: {one.chosen.name}; {numbers}; {one.moves} drives")
        others = ", ".join(f"{form.name} {1000 * form.held_out:.3g} mm/s" for form in one.forms)
        lines.append(f"  - RMS error of the slip in held-out runs: {others}")
    return lines or ["No floor."]


def _groups(found: RobotIdentification) -> Mapping[str, list[str]]:
    names = [one.name for one in found.estimates]
    wheels = [n for n in names if n.startswith(("torque_ratio_", "dry_loss_", "viscous_loss_", "loss_"))]
    motors = [n for n in names if n.startswith("torque_constant") or n == "back_driving_efficiency"]
    of_sensors = ("current_offset", "accelerometer")
    sensors = [n for n in names if n.startswith(of_sensors) or n.endswith("_delay")]
    rest = [n for n in names if n not in (*wheels, *motors, *sensors)]
    return {"Motors": motors, "Wheels": wheels, "Body and rollers": rest, "Sensors": sensors}


def _table(estimates: Sequence[RobotEstimate]) -> list[str]:
    lines = ["| | value | 90 % interval | model file before | determined by |", "|---|---|---|---|---|"]
    for one in estimates:
        unit = "" if one.unit == "1" else f" {one.unit}"
        lines.append(
            f"| {one.words} | {one.value:.4g}{unit} | {one.low:.4g} … {one.high:.4g} | {one.nominal:.4g} | "
            f"{one.source} |"
        )
    return lines
