"""Parts of the runs in which no bodies touch and no joint is at its stop: forces there are not measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnimj.errors import InputError
from omnimj.plant.mujoco.machine import Machine
from omnimj.recording.dataset import Run
from omnimj.signals import Array

_AROUND = 0.1  # [s] before and after a contact, more than a filter reaches
_SAMPLES = 3  # fewest samples before and after
_CHECKED = 20_000  # places of each run at which contacts are looked for
_FEWEST = 50  # rows of a run
RULE = (
    "the force between them is in no log; lift what touches, or set contype and conaffinity to 0 where the "
    "contact carries nothing"
)
STOP_RULE = "the force of a stop is in no log; keep away from it, or widen the joint's range if there is none"


@dataclass(frozen=True)
class Touch:
    """First contact of a run in words, and the rows in which there is one."""

    words: str
    rule: str
    rows: NDArray[np.bool_]
    """Shape (n,)."""


def free_runs(runs: Sequence[Run], machine: Machine, place: Path) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Leave out the rows in which bodies touch or a joint is beyond its range, with 0.1 s on either side.

    Args:
      runs: Runs with the positions of all joints.

    Returns:
      Runs with the other rows, those without any left out; notes on what was left out.

    Raises:
      InputError: No run has enough rows without contact; the message names the first contact.
    """
    kept, notes, worst = [], [], None
    for run in runs:
        touch = _find_touch(run, machine)
        if touch is None:
            kept.append(run)
            continue
        free = ~_widened(touch.rows, run.time)
        worst = worst or (run.name, touch)
        share = 1.0 - float(free.mean())
        if free.sum() >= _FEWEST:
            kept.append(_with_rows(run, free))
        else:
            share = 1.0
        notes.append(f"run {run.name}: {touch.words}; {100.0 * share:.0f} % of it is left out")
    if worst is not None and not kept:
        name, touch = worst
        raise InputError(f"{place}: run {name!r}", f"{touch.words}, as in all runs", touch.rule)
    return tuple(kept), tuple(notes)


def _with_rows(run: Run, rows: NDArray[np.bool_]) -> Run:
    columns = {name: np.asarray(values)[rows] for name, values in run.columns.items()}
    masked = {name: np.asarray(mask)[rows] for name, mask in run.masked.items()}
    return replace(run, columns=columns, masked=masked)


def _widened(rows: NDArray[np.bool_], time: Array) -> NDArray[np.bool_]:
    around = max(_AROUND, _SAMPLES * float(np.median(np.diff(time))))
    touched = time[rows]
    after = np.searchsorted(touched, time - around)
    return after < np.searchsorted(touched, time + around, side="right")


def _find_touch(run: Run, machine: Machine) -> Touch | None:
    """Contacts and stops along the measured motion of a run."""
    places = np.column_stack([run.columns[f"position:{name}"] for name in machine.joints])
    known: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(places), axis=1)
    for name in machine.joints:
        known = known & ~np.asarray(run.masked.get(f"position:{name}", np.zeros(len(places), bool)))
    stopped, words = _stops(places, known, machine)
    rows, pair = _contacts(places, known, machine)
    if rows.any():
        first = float(run.time[int(np.argmax(rows))])
        return Touch(f"{pair} touch at {first:.4g} s", RULE, rows | stopped)
    if stopped.any():
        first = float(run.time[int(np.argmax(stopped))])
        return Touch(f"{words} at {first:.4g} s", STOP_RULE, stopped)
    return None


def _stops(places: Array, known: NDArray[np.bool_], machine: Machine) -> tuple[NDArray[np.bool_], str]:
    m, found, words = machine.mj_model, np.zeros(len(places), bool), ""
    for j, name in enumerate(machine.joints):
        if m.jnt_limited[j]:
            low, high = m.jnt_range[j]
            beyond = known & ((places[:, j] < low) | (places[:, j] > high))
            if beyond.any() and not words:
                words = f"joint {name!r} is beyond its range, {low:.4g} to {high:.4g},"
            found |= beyond
    return found, words


def _contacts(places: Array, known: NDArray[np.bool_], machine: Machine) -> tuple[NDArray[np.bool_], str]:
    """Rows in which geoms touch, and the first pair in words."""
    m, found, words = machine.mj_model, np.zeros(len(places), bool), ""
    if not (m.geom_contype[:, None] & m.geom_conaffinity[None, :]).any() and not m.npair:
        return found, words
    mj_data = mujoco.MjData(m)
    every = max(1, -(-len(places) // _CHECKED))
    for k in range(0, len(places), every):
        if not known[k]:
            continue
        mj_data.qpos[:] = places[k]
        mujoco.mj_kinematics(m, mj_data)
        mujoco.mj_comPos(m, mj_data)
        mujoco.mj_collision(m, mj_data)
        touching = [c for c in mj_data.contact[: mj_data.ncon] if c.dist < 0.0]
        if touching:
            found[k : k + every] = True
            words = words or _pair(m, touching[0])
    return found, words


def _pair(m: mujoco.MjModel, contact) -> str:
    names = [
        mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_GEOM, g) or f"geom {g}"
        for g in (contact.geom1, contact.geom2)
    ]
    return f"{names[0]!r} and {names[1]!r}"
