"""Defects visible in a single column: frozen, clipped, glitches, repeated rows, biases at rest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.gap.check.suspicions import Suspicion
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array, equal_stretches, true_stretches

_LIVELY = 0.5  # share of samples that differ from the one before, in a channel with visible noise
_LONGER = 8.0  # times the usual constant stretch of the channel
_FROZEN_TIME = 0.03  # [s]
_CLIPPED_SHARE = 0.01
_CLIPPED_PAUSE = 6  # samples at the same end value, in a channel with visible noise
_GLITCH = 15.0  # times the scatter about the median of neighbours
_GLITCH_SIZE = 0.2  # smallest glitch as a share of the channel's range
_GLITCHES = 3  # number of glitches in a dataset from which on they are reported
_LEAP = 4.0  # smallest step out of a frozen stretch, in usual steps
_JUMP = 20.0  # smallest jump of a counter, in largest usual steps
_FALL = 0.85  # smallest jump of a counter as a share of its range
_REPEATED = 0.005  # permitted share of repeated rows
_STALE = 3.0  # times the longest stretch of equal rows that noise leaves by chance
_FEWEST_STALE = 10  # rows
_NEAR = 21  # rows about one
_RARELY = 0.3  # share of these in which a column at rest changes by more than its resolution
_REST = 0.05  # [s] that a rest lasts at least
_STILL = 0.02  # largest speed at rest as a share of the top speed
_RUN_BIAS = 0.02  # [m/s²] of a healthy accelerometer, drawn anew in every run
_ACCELERATION_BIAS = 0.05  # [m/s²]
_CURRENT_BIAS = 0.015  # [A]
SLOPE = 1.9
"""Upper limit of the strength of a bias that a sloping floor would explain as well; below `SURE_STRENGTH`."""


def fill_masked(run: Run, name: str) -> Array:
    """Bridge the masked samples of a column by straight lines, shape (n,)."""
    values = np.asarray(run.columns[name], float)
    bad = ~np.isfinite(values)
    if name in run.masked:
        bad = bad | run.masked[name]
    if not bad.any() or bad.all():
        return values
    return np.interp(run.time, run.time[~bad], values[~bad])


def _is_place(name: str) -> bool:
    """True for `position`, and for `position:JOINT` of any machine."""
    return name.partition(":")[0].endswith("position")


def moving_mask(run: Run, names: Sequence[str]) -> NDArray[np.bool_]:
    """Mask of samples in motion: some speed, or change of a position, exceeds a twentieth of its largest.

    Returns:
      Shape (n,).
    """
    found = np.zeros(len(run.time), bool)
    for name in names:
        if name in run.columns:
            values = fill_masked(run, name)
            if _is_place(name):
                span = min(21, len(values) // 2 * 2 - 1)
                near = np.pad(values, span // 2, mode="edge")
                values = near[span - 1 :] - near[: len(values)]
            size = np.abs(values)
            found |= size > 0.05 * max(float(size.max()), 1e-12)
    return found


def column_suspicions(
    dataset: Dataset, names: Sequence[str], speeds: Sequence[str], counters: Sequence[str]
) -> Iterator[Suspicion]:
    """Check every channel by itself.

    Args:
      names: Channels in which sensor noise is always visible.
      speeds: Channels that show whether the machine moves.
      counters: Positions and angles, which may jump.
    """
    stale = list(_stale(dataset.runs))
    yield from stale
    for name in names:
        runs = [run for run in dataset.runs if name in run.columns]
        if not runs:
            continue
        wraps = list(_wraps(runs, name)) if name in counters else []
        if wraps:
            yield from wraps
            continue
        yield from _constant(runs, name, speeds)
        yield from (s for s in _frozen(runs, name, speeds) if not _is_within(s, stale))
        yield from _clipped(runs, name)
        yield from _glitches(runs, name)
    yield from (s for s in _repeated(dataset.runs, speeds) if not _is_within(s, stale))


def _is_within(found: Suspicion, stale: Sequence[Suspicion]) -> bool:
    """True if stale rows also explain a frozen channel or repeated rows."""
    return any(found.size <= s.size and set(found.runs) <= set(s.runs) for s in stale)


def constant_stretches(values: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First samples and lengths, shape (stretches,) each, of equal values in a channel, shape (n,)."""
    starts = equal_stretches(values)
    return starts, np.diff(np.concatenate([starts, [len(values)]]))


def _constant(runs: Sequence[Run], name: str, speeds: Sequence[str]) -> Iterator[Suspicion]:
    others = [s for s in speeds if s != name]
    if any(np.ptp(run.columns[name]) > 0.0 for run in runs):
        return
    if any(moving_mask(run, others).mean() > 0.2 and _moves(run, others) for run in runs):
        words = f"{name} never changes in any run, though the machine moves"
        yield Suspicion(name, "frozen", float(sum(len(r.time) for r in runs)), 5.0, words)


def _moves(run: Run, names: Sequence[str]) -> bool:
    return any(name in run.columns and np.ptp(run.columns[name]) > 0.0 for name in names)


def _frozen(runs: Sequence[Run], name: str, speeds: Sequence[str]) -> Iterator[Suspicion]:
    """Find the longest stretch of equal values in a channel that otherwise changes during motion."""
    worst, words, longest, touched = 0.0, "", 0, []
    for run in runs:
        values = np.asarray(run.columns[name], float)
        starts, lengths = constant_stretches(values)
        moves = moving_mask(run, speeds)
        if name in run.masked:
            moves &= ~np.asarray(run.masked[name])
        before = np.concatenate([[0], np.cumsum(moves)])
        used = (before[starts + lengths] - before[starts]) >= 0.5 * lengths
        if np.count_nonzero(used) < 3:
            continue
        starts, lengths = starts[used], lengths[used]
        k = int(lengths.argmax())
        usual = np.delete(lengths, k)[np.delete(values[starts], k) != 0.0]
        step = float(np.median(np.diff(run.time)))
        if len(usual) <= _LIVELY * usual.sum():
            continue
        allowed = max(_LONGER * float(np.quantile(usual, 0.99)), _FROZEN_TIME / step, 10.0)
        part = slice(int(starts[k]), int(starts[k] + lengths[k]))
        if lengths[k] <= allowed or not _is_stuck(values, part, name):
            continue
        touched.append(run.name)
        if lengths[k] / allowed > worst:
            worst, longest = float(lengths[k] / allowed), int(lengths[k])
            at = f"{run.time[part.start]:.3f} to {run.time[part.stop - 1]:.3f} s"
            words = f"{name} is frozen at {values[part.start]:.4g} from {at} of {run.name}"
    if touched:
        words += f", likewise in {len(touched) - 1} more runs" if len(touched) > 1 else ""
        yield Suspicion(name, "frozen", float(longest), worst, words, (), tuple(touched))


def _is_stuck(values: Array, part: slice, name: str) -> bool:
    """Test whether equal values are neither a counter at rest nor a channel at the end of its range."""
    value = float(values[part.start])
    if value == 0.0 or _is_place(name):
        return _leaps(values, part)
    return value not in (float(np.max(values)), float(np.min(values)))


def _leaps(values: Array, part: slice) -> bool:
    """Test whether a channel enters or leaves a stretch by a step far beyond its usual ones."""
    steps = np.abs(np.diff(values))
    usual = float(np.median(steps[steps > 0.0]))
    ends = [steps[k] for k in (part.start - 1, part.stop - 1) if 0 <= k < len(steps)]
    return bool(max(ends, default=0.0) > max(_LEAP * usual, 0.03 * float(np.ptp(values))))


def _clipped(runs: Sequence[Run], name: str) -> Iterator[Suspicion]:
    every = np.concatenate([np.asarray(run.columns[name], float) for run in runs])
    for end, side in ((every.max(), "above"), (every.min(), "below")):
        hits, longest, touched = 0, 0, []
        lively = rest = 0
        for run in runs:
            values = np.asarray(run.columns[name], float)
            starts, lengths = constant_stretches(values)
            at_end = values[starts] == end
            lively += int(np.count_nonzero(~at_end & (values[starts] != 0.0)))
            rest += int(np.count_nonzero((values != end) & (values != 0.0)))
            if at_end.any():
                hits += int(lengths[at_end].sum())
                longest = max(longest, int(lengths[at_end].max()))
                touched.append(run.name)
        if rest < 20 or lively < _LIVELY * rest or end == 0.0:
            continue
        strength = min(hits / max(_CLIPPED_SHARE * len(every), 10.0), longest / _CLIPPED_PAUSE)
        if strength >= 1.0:
            words = f"{name} is cut off {side} {end:.4g}: {hits} samples, up to {longest} in a row"
            yield Suspicion(name, "clipping", float(end), float(strength), words, (), tuple(touched))


def _glitches(runs: Sequence[Run], name: str) -> Iterator[Suspicion]:
    """Find bursts of up to four samples after which the channel continues as before."""
    count, worst, touched = 0, 0.0, []
    reach = max(float(np.ptp(np.quantile(fill_masked(run, name), (0.01, 0.99)))) for run in runs)
    for run in runs:
        values = fill_masked(run, name)
        if len(values) < 20:
            continue
        around = np.lib.stride_tricks.sliding_window_view(np.pad(values, 4, mode="edge"), 9)
        off = np.abs(values - np.median(around, axis=1))
        scatter = 1.4826 * float(np.median(off[off > 0.0])) if (off > 0.0).any() else 0.0
        bad = off > max(_GLITCH * scatter, _GLITCH_SIZE * reach, 1e-12)
        for first, last in true_stretches(bad):
            if first > 0 and last < len(values):
                size = float(off[first:last].max())
                if last - first <= 4 and abs(values[last] - values[first - 1]) < 0.3 * size:
                    count, worst = count + 1, max(worst, size)
                    touched.append(run.name)
    if count >= _GLITCHES:
        words = f"{name} has {count} bursts of up to {worst:.4g} that were not masked"
        runs_touched = tuple(dict.fromkeys(touched))
        yield Suspicion(name, "glitch", float(count), count / _GLITCHES, words, (), runs_touched)


def counter_jumps(values: Array) -> tuple[NDArray[np.intp], float]:
    """Find where a counter, shape (n,), wraps around, and the size of its jumps; (empty, 0) without jumps.

    Returns:
      Samples before the jumps, shape (jumps,), and the jump's size [unit of the channel].
    """
    steps = np.diff(values)
    if len(steps) < 20:
        return np.empty(0, np.intp), 0.0
    usual = float(np.quantile(np.abs(steps), 0.98))
    # a full counter falls from one end of its range to the other
    at = np.flatnonzero(np.abs(steps) > max(_JUMP * usual, _FALL * float(np.ptp(values))))
    if not at.size or at.size > 0.02 * len(steps) or usual <= 0.0:
        return np.empty(0, np.intp), 0.0
    sizes = np.abs(steps[at])
    size = float(np.median(sizes))
    return (at, size) if np.all(np.abs(sizes - size) < 0.1 * size) else (np.empty(0, np.intp), 0.0)


def counter_modulus(size: float, usual: float) -> float:
    """Modulus of a counter that jumps by about `size`: 2π, 360, a power of two, or the size itself."""
    known = (2.0 * np.pi, 360.0, *(2.0**k for k in (8, 10, 12, 14, 15, 16, 24, 32)))
    near = min(known, key=lambda m: abs(m - size))
    return float(near) if abs(near - size) <= max(0.05 * near, 2.0 * usual) else size


def unwrap_counter(values: Array) -> Array:
    """Readings of a counter without its jumps, shape (n,) [unit of the channel]."""
    at, size = counter_jumps(values)
    if not at.size:
        return values
    steps = np.diff(values)
    modulus = counter_modulus(size, float(np.quantile(np.abs(steps), 0.98)))
    turns = np.zeros(len(values))
    np.add.at(turns, at + 1, -np.sign(steps[at]))
    return values + modulus * np.cumsum(turns)


def _wraps(runs: Sequence[Run], name: str) -> Iterator[Suspicion]:
    count, touched, size = 0, [], 0.0
    for run in runs:
        at, found = counter_jumps(fill_masked(run, name))
        if at.size:
            count, size = count + int(at.size), found
            touched.append(run.name)
    if count:
        words = f"{name} wraps around {count} times by {size:.4g}, like a counter that overflows"
        yield Suspicion(name, "wrap", size, 4.0, words, (), tuple(touched))


def _equal_rows(run: Run) -> NDArray[np.bool_]:
    """Mask of rows that equal the row before them but for time, shape (n,)."""
    same = np.ones(len(run.time), bool)
    same[:1] = False
    for name, values in run.columns.items():
        if name != "time":
            same[1:] &= np.diff(values) == 0.0
    return same


def _quiet_rows(run: Run, same: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask of rows about which no column changes by more than its resolution, as a rule, shape (n,).

    There a coarse encoder repeats its value though the logger works. Noise that is finer than the smallest
    change of a column never lets it seem quiet.
    """

    def count(mask: NDArray[np.bool_]) -> Array:
        return np.convolve(mask.astype(float), np.ones(min(_NEAR, len(mask))), "same")

    quiet, others = np.ones(len(same), bool), count(~same)
    for name, values in run.columns.items():
        if name != "time":
            steps = np.concatenate([[0.0], np.abs(np.diff(values))])
            finest = steps[steps > 1e-9 * max(float(np.ptp(values)), 1e-300)].min(initial=np.inf)
            quiet &= count(steps > 1.01 * finest) <= _RARELY * others
    return quiet


def _stale(runs: Sequence[Run]) -> Iterator[Suspicion]:
    """Find stretches in which no channel changes, though noise or motion changes one of them as a rule.

    Where a share p of the rows repeats the row before, n rows hold no longer stretch than ln n / ln(1/p).
    """
    count, worst, words, touched = 0, 0.0, "", []
    for run in runs:
        same = _equal_rows(run)
        if len(run.columns) < 2 or not same.any():
            continue
        stretches = true_stretches(same)
        longest = max(last - first for first, last in stretches)
        share = (np.count_nonzero(same) - longest) / max(len(same) - longest, 1)
        usual = np.log(len(same)) / np.log(1.0 / min(max(share, 1.0 / len(same)), 1.0 - 1e-9))
        allowed = max(_STALE * usual, _FEWEST_STALE)
        quiet = np.append(_quiet_rows(run, same), True)
        found = [
            (first, last)
            for first, last in stretches
            if last - first > allowed and not (quiet[first - 1] and quiet[last])
        ]
        if not found:
            continue
        touched.append(run.name)
        count += sum(last - first for first, last in found)
        first, last = max(found, key=lambda part: part[1] - part[0])
        if (last - first) / allowed > worst:
            worst = (last - first) / allowed
            at = f"{run.time[first - 1]:.3f} to {run.time[last - 1]:.3f} s of {run.name}"
            words = f"all channels repeat their values from {at}, {last - first} rows"
    if touched:
        words += f", likewise in {len(touched) - 1} more runs" if len(touched) > 1 else ""
        yield Suspicion("time", "stale", float(count), worst, words, (), tuple(touched))


def _repeated(runs: Sequence[Run], speeds: Sequence[str]) -> Iterator[Suspicion]:
    count, strength, touched = 0, 0.0, []
    for run in runs:
        if len(run.columns) < 2:
            continue
        same = _equal_rows(run)
        own = int(np.count_nonzero(same & moving_mask(run, speeds) & ~_quiet_rows(run, same)))
        allowed = max(3.0, _REPEATED * len(same))
        if own >= allowed:
            count, strength = count + own, max(strength, own / allowed)
            touched.append(run.name)
    if touched:
        words = f"{count} rows in {len(touched)} runs repeat the row before them while the machine moves"
        yield Suspicion("time", "duplicated", float(count), strength, words, (), tuple(touched))


def repeated_runs(runs: Sequence[Run]) -> list[str]:
    """List runs whose columns are identical in every number, one sentence each."""
    found, seen = [], {}
    for run in runs:
        key = tuple((name, np.asarray(values).tobytes()) for name, values in sorted(run.columns.items()))
        digest = hash(key)
        if digest in seen:
            found.append(f"{run.name} equals {seen[digest]} in every number; it is a copy and no repeat")
        else:
            seen[digest] = run.name
    return found


def rest_mask(run: Run, speeds: Sequence[str]) -> NDArray[np.bool_]:
    """Mask of samples at which every speed stays near zero for a while, shape (n,)."""
    still = np.ones(len(run.time), bool)
    for name in speeds:
        size = np.abs(fill_masked(run, name))
        still &= size < _STILL * max(float(size.max()), 1e-9)
    least = max(3, round(_REST / max(float(np.median(np.diff(run.time))), 1e-6)))
    for first, last in true_stretches(still):
        # the machine is still slowing down, or already starting, at the ends
        still[first : first + (least // 4 if first > 0 else 0)] = False
        still[last - (least // 4 if last < len(still) else 0) : last] = False
        if last - first < least:
            still[first:last] = False
    return still


def acceleration_bias(runs: Sequence[Run], name: str, speeds: Sequence[str]) -> Iterator[Suspicion]:
    """Yield the bias of an accelerometer whose reading at rest is the same, and not zero, in all runs."""
    means = [
        float(fill_masked(run, name)[still].mean()) for run in runs if (still := rest_mask(run, speeds)).any()
    ]
    if not means:
        return
    bias = float(np.mean(means))
    spread = float(np.std(means)) / np.sqrt(len(means))
    allowed = max(_ACCELERATION_BIAS, 5.0 * _RUN_BIAS / np.sqrt(len(means)), 5.0 * spread)
    if abs(bias) > allowed:
        words = f"{name} reads {bias:+.3f} m/s² at rest; a floor that is not level explains it as well"
        yield Suspicion(name, "bias", bias, min(abs(bias) / allowed, SLOPE), words)


def current_bias(runs: Sequence[Run], name: str, target: str, speeds: Sequence[str]) -> Iterator[Suspicion]:
    """Yield the bias of a current that differs from its constant set value at rest."""
    off = []
    for run in runs:
        if not {name, target} <= set(run.columns):
            continue
        set_value = np.asarray(run.columns[target], float)
        steady = np.concatenate([np.zeros(20, bool), np.abs(set_value[20:] - set_value[:-20]) < 1e-3])
        still = rest_mask(run, speeds) & steady
        if still.sum() >= 20:
            off.append(float(np.mean(fill_masked(run, name)[still] - set_value[still])))
    if not off:
        return
    bias, spread = float(np.mean(off)), float(np.std(off)) / np.sqrt(len(off))
    allowed = max(_CURRENT_BIAS, 4.0 * spread)
    if abs(bias) > allowed:
        words = f"{name} is off by {bias:+.3f} A against its set value at rest"
        yield Suspicion(name, "bias", bias, abs(bias) / allowed, words)
