"""Faults of slow loggers in runs with a measured pose: repeated readings, and currents without their sign."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omnimj.recording.dataset import Run
from omnimj.recording.mask import Mask
from omnimj.signals import Array, true_stretches

_USUAL = 0.95  # quantile of the repetitions of a reading that is usual …
_LONGER = 3.0  # … and × that, what is not
_BURST = 0.2  # × the mean time step: a sample of the same burst
_BURSTS = 0.1  # share of such samples from which on the log has bursts
_SIDE = 0.05  # share of the samples in motion that must lie on each side of zero
_MOVING = 0.1  # × the largest speed: in motion


def find_repeats(columns: Sequence[Array], moving: Mask) -> Mask:
    """Find rows in which a group of readings was not updated, though the machine moved.

    A row repeats when no reading of the group differs from the row before. Where that is rare, every such row
    counts; where the readings are usually slower than the log, only stretches far above the usual one do.

    Args:
      columns: Readings that come in one message, each shape (n,).
      moving: Whether the machine moves, shape (n,).

    Returns:
      Mask of the repeated rows, shape (n,).
    """
    same = np.ones(len(moving), dtype=bool)
    for values in columns:
        same[1:] &= np.diff(values) == 0.0
    same[:1] = False
    same &= moving
    stretches = true_stretches(same)
    if not len(stretches):
        return same
    lengths = stretches[:, 1] - stretches[:, 0]
    updated = np.count_nonzero(moving & ~same)  # most of them are followed by no repeated row
    each = np.concatenate((np.zeros(max(updated - len(lengths), 0)), lengths))
    allowed = _LONGER * np.quantile(each, _USUAL, method="lower")
    mask = np.zeros(len(moving), dtype=bool)
    for first, last in stretches[lengths > allowed]:
        mask[first:last] = True
    return mask


def burst_share(time: Array) -> float:
    """Share of the samples that follow the one before far sooner than on average, as those of a burst do.

    Args:
      time: Strictly increasing times, shape (n,) [s].
    """
    steps = np.diff(time)
    return float(np.mean(steps < _BURST * steps.mean())) if len(steps) else 0.0


def has_bursts(time: Array) -> bool:
    """True if samples arrive in bursts, so that their times are those of arrival.

    Args:
      time: Strictly increasing times, shape (n,) [s].
    """
    return burst_share(time) > _BURSTS


def with_edges(mask: Mask) -> Mask:
    """Mask with the neighbours of masked samples, shape (n,): the next one may cover the whole pause."""
    wider = mask.copy()
    wider[1:] |= mask[:-1]
    wider[:-1] |= mask[1:]
    return wider


def wheel_numbers(run: Run) -> list[int]:
    """Numbers of the wheels with both a current and a speed."""
    numbers = [name.removeprefix("wheel_speed_") for name in run.columns if name.startswith("wheel_speed_")]
    return sorted(int(n) for n in numbers if n.isdigit() and f"current_{n}" in run.columns)


def mask_logger_faults(runs: Sequence[Run]) -> tuple[list[dict[str, Mask]], list[str]]:
    """Mask what a slow logger did not measure, in robot runs with a measured pose.

    Returns:
      Masks by column for each run, shape (samples of the run,) each, and one note per fault.
    """
    found: list[dict[str, Mask]] = [{} for _ in runs]
    notes = []
    for run, own in zip(runs, found, strict=True):
        notes += _mask_repeats(run, own)
        if has_bursts(run.time):
            share = f"{burst_share(run.time):.0%} of the samples"
            notes.append(f"run {run.name}: {share} arrive in bursts; their times are those of arrival")
    for number in sorted({n for run in runs for n in wheel_numbers(run)}):
        notes += _mask_magnitudes(runs, found, number)
    return found, notes


def _mask_repeats(run: Run, own: dict[str, Mask]) -> list[str]:
    wheels = wheel_numbers(run)
    drive = [f"{kind}_{n}" for kind in ("current", "wheel_speed") for n in wheels]
    pose = [name for name in ("x", "y", "heading") if name in run.columns]
    speeds = [np.abs(run.columns[f"wheel_speed_{n}"]) for n in wheels]
    moving = np.any([s > 0.0 for s in speeds], axis=0) if speeds else np.zeros(len(run.time), dtype=bool)
    fast = np.any([s > _MOVING * s.max() for s in speeds if s.max() > 0.0] or [moving], axis=0)
    notes = []
    for words, names, when in (("currents and wheel speeds", drive, moving), ("the pose", pose, fast)):
        mask = find_repeats([run.columns[name] for name in names], when)
        if not names or not mask.any():
            continue
        own.update({name: own.get(name, False) | with_edges(mask) for name in names})
        notes.append(_repeat_note(run, words, mask))
    return notes


def _repeat_note(run: Run, words: str, mask: Mask) -> str:
    stretches = true_stretches(mask)
    first, last = max(stretches, key=lambda s: run.time[s[1] - 1] - run.time[s[0] - 1])
    size = run.time[last - 1] - run.time[first - 1]
    rows = int(mask.sum())
    many = f"{rows} rows repeat" if rows > 1 else "a row repeats"
    return (
        f"run {run.name}: {many} {words} of the row before in motion, for up to {size:.3g} s "
        f"from {run.time[first - 1]:.6g} s, masked with {'their' if rows > 1 else 'its'} neighbours"
    )


def is_magnitude(values: Sequence[Array], speeds: Sequence[Array]) -> bool:
    """True if a reading is never negative although the speed that goes with it changes its sign.

    Args:
      values: Readings by run, each shape (n,).
      speeds: Speeds of the same motor by run, each shape (n,).
    """
    if not len(values) or min(float(v.min()) for v in values) < 0.0:
        return False
    speed = np.concatenate(speeds)
    fast = speed[np.abs(speed) > _MOVING * float(np.abs(speed).max())]
    sides = np.count_nonzero(fast > 0.0), np.count_nonzero(fast < 0.0)
    return max(float(v.max()) for v in values) > 0.0 and bool(min(sides) > max(_SIDE * len(fast), 3))


def _mask_magnitudes(runs: Sequence[Run], found: list[dict[str, Mask]], number: int) -> list[str]:
    name, speed = f"current_{number}", f"wheel_speed_{number}"
    having = [k for k, run in enumerate(runs) if name in run.columns and speed in run.columns]
    values = [runs[k].columns[name] for k in having]
    if not is_magnitude(values, [runs[k].columns[speed] for k in having]):
        return []
    for k in having:
        backwards = runs[k].columns[speed] < 0.0
        if backwards.any():
            found[k][name] = found[k].get(name, False) | backwards
    return [
        f"{name} is never negative though {speed} changes its sign: a magnitude; masked where the wheel "
        "turns backwards (omnimj import can restore the sign)"
    ]
