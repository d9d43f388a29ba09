"""The gap run by run: which runs carry it, which of the held-out ones to look at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.gap.records import Finding, Overlay
from omnimj.signals import Array


@dataclass(frozen=True)
class RunGap:
    """Mismatch of one run before and after, RMS."""

    run: str
    heldout: bool
    """Whether it, or a part of it, was held out."""
    partly: bool
    """Whether only some of its windows were held out."""
    conditions: Mapping[str, float | str]
    before: Mapping[str, float]
    """Channel → RMS [unit of the channel]."""
    after: Mapping[str, float] | None
    total_before: float
    """RMS over all channels in units of their noise."""
    total_after: float | None


def has_after(finding: Finding) -> bool:
    """Whether there is a second model to compare with."""
    gaps = [*finding.heldout.values(), *finding.train.values()]
    return any(gap.after is not None for gap in gaps)


def noise_row(finding: Finding) -> Array:
    """Noise of a block mean in the order of the channels, shape (channels,); 1 where none is known."""
    row = np.array([finding.noise.get(name, np.nan) for name in finding.channels], float)
    return np.where(np.isfinite(row) & (row > 0.0), row, 1.0)


def runs_of(finding: Finding) -> dict[str, list[Overlay]]:
    """The overlays by run, windows of one run in the order of time."""
    runs: dict[str, list[Overlay]] = {}
    for overlay in finding.overlays:
        runs.setdefault(overlay.run, []).append(overlay)
    return {run: sorted(windows, key=lambda o: float(o.time[0])) for run, windows in runs.items()}


def run_gaps(finding: Finding) -> tuple[RunGap, ...]:
    """Every run that has an overlay, the largest mismatch in units of noise first."""
    second = has_after(finding)
    found = [_of_run(finding, run, windows, second) for run, windows in runs_of(finding).items()]
    return tuple(sorted(found, key=lambda gap: -gap.total_before))


def worst_run(finding: Finding) -> str | None:
    """The held-out run with the largest mismatch before; a training run where none is held out."""
    gaps = _worth_showing(finding)
    return gaps[0].run if gaps else None


def typical_run(finding: Finding) -> str | None:
    """The held-out run in the middle of their order; None when that is the worst one too."""
    gaps = _worth_showing(finding)
    return gaps[len(gaps) // 2].run if len(gaps) > 1 else None


def _worth_showing(finding: Finding) -> list[RunGap]:
    gaps = list(run_gaps(finding))
    return [gap for gap in gaps if gap.heldout] or gaps


def _of_run(finding: Finding, run: str, windows: Sequence[Overlay], second: bool) -> RunGap:
    noise = noise_row(finding)
    before = rms(np.concatenate([w.measured - w.before for w in windows]))
    after = rms(np.concatenate([w.measured - w.after for w in windows])) if second else None
    names = list(finding.channels)
    return RunGap(
        run,
        any(window.heldout for window in windows),
        len({window.heldout for window in windows}) == 2,
        windows[0].conditions,
        dict(zip(names, before.tolist(), strict=True)),
        None if after is None else dict(zip(names, after.tolist(), strict=True)),
        _total(before / noise),
        None if after is None else _total(after / noise),
    )


def rms(mismatch: Array) -> Array:
    """√(mean of squares) of every channel over the blocks that are not masked, NaN where all are.

    Args:
      mismatch: Shape (blocks, channels).
    """
    known = np.isfinite(mismatch)
    squares = np.where(known, mismatch, 0.0) ** 2
    with np.errstate(invalid="ignore"):
        return np.sqrt(squares.sum(axis=0) / known.sum(axis=0))


def _total(in_noise: Array) -> float:
    return float(rms(in_noise[np.isfinite(in_noise)][:, None])[0])
