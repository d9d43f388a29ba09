"""LuGre parameters of every floor of a dataset: section 4.2 of the dissertation as one fit per floor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from omnimj.errors import InputError
from omnimj.estimate.identification.curve import (
    covered_slip,
    points,
    slope,
    start_values,
    steady_curve,
    stribeck,
)
from omnimj.estimate.identification.floor_fit import (
    RADIUS_SCALE,
    V_S,
    FloorFit,
    FloorProblem,
    solve_floor,
    solve_multistart,
)
from omnimj.estimate.identification.records import (
    PARAMETERS,
    UNITS,
    Estimate,
    Identification,
    IdentifiedFloor,
    RunResidual,
    SteadyCurve,
)
from omnimj.estimate.identification.runs import CarriageRun, carriage_run
from omnimj.estimate.identification.uncertainty import (
    FitCovariance,
    confidence_interval,
    describe_undetermined,
    fit_covariance,
    has_stribeck,
    known_uncertainty,
)
from omnimj.estimate.intervals import finite_rms
from omnimj.estimate.rig_runs import FLOOR_FRICTION, RigRun, require_rig, rig_run
from omnimj.estimate.threads import Progress
from omnimj.parameters import Rig
from omnimj.recording.dataset import Dataset

_REFITS = 2  # number of refits with the noise model from the previous fit
_FEWEST_BLOCKS = 20  # smallest number of blocks of a run in which the carriage moved
_CURVE_POINTS = 60
_LEAST_SLIP = 5e-4  # [m/s] start of the plotted curve
_MOST_SLIP = 0.1  # [m/s] its end when no run slides


def rig_runs(dataset: Dataset, rig: Rig) -> list[RigRun]:
    """Runs of a dataset on the rig's control period.

    Raises:
      InputError: The dataset is not one of the rig.
    """
    require_rig(dataset, FLOOR_FRICTION)
    return [rig_run(run, 1.0 / rig.sensors.sample_rate) for run in dataset.runs]


def identify(dataset: Dataset, rig: Rig, progress: Progress | None = None) -> Identification:
    """Fit the six LuGre parameters to all runs of each floor together.

    Ctrl-C keeps the completed floors.

    Raises:
      InputError: Not a rig dataset, a model with effects, or a floor on which slip never shows.
    """
    if getattr(rig, "effects", None):
        names = ", ".join(rig.effects)
        rule = "a floor is identified with the model alone; leave [effects] out"
        raise InputError(f"{rig.file}: effects", f"found {names}", rule)
    by_floor: dict[str, list[CarriageRun]] = {}
    for run in rig_runs(dataset, rig):
        by_floor.setdefault(run.floor, []).append(carriage_run(rig, run))
    found: list[IdentifiedFloor] = []
    interrupted = False
    try:
        for floor, runs in by_floor.items():
            if progress is not None:
                progress(len(found), len(by_floor))
            found.append(identify_floor(floor, runs, rig, dataset.path))
        if progress is not None:
            progress(len(found), len(by_floor))
    except KeyboardInterrupt:
        interrupted = True
    return Identification(dataset.path, rig.file, tuple(found), dataset.notes, interrupted)


def identify_floor(floor: str, runs: Sequence[CarriageRun], rig: Rig, place: Path) -> IdentifiedFloor:
    """Identify one floor.

    Raises:
      InputError: Slip shows in no run.
    """
    moving = tuple(run for run in runs if run.blocks >= _FEWEST_BLOCKS)
    if not moving:
        rule = "at least one run must drive the carriage so hard that slip shows above its noise"
        raise InputError(f"{place}: floor {floor!r}", "the wheel slips in none of its runs", rule)
    fit = fit_runs(FloorProblem(moving, max(rig.sensors.accelerometer_bias, 1e-3)))
    doubt = fit_covariance(fit, known_uncertainty(rig))
    shows_stribeck = has_stribeck(fit, doubt)
    estimates = _estimates(fit, doubt, shows_stribeck)
    covered = covered_slip(fit)
    seen = points(fit)
    return IdentifiedFloor(
        floor=floor,
        estimates=estimates,
        undetermined=describe_undetermined(floor, fit, doubt, estimates, covered, shows_stribeck),
        curve=_curve(fit, doubt, covered),
        points=seen,
        residuals=(residuals := _residuals(fit)),
        runs=tuple(run.run.name for run in moving),
        masses=tuple(sorted({run.run.mass for run in moving}, reverse=True)),
        left_out=tuple(run.run.name for run in runs if run not in moving),
        radius_scale=float(np.exp(fit.shared[RADIUS_SCALE])),
        rms={
            "carriage_speed": finite_rms(np.concatenate([r.speed for r in residuals])),
            "carriage_acceleration": finite_rms(np.concatenate([r.acceleration for r in residuals])),
            "traction_ratio": finite_rms(seen.ratio - seen.model_ratio),
        },
        samples=sum(run.blocks for run in moving),
        effective_samples=doubt.effective_samples,
        clusters=doubt.clusters,
    )


def fit_runs(problem: FloorProblem) -> FloorFit:
    """Fit with the noise model estimated from its own residuals."""
    fit = solve_multistart(problem, start_values(problem.runs))
    for _ in range(_REFITS):
        problem = problem.with_whitening_of(fit.shared, fit.own)
        fit = solve_floor(problem, fit.shared, fit.own)
    return fit


def _estimates(fit: FloorFit, doubt: FitCovariance, shows_stribeck: bool) -> tuple[Estimate, ...]:
    """Estimates with intervals; with a constant g μ_c, μ_s and V_s compensate each other and are open."""
    values = np.exp(fit.shared)
    found = []
    for k, name in enumerate(PARAMETERS):
        ends = (None, None) if k <= V_S and not shows_stribeck else confidence_interval(fit, doubt, k)
        found.append(Estimate(name, UNITS[name], float(values[k]), *ends))
    return tuple(found)


def _curve(fit: FloorFit, doubt: FitCovariance, covered: tuple[float, float] | None) -> SteadyCurve:
    low, high = covered or (np.nan, np.nan)
    end = max(high, _MOST_SLIP) if covered is None else high
    slip = np.geomspace(min(_LEAST_SLIP, end / 10.0), end, _CURVE_POINTS)
    ratio = steady_curve(fit.shared, slip)
    half = doubt.half_width(slope(steady_curve, fit.shared, slip))
    level = stribeck(fit.shared, slip)
    wide = doubt.half_width(slope(stribeck, fit.shared, slip))
    return SteadyCurve(
        slip,
        *(ratio, ratio - half, ratio + half),
        *(level, level - wide, level + wide),
        (float(low), float(high)),
    )


def _residuals(fit: FloorFit) -> tuple[RunResidual, ...]:
    found = []
    for run, blocks in zip(fit.problem.runs, fit.problem.simulated(fit.shared, fit.own), strict=True):
        off = run.measured - blocks[:, :2]
        counted = off[np.isfinite(off[:, 1]), 1]
        bias = counted.mean() if len(counted) else 0.0  # accelerometer bias, fitted per run
        found.append(RunResidual(run.run.name, run.time, off[:, 0], off[:, 1] - bias))
    return tuple(found)
