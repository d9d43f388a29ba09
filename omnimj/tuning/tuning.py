"""`omnimj tune`: searches gains over a batch of randomised runs and judges what it found on other seeds."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from omnimj.control.gains import Gains
from omnimj.errors import InputError
from omnimj.parameters import Floor, read_floors, read_robot
from omnimj.trials.pool import Report, Workers, with_workers
from omnimj.tuning.bench import Bench, prepared
from omnimj.tuning.cost import Score, score, score_undriven, unsteadiness
from omnimj.tuning.draws import JUDGING, Draw, draw_trial, read_tuned_scenarios
from omnimj.tuning.landscape import Landscape, survey
from omnimj.tuning.margins import FLOORS, Loops, Margin, loops_of, margins
from omnimj.tuning.order import TWIN, Order, check_order
from omnimj.tuning.search import Candidate, Search
from omnimj.tuning.space import Axis, axes_of, with_values


@dataclass(frozen=True)
class Tried:
    """A candidate and its score on the training draws."""

    generation: int
    """From 1; 0: the gains before; beyond the last: the middle of the search, and what was put back."""
    values: Candidate
    score: Score


@dataclass(frozen=True)
class Verdict:
    """The gains before and those found, on draws that nothing was tuned with."""

    plant: str
    seed: int
    draws: int
    before: Score
    after: Score

    @property
    def is_better(self) -> bool:
        """Whether what was found is better."""
        return self.after.is_better_than(self.before)


@dataclass(frozen=True)
class Outcome:
    """What came of it."""

    order: Order
    axes: tuple[Axis, ...]
    gains: Gains
    """Those found."""
    values: Candidate
    """The same along the axes."""
    tried: tuple[Tried, ...]
    verdicts: tuple[Verdict, ...]
    """On the order's plant, and on the twin where that was asked for too."""
    landscapes: tuple[Landscape, ...]
    margins_before: tuple[Margin, ...]
    margins_after: tuple[Margin, ...]

    @property
    def is_better(self) -> bool:
        """Whether it is better wherever it was judged."""
        return all(verdict.is_better for verdict in self.verdicts)


def run_tuning(order: Order, report: Report, executor: Executor | None = None) -> Outcome | None:
    """Searches, judges, and looks around what was found; trials that are kept are not driven again.

    Args:
      order: What is to be done.
      report: Called with a phrase and the share that is done; may raise KeyboardInterrupt.
      executor: Runs the trials; processes of its own when None.

    Returns:
      What was found; None after Ctrl-C, with every finished trial kept.

    Raises:
      InputError: The folder beside the file holds something else, or cannot be written.
      SimulationError: A worker died, or a trial broke down; what was finished is kept.
    """
    check_order(order)
    folder = prepared(order.folder, order.plan(), order.force)
    found: list[Outcome] = []

    def work(workers: Workers) -> None:
        found.append(_Tuning(order, workers, folder, report).run())

    with_workers(work, order.workers, executor)
    return found[0] if found else None


class _Tuning:
    """One order under way."""

    def __init__(self, order: Order, workers: Workers, folder: Path, report: Report):
        self._order, self._report = order, report
        self._robot = read_robot(order.model)
        self._before = order.before
        self.axes = axes_of(self._before, order.names, order.bounds)
        self._start: Candidate = tuple(axis.start for axis in self.axes)
        self._scenarios = read_tuned_scenarios(order.scenarios, order.model)
        self._bench = Bench(folder, self.axes, order.changed, order.thresholds, workers, self._tell)
        self._floors = _measured_floors()
        self._phrase, self._done, self._share = "", 0.0, 0.0
        self._loops_before = self._loops(self._start)
        self._draws = self._drawn(order.seed, order.trials, order.plant)
        self.tried: list[Tried] = []

    def run(self) -> Outcome:
        """All of it."""
        order = self._order
        self._search()
        self._step("what makes no difference", 0.05)
        best = self._settled(min(self.tried, key=lambda one: (one.score.violation, one.score.cost)))
        self._step("judging", 0.05)
        verdicts = [self._judged(best.values, plant, count) for plant, count in self._judges()]
        self._step("looking around", 0.15)
        landscapes: tuple[Landscape, ...] = ()
        if order.landscape:
            landscapes = survey(self.axes, best.values, self.tried, order.landscape, self._near)
        gains = with_values(self._before, self.axes, best.values)
        return Outcome(
            order,
            self.axes,
            gains,
            best.values,
            tuple(self.tried),
            tuple(verdicts),
            landscapes,
            margins(self._robot, self._before.control, self._floors),
            margins(self._robot, gains.control, self._floors),
        )

    def _search(self) -> None:
        search, generations = Search(self.axes, self._order.seed), self._order.generations
        each = 0.75 / (generations + 2)
        self._step("as it is", each)
        self.tried = [Tried(0, self._start, self._scores([self._start], self._draws)[0])]
        for plant, count in self._judges():  # what breaks down there does so now, not after hours
            self._scores([self._start], self._drawn(self._order.seed + JUDGING, count, plant))
        for generation in range(1, generations + 1):
            best = min(one.score.fitness for one in self.tried)
            self._step(f"{generation} of {generations}, best {best:.3g}", each)
            asked = search.ask()
            scores = self._scores(asked, self._draws)
            self.tried += [Tried(generation, *pair) for pair in zip(asked, scores, strict=True)]
            search.tell([one.fitness for one in scores])
            if search.is_over:
                break
        self._step("middle", each)
        self.tried.append(
            Tried(generations + 1, search.middle, self._scores([search.middle], self._draws)[0])
        )

    def _settled(self, best: Tried) -> Tried:
        """The best one with every gain that makes no difference where it was before the search.

        A gain that these draws do not feel drifts with those that they do; one after the other, that which
        went least far first, is put back, and stays there if nothing is lost by it.
        """
        far = [abs(axis.place(value)) for axis, value in zip(self.axes, best.values, strict=True)]
        for k in sorted(range(len(far)), key=far.__getitem__):
            values = tuple(self._start[j] if j == k else value for j, value in enumerate(best.values))
            if values == best.values:
                continue
            back = Tried(self._order.generations + 1, values, self._scores([values], self._draws)[0])
            self.tried.append(back)
            if not best.score.is_better_than(back.score):
                best = back
        return best

    def _judges(self) -> list[tuple[str, int]]:
        """Plants to be judged on, and with how many draws per scenario."""
        order = self._order
        return [(order.plant, order.judging), *([(TWIN, order.twin)] if order.twin else [])]

    def _judged(self, values: Candidate, plant: str, count: int) -> Verdict:
        seed = self._order.seed + JUDGING
        draws = self._drawn(seed, count, plant)
        after, before = self._scores([values, self._start], draws)
        return Verdict(plant, seed, len(draws), before, after)

    def _near(self, candidates: Sequence[Candidate]) -> list[Score]:
        """Scores on a part of the training draws: those of the two shortest scenarios."""
        shortest = sorted(self._scenarios, key=lambda text: self._scenarios[text].duration)[:2]
        return self._scores(candidates, [d for d in self._draws if d.scenario in shortest])

    def _scores(self, candidates: Sequence[Candidate], draws: Sequence[Draw]) -> list[Score]:
        """Score of each; a candidate whose loops are not steady enough is not driven."""
        limits = self._order.limits
        loops = {one: self._loops(one) for one in candidates}
        driven = [one for one in candidates if one == self._start or not unsteadiness(loops[one], limits)]
        facts = dict(zip(driven, self._bench.drive(driven, draws, "trials"), strict=True))
        before = self._bench.drive([self._start], draws, "trials")[0]
        broken = [one.broke for one in before if one.broke is not None]
        if broken:
            raise InputError("omnimj tune", "the gains before broke a run down", broken[0])
        return [
            score(facts[one], before, loops[one], self._loops_before, limits, self.axes, one)
            if one in facts
            else score_undriven(loops[one], limits)
            for one in candidates
        ]

    def _loops(self, values: Candidate) -> Loops:
        gains = with_values(self._before, self.axes, values)
        return loops_of(self._robot, gains.control, self._floors)

    def _drawn(self, seed: int, count: int, plant: str) -> list[Draw]:
        return [
            draw_trial(text, scenario, seed, index, plant, self._order.model)
            for index in range(count)
            for text, scenario in self._scenarios.items()
        ]

    def _step(self, phrase: str, share: float) -> None:
        """What comes next, and its share of the whole."""
        self._phrase, self._done, self._share = phrase, self._done + self._share, share

    def _tell(self, phrase: str, share: float) -> None:
        self._report(f"{self._phrase}: {phrase}", min(self._done + self._share * share, 1.0))


def _measured_floors() -> tuple[Floor, ...]:
    floors = read_floors()
    return tuple(floors[name] for name in FLOORS)
