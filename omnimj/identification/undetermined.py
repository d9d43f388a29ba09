"""What the runs of a floor cannot tell, in words and as directions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from omnimj.identification.curve import slope, stribeck
from omnimj.identification.floor_problem import RADIUS_SCALE
from omnimj.identification.intervals import Spread
from omnimj.identification.least_squares import Fit, without_stribeck
from omnimj.identification.records import CONFIDENCE, PARAMETERS, UNITS, Direction, Estimate

_LOOSE = 0.5  # relative spread of a direction that is worth showing
_SMALL_SHARE = 0.15  # weights below it are not worth a word
_ROUGH = 2.0  # high over low of an interval beyond which a number is said to be rough
_FRICTION = ("mu_c", "mu_s", "V_s")

_WHY = {
    "sigma_0": "the bristle's stiffness shows while the wheel begins to slide",
    "sigma_1": "the bristle's damping shows in the first hundredths of a second only",
    "sigma_2": "the runs do not slide over a wide enough range of slip",
}


def directions(spread: Spread) -> tuple[Direction, ...]:
    """Combinations of the parameters whose spread is large, loosest first."""
    spreads, vectors = np.linalg.eigh(spread.total[:RADIUS_SCALE, :RADIUS_SCALE])
    found = []
    for variance, vector in zip(spreads[::-1], vectors.T[::-1], strict=True):
        if variance < _LOOSE**2:
            break
        vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
        shares = zip(PARAMETERS, vector.tolist(), strict=True)
        weights = {name: round(share, 3) for name, share in shares if abs(share) > _SMALL_SHARE}
        found.append(Direction(weights, float(np.sqrt(variance))))
    return tuple(found)


def sentences(
    floor: str,
    fit: Fit,
    spread: Spread,
    estimates: Sequence[Estimate],
    covered: tuple[float, float] | None,
    shows_stribeck: bool,
) -> tuple[str, ...]:
    """What cannot be determined, one sentence each."""
    by_name = {estimate.name: estimate for estimate in estimates}
    said = []
    if covered is None:
        said.append(
            f"on {floor} the wheel never slides with a settled bristle: "
            "the steady curve is not determined, only the stiffness sigma_0 is"
        )
    if shows_stribeck:
        said += _about_friction(floor, fit, spread, by_name, covered or (1e-3, 1e-2))
    else:
        said += _constant(floor, fit, spread, covered or (1e-3, 1e-2))
    said += [
        _open(floor, by_name[name], why) for name, why in _WHY.items() if not by_name[name].is_determined
    ]
    return tuple(said)


def has_stribeck(fit: Fit, spread: Spread) -> bool:
    """Whether the runs show that g falls (or rises) with slip: μ_s = μ_c fits them significantly worse."""
    constant = without_stribeck(fit)
    inflated = max(1.0, float(np.max(np.diag(spread.total)[:3] / np.diag(spread.naive)[:3])))
    rise = constant.data_cost - fit.data_cost
    return rise > float(stats.chi2.ppf(CONFIDENCE, 2)) * inflated


def _constant(floor: str, fit: Fit, spread: Spread, covered: tuple[float, float]) -> list[str]:
    level = _level(fit, spread, float(np.sqrt(covered[0] * covered[1])))
    return [
        f"mu_s and mu_c cannot be told apart on {floor}: only their common level is determined, "
        f"{level} at the slip of these runs",
        f"V_s is not determined on {floor}: no fall of friction with slip shows",
    ]


def _about_friction(
    floor: str, fit: Fit, spread: Spread, estimates: dict[str, Estimate], covered: tuple[float, float]
) -> list[str]:
    low, high = covered
    loose = [name for name in _FRICTION if not _is_firm(estimates[name])]
    if not loose:
        return []
    names = f"{', '.join(loose[:-1])} and {loose[-1]}" if len(loose) > 1 else loose[0]
    verb = "are not determined one by one" if len(loose) > 1 else "is determined roughly at best"
    return [
        f"{names} {verb} on {floor}: well determined is the friction level g only, "
        f"{_level(fit, spread, low)} at {1000 * low:.3g} mm/s and {_level(fit, spread, high)} at "
        f"{1000 * high:.3g} mm/s of slip"
    ]


def _is_firm(estimate: Estimate) -> bool:
    if estimate.low is None or estimate.high is None:
        return False
    return estimate.high < _ROUGH * estimate.low


def _level(fit: Fit, spread: Spread, slip: float) -> str:
    """`0.1203 ± 0.0010`: g at a slip with its interval."""
    at = np.array([slip])
    half = float(spread.half_width(slope(stribeck, fit.shared, at))[0])
    return f"{float(stribeck(fit.shared, at)[0]):.4f} ± {half:.4f}"


def _open(floor: str, estimate: Estimate, why: str) -> str:
    unit = UNITS[estimate.name]
    if estimate.low is None and estimate.high is None:
        return f"{estimate.name} is not determined on {floor}: {why}"
    bound = (
        f"is at least {estimate.low:.3g} {unit}"
        if estimate.low is not None
        else f"is at most {estimate.high:.3g} {unit}"
    )
    return f"{estimate.name} {bound} on {floor}, the other end is open: {why}"
