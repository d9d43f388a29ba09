"""Results of a sensitivity study in tables and sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from omnimj.studies.sensitivity.elementary_effects import BELOW, NONE, UNKNOWN, UNSURE, ResultSensitivity
from omnimj.studies.sensitivity.factors import Factor
from omnimj.studies.sensitivity.study import SensitivityResult
from omnimj.studies.statistics import Table, format_number

_MOST_FIRST, _ENOUGH = 5, 0.8  # most parameters in the first sentence, and the sum of shares that ends it
_TOP = 3  # parameters in a result's line
_ONE_WAY = 0.95  # |μ|/μ* from which all effects go the same way


def format_heading(outcome: SensitivityResult) -> str:
    """Return the title of the study."""
    return f"What matters in {outcome.scenario}"


def measure_first_sentence(outcome: SensitivityResult) -> str:
    """Name the parameters to measure first, in one sentence."""
    sure = [rank for rank in outcome.ranks if rank.sure]
    if not sure:
        more = "; more trajectories are needed for some" if outcome.ranks else ""
        return f"No parameter is distinguishable from noise with certainty{more}."
    names, share, ranked = [], 0.0, sum(rank.share for rank in sure)
    for rank in sure[:_MOST_FIRST]:
        names.append(outcome.factors[rank.parameter].name)
        share += rank.share
        if share >= _ENOUGH * ranked:
            break
    of_all = f"{100 * share:.0f} % of the effect of all varied parameters"
    return f"Measure first: {', '.join(names)} ({of_all})."


def summary_sentences(outcome: SensitivityResult) -> Iterator[str]:
    """Yield sentences on the origin of the numbers."""
    config = outcome.config
    yield f"{outcome.scenario}: {outcome.description}."
    sources = " or ".join(config.sources)
    yield (
        f"{len(outcome.factors)} parameters with provenance {sources}, {config.trajectories} trajectories: "
        f"{outcome.runs} runs on plant {outcome.plant}, method {outcome.method}, seed {config.seed}; "
        f"{outcome.repeats} more with other noise only."
    )
    stated = sum(one.stated for one in outcome.factors)
    yield (
        "The plant has the changed parameters, the controller those of the model file. Ranges: the "
        f"uncertainty stated by the file ({stated} parameters), else ±{100 * config.share:g} % of the value."
    )
    planned = config.trajectories * (len(outcome.factors) + 1)
    if outcome.interrupted or outcome.runs < planned:
        why = "interrupted" if outcome.interrupted else "some failed"
        yield f"{outcome.runs} of {planned} runs are finished ({why}); the same command continues from here."
    if outcome.errors:
        name, error = next(iter(outcome.errors.items()))
        yield f"{len(outcome.errors)} runs failed; {name}: {error}"


def format_excluded(outcome: SensitivityResult) -> tuple[str, ...]:
    """List the parameters that are not varied, by reason."""
    reasons: dict[str, list[str]] = {}
    for one in outcome.excluded:
        reasons.setdefault(one.reason, []).append(one.name)
    return tuple(f"{', '.join(names)}: {reason}" for reason, names in reasons.items())


def format_range(one: Factor) -> str:
    """Format a range: `0.0388 … 0.0412 N.m/A (file)`."""
    words = f"{one.low:.4g} … {one.high:.4g} {'' if one.unit == '1' else one.unit}".rstrip()
    return f"{words} (file)" if one.stated else words


def format_share(share: float, low: float, high: float) -> str:
    """Format a share: `42 % (40–45)`, with another digit if it is small."""
    digits = 0 if share >= 0.0995 else 1
    return f"{100 * share:.{digits}f} % ({100 * low:.{digits}f}–{100 * high:.{digits}f})"


def measure_first_table(outcome: SensitivityResult, most: int | None = None) -> Table:
    """Return the table of the first `most` parameters over all results."""
    rows = []
    for place, rank in enumerate(outcome.ranks[:most], start=1):
        one = outcome.factors[rank.parameter]
        share = format_share(rank.share, rank.low, rank.high)
        where = rank.most if rank.sure else f"{rank.most}, perhaps"
        rows.append((str(place), one.name, f"{one.nominal:.4g}", format_range(one), share, where))
    left = len(outcome.ranks) - len(rows)
    title = f"Measure first ({len(rows)} of {len(outcome.ranks)})" if left else "Measure first"
    return Table(title, ("", "parameter", "value", "range", "share (95 %)", "most in"), tuple(rows))


def results_table(outcome: SensitivityResult) -> Table:
    """Return a table with one row per result: nominal value, floor, parameters that change it most."""
    rows = []
    for study in outcome.studies:
        top = [
            f"{outcome.factors[i].name} {format_number(study.measures[i].mu_star)}"
            for i in study.ranked[:_TOP]
        ]
        words = ", ".join(top) or _unsure(study, outcome.factors)
        rows.append(
            (study.name, format_value(study.nominal, study.unit), format_number(_known(study.floor)), words)
        )
    return Table(
        "What changes which result", ("result", "nominal", "floor", "change across a range"), tuple(rows)
    )


def _unsure(study: ResultSensitivity, varied: Sequence[Factor]) -> str:
    """List the parameters that may matter to a result without ranked ones."""
    places = [i for i, word in enumerate(study.verdicts) if word == UNSURE]
    places = sorted(places, key=lambda i: -study.measures[i].mu_star)[:_TOP]
    names = [f"{varied[i].name} {format_number(study.measures[i].mu_star)}" for i in places]
    return f"none for certain; perhaps {', '.join(names)}" if names else "none above the floor"


def format_value(value: float | None, unit: str) -> str:
    """Format a value with three digits and its unit; a dash for None."""
    return f"{format_number(value)} {unit}".rstrip() if value is not None else "–"


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def result_table(study: ResultSensitivity, varied: Sequence[Factor]) -> Table:
    """Return the table of the parameters ranked for one result."""
    rows = []
    for place, i in enumerate(study.ranked, start=1):
        found = study.measures[i]
        interval = f"{format_number(found.low)}–{format_number(found.high)}"
        rows.append(
            (
                str(place),
                varied[i].name,
                format_value(found.mu_star, study.unit),
                interval,
                format_number(_known(found.sigma)),
                direction(found.mu, found.mu_star),
            )
        )
    return Table(study.name, ("", "parameter", "μ*", "95 %", "σ", "as it grows"), tuple(rows))


def direction(mu: float, mu_star: float) -> str:
    """Describe the change of the result when the parameter grows."""
    if abs(mu) < _ONE_WAY * mu_star:
        return "either way"
    return "rises" if mu > 0.0 else "falls"


def format_unranked(study: ResultSensitivity, varied: Sequence[Factor]) -> tuple[str, ...]:
    """List the parameters that are not ranked for a result, by class."""
    lines = []
    noisy = study.noise > 0.0 and study.noise >= study.floor
    below = "Not distinguishable from noise" if noisy else "Too small to resolve"
    unsure = "Uncertain; more trajectories are needed"
    for word, heading in (
        (UNSURE, unsure),
        (BELOW, below),
        (NONE, "No effect at all"),
        (UNKNOWN, "Not known"),
    ):
        names = [one.name for one, verdict in zip(varied, study.verdicts, strict=True) if verdict == word]
        if names:
            lines.append(f"{heading} ({len(names)}): {', '.join(names)}")
    return tuple(lines)
