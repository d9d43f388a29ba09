"""Runs that a user can make on the rig, to be told which of them would split two rivals."""

from __future__ import annotations

import numpy as np

from omnimj.gap.replay import Experiment, Piece
from omnimj.gap.rig_runs import RigRuns
from omnimj.parameters import Rig
from omnimj.signals import Array

_SECONDS = 2.0
_PROFILES = {
    "constant": "constant current",
    "reversing": "current to and fro, 0.5 s each way",
    "pulse": "0.7 s of current, then coasting at 0 A",
    "crawl": "current rising slowly from 0",
}


def rig_menu(rig: Rig, floors: tuple[str, ...]) -> tuple[Experiment, ...]:
    """Profiles × currents × masses × sideways speeds × floors that the rig has, about a hundred."""
    masses = (rig.rig.masses[0], rig.rig.masses[-1])
    found = []
    for floor in dict.fromkeys((*floors, "natural_stone", "pvc")):
        for profile, words in _PROFILES.items():
            found += [
                _experiment(profile, words, current, mass, 0.0, floor)
                for current in (0.45, 0.9, 1.5)
                for mass in dict.fromkeys(masses)
            ]
        for lateral in (-0.5, -0.2, 0.2, 0.5):
            found.append(_experiment("constant", "constant current", 0.9, masses[0], lateral, floor))
    return tuple(found)


def _experiment(
    profile: str, words: str, current: float, mass: float, lateral: float, floor: str
) -> Experiment:
    text = f"{words}, {current:g} A, {mass:g} kg on {floor.replace('_', ' ')}"
    if lateral:
        text += f", sideways at {lateral:+g} m/s"
    run = {
        "profile": profile,
        "current": current,
        "mass": mass,
        "lateral_speed": lateral,
        "floor": floor,
        "duration": _SECONDS,
    }
    return Experiment(f"{profile}_{current:g}_{mass:g}_{lateral:g}_{floor}", text, run)


def menu_runs(experiment: Experiment, like: RigRuns) -> RigRuns:
    """One run of the menu as if it had been measured; nothing was, so `measured` is NaN."""
    run, period = experiment.run, like.period
    time = np.arange(0.0, float(run["duration"]), period)
    set_value = float(run["current"]) * _shape(str(run["profile"]), time)
    count = len(time) // like.size
    still = np.full(len(time), float(run["lateral_speed"]))
    centres: Array = np.asarray((np.arange(count) + 0.5) * like.size * period, float)
    return RigRuns(
        period,
        np.array([0, len(time)]),
        np.array([0, count]),
        like.size,
        set_value,
        None if like.target is None else set_value,
        still,
        np.zeros((1, 2)),
        np.array([float(run["mass"])]),
        (str(run["floor"]),),
        np.full((count, like.measured.shape[1]), np.nan),
        (Piece(experiment.name, experiment.name, 0, count, centres),),
    )


def _shape(profile: str, time: Array) -> Array:
    """The set value over time, at most 1."""
    if profile == "reversing":
        return np.where(np.floor(time / 0.5) % 2 == 0, 1.0, -1.0)
    if profile == "pulse":
        return np.where(time < 0.7, 1.0, 0.0)
    if profile == "crawl":
        return time / time[-1]
    return np.ones(len(time))
