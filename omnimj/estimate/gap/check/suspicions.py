"""Records of the data check, and the channels to blame when related channels disagree."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

SURE_STRENGTH = 2.0
"""Strength above which a suspicion is sure."""

KINDS = (
    "time_base",
    "unit",
    "sign",
    "swapped",
    "delay",
    "scale",
    "magnitude",
    "wrap",
    "stale",
    "frozen",
    "duplicated",
    "clipping",
    "glitch",
    "bias",
)
"""Kinds of defects in the order of what they spoil: a wrong time spoils all channels, a bias one of them."""
GROSS = float(np.log(3.0))
"""|log| of a factor that is a `unit` rather than a `scale`: beyond every scale in the library of effects."""
_MOST = 2  # largest number of channels that are wrong at once
_NEAR = 0.12  # |log| distance from the factor of a unit
_LENGTHS = ((1000.0, "thousandths"), (100.0, "hundredths"), (1e6, "millionths"), (0.001, "thousands"))
_ANGLES = (
    (180.0 / np.pi, "degrees"),
    (1.0 / (2.0 * np.pi), "turns"),
    (60.0 / (2.0 * np.pi), "turns per minute"),
)
_ACCELERATIONS = ((1.0 / 9.81, "g"), *_LENGTHS)


@dataclass(frozen=True)
class Suspicion:
    """Probable defect of a channel, found without any model of friction."""

    channel: str
    kind: str
    """One of `KINDS`."""
    size: float
    """Factor of a scale (that of a known unit where one is near), delay [s], bias [unit of the channel],
    clipping value, largest value over its limit, number of the other wheel, or count; −1 for a sign."""
    strength: float
    """Ratio to the largest value seen in healthy recordings; at least 1."""
    words: str
    """One sentence."""
    or_channels: tuple[str, ...] = ()
    """Other channels that would explain the contradiction as well."""
    runs: tuple[str, ...] = ()
    """Runs in which it was seen; empty for all."""

    @property
    def is_sure(self) -> bool:
        """True if neither chance nor a healthy machine nor another channel would explain the observation."""
        return self.strength >= SURE_STRENGTH and not self.or_channels

    @property
    def is_certain(self) -> bool:
        """True if the data are wrong for certain, though perhaps not in which of two channels.

        Only a wrong sign or unit makes two channels contradict each other beyond what a machine can do.
        """
        return self.is_sure or (self.kind in ("unit", "sign") and self.strength >= SURE_STRENGTH)

    def renamed(self, names: Mapping[str, str]) -> Suspicion:
        """The same suspicion with other names of channels."""
        words = self.words
        for name, other in names.items():
            words = words.replace(name, other)
        others = tuple(names.get(name, name) for name in self.or_channels)
        return replace(self, channel=names.get(self.channel, self.channel), words=words, or_channels=others)


@dataclass(frozen=True)
class DataCheck:
    """Outcome of the data check."""

    notes: tuple[str, ...]
    """One sentence per finding."""
    suspicions: tuple[Suspicion, ...]
    """In the order of importance: certain ones first, then by kind and strength."""


def importance(found: Suspicion) -> tuple[bool, int, bool, float, str]:
    """Sorting key of a suspicion; the most important one is the smallest."""
    return not found.is_certain, KINDS.index(found.kind), not found.is_sure, -found.strength, found.channel


def units_of(channel: str) -> tuple[tuple[float, str], ...]:
    """Factors by which a channel is wrong when it is recorded in another unit."""
    if channel.startswith(("wheel", "yaw")):
        return _ANGLES
    return _ACCELERATIONS if "acceleration" in channel else _LENGTHS


@dataclass(frozen=True)
class Link:
    """Relation between two channels."""

    x: str
    y: str
    scale: float | None
    """y over x where it is known; its sign always counts."""
    allowed: float
    """Largest |log| of a healthy scale; infinite for a link that relates signs only."""
    weight: float = 1.0
    """Certainty of the sign: the correlation behind it."""


def unit_of(
    factor: float, channel: str, more: Iterable[tuple[float, str]] = (), near: float = _NEAR
) -> tuple[float, str]:
    """Known factor next to an estimated one, and its name; (0, "") if none is near.

    Args:
      more: Factors of the machine, such as its gear, for angles.
      near: Largest |log| distance.
    """
    own = (*units_of(channel), *(more if channel.startswith("wheel") else ()))
    known = min(own, key=lambda u: abs(np.log(abs(factor) / u[0])))
    return known if abs(np.log(abs(factor) / known[0])) <= near else (0.0, "")


def late(channel: str, delay: float, allowed: float, against: str, rivals: tuple[str, ...] = ()) -> Suspicion:
    """A channel that is late against another one by more than is allowed [s]."""
    words = f"{channel} is {1e3 * delay:.1f} ms late against {against}"
    return Suspicion(channel, "delay", delay, delay / allowed, words, rivals)


def wrong_signs(links: Sequence[Link]) -> list[Suspicion]:
    """Smallest set of channels whose sign must be reversed for all links to be positive."""
    signs = {(link.x, link.y): np.sign(link.scale or 0.0) for link in links}
    names = sorted({n for pair in signs for n in pair})
    violated = [link for link in links if signs[link.x, link.y] < 0.0]
    if not violated:
        return []
    found = _explanations(
        names,
        lambda flips: all(
            signs[link.x, link.y] * (-1.0) ** ((link.x in flips) + (link.y in flips)) >= 0.0 for link in links
        ),
    )
    strength = 4.0 * min(link.weight for link in violated)
    return [
        _named(found, name, "sign", -1.0, strength, "has the wrong sign, judged by related channels")
        for name in (found[0] if found else ())
    ]


def wrong_scales(
    links: Sequence[Link], more: Iterable[tuple[float, str]] = (), beyond: Iterable[str] = ()
) -> list[Suspicion]:
    """Smallest set of channels whose scale must change for all links to agree.

    Args:
      more: Factors of the machine, such as its gear, for angles.
      beyond: Channels with values that the machine cannot reach; the set includes them.
    """
    logs = {(link.x, link.y): np.log(abs(link.scale)) for link in links if link.scale}
    known = [link for link in links if link.scale and np.isfinite(link.allowed)]
    violated = [link for link in known if abs(logs[link.x, link.y]) > link.allowed]
    if not violated:
        return []
    names = sorted({n for link in known for n in (link.x, link.y)})
    always = sorted(set(beyond) & {n for link in violated for n in (link.x, link.y)})

    def offsets(flips: tuple[str, ...]) -> dict[str, float]:
        """Logarithms of the scale errors, by the tightest link to a channel that is right or settled."""
        found: dict[str, float] = {}
        for _ in flips:
            for name in [n for n in flips if n not in found]:
                open_ones = set(flips) - set(found) - {name}
                own = [k for k in known if name in (k.x, k.y) and not {k.x, k.y} & open_ones]
                if own:
                    best = min(own, key=lambda k: k.allowed)
                    off = logs[best.x, best.y] + found.get(best.x, 0.0) - found.get(best.y, 0.0)
                    found[name] = _snapped(float(off if best.y == name else -off), name, more, best.allowed)
        return found

    def agrees(flips: tuple[str, ...]) -> bool:
        off = offsets(flips)
        if len(off) < len(flips) or any(abs(off[name]) < GROSS for name in always):
            return False
        return all(
            abs(logs[k.x, k.y] - off.get(k.y, 0.0) + off.get(k.x, 0.0)) <= 1.05 * k.allowed + 1e-9
            for k in known
        )

    found = _explanations(names, agrees, always)
    suspicions = []
    for name in found[0] if found else ():
        off = offsets(found[0])[name]
        size = float(np.exp(off))  # that of a known unit where one is near
        allowed = min((k.allowed for k in violated if name in (k.x, k.y)), default=GROSS)
        factor_of_unit, unit = unit_of(size, name, more)
        what = f"is {size:.4g} times the value implied by related channels{f' ({unit}?)' if unit else ''}"
        kind = "unit" if abs(off) > GROSS else "scale"
        suspicions.append(_named(found, name, kind, factor_of_unit or size, abs(off) / allowed, what))
    return suspicions


def _snapped(off: float, name: str, more: Iterable[tuple[float, str]], allowed: float) -> float:
    """Logarithm of a scale error, or that of a known unit near it; loose links are less exact."""
    unit = unit_of(np.exp(off), name, more, max(_NEAR, allowed / 3.0))[0] if abs(off) > GROSS else 0.0
    return float(np.log(unit)) if unit else off


def _explanations(names: Sequence[str], agrees, always: Sequence[str] = ()) -> list[tuple[str, ...]]:
    """Smallest sets of channels with which all links agree, and which include certain ones."""
    rest = [name for name in names if name not in always]
    for count in range(0 if always else 1, _MOST + 1):
        sets = [(*always, *more) for more in itertools.combinations(rest, count)]
        found = [flips for flips in sets if agrees(flips)]
        if found:
            return found
    return []


def _named(
    found: Sequence[tuple[str, ...]], name: str, kind: str, size: float, strength: float, what: str
) -> Suspicion:
    rivals = tuple(sorted({n for flips in found[1:] for n in flips} - set(found[0])))
    rest = f"; it may be {' or '.join(rivals)} instead" if rivals else ""
    return Suspicion(name, kind, size, max(strength, 1.0), f"{name} {what}{rest}", rivals)
