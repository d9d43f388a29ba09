"""Text of a finding in plain sentences with numbers, for digest, report and terminal alike."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omnimj.estimate.gap.records import Finding, MismatchRegime, NamedEffect

HEADLINES = {
    "named": "Named",
    "ambiguous": "Ambiguous",
    "unexplained": "Unexplained",
    "no_gap": "No gap",
}
_VARIABLES = {
    "reversal": "time since a reversal",
    "time": "time since start",
    "carriage_acceleration": "acceleration",
}
_MACHINES = {"quarter_rig": "test rig", "uto_robot": "robot", "linear_axis": "linear axis", "mjcf": "machine"}


def machine_name(plant: str) -> str:
    """Name of a plant in words: `quarter_rig` → `test rig`."""
    return _MACHINES.get(plant, plant.replace("_", " "))


def dataset_name(finding: Finding) -> str:
    """Name of the dataset's folder without its path."""
    return Path(finding.dataset).name or finding.dataset


def variable_words(name: str) -> str:
    """Regime variable in words: `reversal` → `time since a reversal`."""
    return _VARIABLES.get(name, name.replace("_", " "))


def format_percent(share: float) -> str:
    """Format a share: `0.583` → `58 %`; small shares keep two digits."""
    value = 100.0 * share
    return f"{format_number(round(value) if abs(value) >= 9.95 else value, 3 if abs(value) >= 9.95 else 2)} %"


def format_number(value: float, number: int = 3) -> str:
    """Format a number with a true minus sign; at most `number` significant digits below a million."""
    form = f".{number}g" if abs(value) < 10.0**number or abs(value) >= 1e6 else ".0f"
    return f"{value:{form}}".replace("-", "−")


def format_amount(value: float | None, unit: str, number: int = 3) -> str:
    """Format a number with its unit; a dash for None."""
    if value is None:
        return "–"
    return f"{format_number(value, number)} {'' if unit == '1' else format_unit(unit)}".rstrip()


def format_unit(unit: str) -> str:
    """Format a unit: `kg.m2` → `kg·m²`."""
    return unit.replace(".", "·").replace("2", "²")


def join_words(names: Sequence[str], last: str = "and") -> str:
    """Join words: `a, b and c`."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


def effect_label(effect: NamedEffect) -> str:
    """Effect with its selector in brackets: `torque_constant (wheel 3)`."""
    chosen = ", ".join(
        f"{name} {value}" if name == "wheel" else str(value) for name, value in effect.selectors.items()
    )
    return f"{effect.effect} ({chosen})" if chosen else effect.effect


def headline(finding: Finding) -> str:
    """Verdict with the named effects: `Named: lateral_coupling`, `Named, incomplete: 2 effects`."""
    effects = finding.effects
    if len(effects) > 1:
        names = f": {len(effects)} effects"
    elif effects:
        names = f": {join_words([effect_label(effects[0]), *effects[0].indistinguishable_from], 'or')}"
    else:
        names = ""
    return HEADLINES[finding.verdict] + (", incomplete" if finding.incomplete else "") + names


def summarize_finding(finding: Finding) -> str:
    """Verdict as a few sentences."""
    parts = (_unfinished(finding) if finding.failure else "", _verdict(finding), _with_outside(finding))
    return " ".join(filter(None, parts))


def _unfinished(finding: Finding) -> str:
    why = "was interrupted" if finding.failure == "interrupted" else f"ended early ({finding.failure})"
    return f"The search {why}; this is the result so far."


def _with_outside(finding: Finding) -> str:
    if finding.outside is None:
        return ""
    left = format_in_noise(finding.outside.remains)
    return f"If the model had {finding.outside.words}, {left} would remain; the library has no such force."


def _verdict(finding: Finding) -> str:
    if finding.incomplete:
        return f"{_summarize_incomplete(finding)} {_smaller(finding)}".rstrip()
    if finding.verdict == "named":
        return f"{_lacks(finding)}{_open(finding)} {_smaller(finding)}".rstrip()
    if finding.verdict == "ambiguous":
        return f"{_list_alternatives(finding)} {_smaller(finding)}".rstrip()
    if finding.verdict == "unexplained":
        return f"Model and measurement disagree{_size(finding)}{_unexplained(finding)}."
    return f"The model agrees with the measurement{_size(finding)}: these data show no missing effect."


def _unexplained(finding: Finding) -> str:
    if finding.tolerated:
        return (
            f"; {join_words(finding.tolerated, 'or')} would explain it, but the equations may err by as much"
        )
    open_one = finding.undetermined
    if open_one is None:
        return ", and no effect in the library explains it"
    share = format_percent(open_one.gain.value)
    return f"; {open_one.label} would remove {share} of it, but {open_one.reason}"


def _lacks(finding: Finding) -> str:
    names = [effect_label(effect) for effect in finding.effects]
    if len(names) == 1:
        return f"The model lacks {names[0]}: {finding.effects[0].words}."
    return f"The model lacks {len(names)} effects: {join_words(names)}."


def _summarize_incomplete(finding: Finding) -> str:
    """Summary of an incomplete model: named effects, remaining mismatch, its place, share of a free curve."""
    is_named = finding.verdict == "named"
    named = f"{_lacks(finding)}{_open(finding)}" if is_named else _list_alternatives(finding)
    rest = "" if finding.remains is None else f": {format_number(finding.remains, 2)} times the noise remains"
    place = max(
        finding.where, key=lambda w: (w.after or 0.0) / finding.noise.get(w.channel, 1.0), default=None
    )
    where = ""
    if place is not None and place.channel in finding.channels:
        where = f", most of it in the {finding.channels[place.channel][1]} ({format_regime(place)})"
    curve, best = "", _best_free_curve(finding)
    if best is not None and finding.outside is None:
        variable, share = best
        curve = f"; a free curve over {variable_words(variable)} would remove {format_percent(share)} of it"
    return f"Incomplete. {named} Something else is missing as well{rest}{where}{curve}."


def _open(finding: Finding) -> str:
    rivals = [
        f" Instead of {effect_label(e)} it could be {join_words(e.indistinguishable_from, 'or')}."
        for e in finding.effects
        if e.indistinguishable_from
    ]
    return "".join(rivals)


def _list_alternatives(finding: Finding) -> str:
    sure = [effect_label(e) for e in finding.effects if not e.indistinguishable_from]
    open_ = [
        f"one of {join_words([effect_label(e), *e.indistinguishable_from], 'or')}"
        for e in finding.effects
        if e.indistinguishable_from
    ]
    start = (
        f"The model lacks {join_words(sure)}, and {join_words(open_)}"
        if sure
        else f"The model lacks {join_words(open_)}"
    )
    return f"{start}; these data cannot tell which."


def main_channel(finding: Finding) -> str | None:
    """Channel that carries most of the gap."""
    for place in finding.where:
        if place.channel in finding.heldout:
            return place.channel
    return next(iter(finding.heldout), None)


def _smaller(finding: Finding) -> str:
    channel = main_channel(finding)
    if channel is None or finding.heldout[channel].after is None:
        return ""
    gap, (unit, words) = finding.heldout[channel], finding.channels[channel]
    n = len(finding.heldout_runs)
    runs = f"the {n} runs that were held out" if n != 1 else "the one run that was held out"
    whole = "" if finding.shrink is None else f", and the whole gap by {format_percent(finding.shrink)}"
    return (
        f"With {'it' if len(finding.effects) == 1 else 'them'} the RMS mismatch in the {words} on {runs} "
        f"falls from {format_amount(gap.before, unit)} to {format_amount(gap.after, unit)}{whole}."
    )


def _size(finding: Finding) -> str:
    channel = main_channel(finding)
    if channel is None:
        return ""
    gap, (unit, words) = finding.heldout[channel], finding.channels[channel]
    value = gap.before if gap.after is None else gap.after
    noise = finding.noise.get(channel)
    beside = "" if not noise else f", {format_in_noise(value / noise)}"
    return f" (RMS {format_amount(value, unit)} in the {words}{beside})"


def format_in_noise(multiple: float) -> str:
    """Format a mismatch in units of noise: `4.4 times the noise`."""
    if 0.8 <= multiple <= 1.25:
        return "about the noise"
    return f"{format_number(multiple, 2)} times the noise"


def format_regime(place: MismatchRegime) -> str:
    """Description of a regime without its density, which follows a semicolon."""
    return place.regime.partition(";")[0]


def format_chance(effect: NamedEffect) -> tuple[str, str]:
    """Share of decoys that do as well: the number, and what it counts."""
    if effect.p_false is None:
        return "not known", "no random curves were tried"
    return f"p = {format_number(effect.p_false, 2)}", "share of random curves that gain as much"


def as_sentence(text: str) -> str:
    """Capitalise and end with a full stop, unless the text begins with a name in code."""
    text = text.strip()
    if not text:
        return ""
    first = text if "_" in text.split()[0] else text[0].upper() + text[1:]
    return first if first.endswith((".", "!", "?")) else f"{first}."


def summarize_runs(finding: Finding, number: int, partly: bool) -> str:
    """Summary of the runs: `24 runs of the test rig, 4 of them held out`."""
    of = f"of the {machine_name(finding.plant)}"
    held = len(finding.heldout_runs)
    if not number:
        return f"{held} held-out runs {of}"
    start = f"{number} run{'' if number == 1 else 's'} {of}"
    if partly:
        return f"{start}, stretches of time held out"
    return f"{start}, {held} of them held out" if number > 1 else start


def next_step(finding: Finding) -> str:
    """Recommended next step."""
    if finding.next_experiment:
        return as_sentence(f"To tell them apart: {finding.next_experiment.get('why', '')}")
    if finding.verdict == "unexplained" and finding.tolerated:
        return "Drive faster, with more load or for longer: a real effect then grows and can be named."
    if finding.verdict == "unexplained" and finding.undetermined is not None:
        narrower = "state the uncertain constants of the model file more closely"
        more = f"Drive faster, with more load or for longer, or {narrower}"
        return f"{more}, to determine {finding.undetermined.label}."
    found = finding.outside
    outside = "" if found is None else f"Look for {found.words}: {found.causes}."
    if finding.verdict == "unexplained":
        return outside or _summarize_free_curve(finding)
    if finding.verdict == "no_gap":
        more = "drive faster, with more load or for longer"
        return f"Nothing: {more} to look for effects that these runs do not excite."
    return f"Use the new model. {outside or _summarize_remainder(finding)}".rstrip()


def format_separation(finding: Finding) -> str:
    """Names that the next experiment separates: `It separates rail_coulomb from rolling_resistance.`"""
    names = [str(name) for name in (finding.next_experiment or {}).get("separates") or ()]
    leader = next((effect_label(e) for e in finding.effects if e.indistinguishable_from), None)
    others = [name for name in names if leader is None or name not in (leader, leader.partition(" ")[0])]
    if not others:
        return "It separates none of them reliably."
    return (
        f"It separates {join_words(others)}."
        if leader is None
        else f"It separates {leader} from {join_words(others)}."
    )


def _summarize_remainder(finding: Finding) -> str:
    channel = main_channel(finding)
    if channel is None:
        return ""
    after, noise = finding.heldout[channel].after, finding.noise.get(channel)
    if after is None or not noise:
        return ""
    left = f"A mismatch of {format_in_noise(after / noise)} is left in the {finding.channels[channel][1]}"
    return f"{left}; {finding.ended}." if finding.ended else f"{left}."


def summarize_given_up(finding: Finding) -> list[str]:
    """Sentences on the effects that the search gave up, with gain and reason, the largest gain first."""
    return [
        f"{one.label} gained {format_percent(one.gain.value)} and was given up, because {one.reason}."
        for one in finding.given_up
    ]


def _best_free_curve(finding: Finding) -> tuple[str, float] | None:
    """Variable of the free curve that explains most, and its share; None if none explains anything."""
    best = max(finding.flexible.items(), key=lambda item: item[1], default=None)
    return best if best is not None and best[1] > 0.0 else None


def _summarize_free_curve(finding: Finding) -> str:
    best = _best_free_curve(finding)
    if best is None:
        return "No effect in the library explains it, and no free curve does."
    variable, share = best
    return (
        f"No effect in the library explains it, but a free curve over {variable_words(variable)} removes "
        f"{format_percent(share)} of the remaining held-out mismatch: look for a dependence on it."
    )


GLOSSARY: tuple[tuple[str, str], ...] = (
    ("mismatch", "Measured minus simulated, as means over short blocks of samples; RMS over blocks."),
    (
        "noise",
        "Standard deviation of one block mean, from repeats of a run, neighbouring blocks and the known "
        "error of the equations. Channels are compared in multiples of their noise. What remains leaves "
        "out the offset of a run that the model file allows its sensor; tables and plots of single channels "
        "show it.",
    ),
    ("refitted", "An uncertain value of the model file, fitted inside its stated range before any effect."),
    ("effect", "A change of the machine or of a sensor that the model lacks and the library describes."),
    ("held-out runs", "Runs that no fit has seen. They are scored once, at the end."),
    (
        "gain",
        "Share by which an effect reduces the RMS mismatch, in units of noise, of training runs that its fit "
        "left out (cross-validation), with the 90 % interval of a bootstrap over whole conditions.",
    ),
    ("margin", "Gain that the lower end of the interval must exceed for an effect to be named."),
    (
        "random curves",
        "Forces over speed, position or time without any physical meaning, fitted like an effect. p is the "
        "share of them that gain as much as the effect.",
    ),
    (
        "cannot be told apart",
        "Two effects whose predictions, with everything uncertain refitted, differ by no more than the "
        "misfit that is left would explain: that of whole runs, drawn at random.",
    ),
    ("named", "All effects that were found hold given each other, and none can be mistaken for another."),
    ("ambiguous", "For at least one effect there is another that these data cannot tell from it."),
    (
        "unexplained",
        "Model and measurement disagree, and the library does not explain it, or only by effects that are "
        "within the tolerance of the equations.",
    ),
    (
        "tolerance of the equations",
        "A tenth of an effect's typical size. Every real machine departs by so little from any law, so that "
        "no smaller effect is named by itself.",
    ),
    ("no gap", "After the refit the mismatch is at the level of the noise."),
    ("incomplete", "Effects are named, and more than twice the noise is left: something else is missing."),
    (
        "given up",
        "An effect that was in the model for a while. It did not hold once others were in the model, or it "
        "ran to the bound of its range, where it stands in for something else.",
    ),
    (
        "repeating force",
        "A sine of the way that the wheel rolled, or of the place on the rail. It may be in the model of the "
        "search where nothing but noise is left with it, so that no effect stands in for it. It is described "
        "and not named; the new model and the mismatches after the effects are without it.",
    ),
    (
        "free curve",
        "A force with eight values over one variable: the most that any effect of it could explain.",
    ),
)
"""Word and meaning, in the order in which a reader meets them."""
