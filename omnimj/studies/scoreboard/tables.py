"""Tables of a scoreboard: what was named in each set, what is published, and the mismatch that is left."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnimj.studies.scoreboard.sets import Expected, MissingSet, RealSet
from omnimj.studies.statistics import Table, format_number

HEADING = "Gap workflow on real measurements"
_HEAD = ("set", "named", "expected", "found", "before", "after", "smaller by", "minutes")


@dataclass(frozen=True)
class Row:
    """Result of a set beside what is published about it."""

    name: str
    expected: Expected
    source: str
    result: Mapping[str, Any] | None
    """Result of the search; None where it is missing."""
    error: str = ""

    @staticmethod
    def of(one: RealSet, result: Mapping[str, Any] | None, error: str = "") -> Row:
        """Make the row of a set."""
        return Row(one.name, one.expected, one.source, result, error)

    @property
    def named(self) -> tuple[str, ...]:
        """Labels of the named effects."""
        return tuple(effect["label"] for effect in self._effects)

    @property
    def _effects(self) -> Sequence[Mapping[str, Any]]:
        return () if self.result is None else self.result["effects"]

    @property
    def found(self) -> tuple[str, ...]:
        """Expected effects that were named, or are among the rivals that the data do not exclude."""
        sets = [{one["label"], *one["indistinguishable_from"]} for one in self._effects]
        names = set().union(*sets)
        return tuple(label for label in self.expected if label in names or label.partition(" ")[0] in names)

    @property
    def shrink(self) -> float | None:
        """1 − after/before of the held-out mismatch."""
        if self.result is None or self.result["after"] is None or not self.result["before"]:
            return None
        return 1.0 - self.result["after"] / self.result["before"]

    def content(self) -> dict[str, Any]:
        """Entry of `scoreboard.json`."""
        shown = {key: value for key, value in (self.result or {}).items() if key != "fingerprint"}
        return {
            "name": self.name,
            "expected": self.expected,
            "source": self.source or None,
            "found": self.found,
            "shrink": self.shrink,
            "error": self.error or None,
            **shown,
        }


def score_tables(rows: Sequence[Row], missing: Sequence[MissingSet]) -> Iterator[Table]:
    """Yield the table of all sets, also of known ones that are missing, and that of the published values."""
    cells = [_cells(row) for row in rows]
    cells += [(one.name, "not there", *("–" for _ in _HEAD[2:])) for one in missing]
    title = "Named and expected effects; held-out mismatch before and after, RMS in units of noise"
    yield Table(title, _HEAD, tuple(cells))
    head = ("set", "effect", "parameter", "found", "90 %", "published", "source")
    yield Table("Published values", head, tuple(cell for row in rows for cell in _values(row)))


def _cells(row: Row) -> tuple[str, ...]:
    expected = ", ".join(row.expected) or "–"
    result = row.result
    if result is None:
        return (row.name, row.error or "not searched yet", expected, *("–" for _ in _HEAD[3:]))
    verdict = result["verdict"].replace("_", " ")
    words = ", ".join(map(_with_rivals, result["effects"])) or verdict
    words += "; incomplete" if result["incomplete"] else ""
    found = f"{len(row.found)} of {len(row.expected)}" if row.expected else "–"
    rivals = sum(label not in row.named for label in row.found)
    found += f", {rivals} as rival" if rivals else ""
    smaller = "–" if row.shrink is None else f"{100.0 * row.shrink:.0f} %"
    sizes = (format_number(result["before"]), format_number(result["after"]))
    return (row.name, words, expected, found, *sizes, smaller, f"{result['minutes']:.1f}")


def _with_rivals(effect: Mapping[str, Any]) -> str:
    return " or ".join((effect["label"], *effect["indistinguishable_from"]))


def _values(row: Row) -> Iterator[tuple[str, ...]]:
    by_label = {effect["label"]: effect["parameters"] for effect in row._effects}
    for label, values in row.expected.items():
        for name, value in values.items():
            own = by_label.get(label, {}).get(name)
            found = "–" if own is None else f"{own['value']:.3g} {own['unit']}"
            ends = "–" if own is None else f"{format_number(own['low'])} … {format_number(own['high'])}"
            yield row.name, label, name, found, ends, f"{value:.3g}", row.source


def introduction(rows: Sequence[Row], missing: Sequence[MissingSet]) -> Iterator[str]:
    """Yield how many sets were searched, and where each set that is not there can be had."""
    searched = sum(row.result is not None for row in rows)
    there = f"{searched} of {len(rows)} sets that are there were searched"
    yield f"{there}; {len(missing)} known ones are not there."
    for one in missing:
        yield f"{one.name} is not there: {one.get}, and give --data DIR"
