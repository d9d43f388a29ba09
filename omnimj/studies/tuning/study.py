"""`omnimj tune`: searches gains over a batch of randomised runs and judges what it found on other seeds."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import omnimj
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.gains import GAIN_NAMES, Gains
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Floor, read_floors, read_robot
from omnimj.simulate.plants import PLANT_NAMES
from omnimj.simulate.scenario.scenario import scenario_digest
from omnimj.studies.tuning.batch import TrialBatch, prepare_folder
from omnimj.studies.tuning.cost import Limits, Score, score, score_unstable, stability_violation
from omnimj.studies.tuning.draws import JUDGING, Draw, draw_trial, read_tuned_scenarios
from omnimj.studies.tuning.landscape import Landscape, survey_landscape
from omnimj.studies.tuning.margins import FLOORS, LoopStability, Margin, loop_stability, margins
from omnimj.studies.tuning.search import (
    Bounds,
    Candidate,
    GainAxis,
    Search,
    axes_of,
    generation_size,
    with_values,
)
from omnimj.studies.workers import Progress, WorkerPool, run_in_workers

# What `omnimj tune` is asked to do.

TWIN = "twin"


@dataclass(frozen=True)
class TuningConfig:
    """What is to be done."""

    out: Path
    """The gains file."""
    scenarios: tuple[str, ...]
    names: tuple[str, ...] = GAIN_NAMES
    """Gains that are tuned."""
    plant: str = "planar"
    seed: int = 0
    """Below 100."""
    trials: int = 4
    """Draws per scenario that candidates are driven with; with four everything goes wrong once."""
    judging: int = 8
    """Draws per scenario that the result is judged with."""
    twin: int = 0
    """The same on the twin, beside those."""
    generations: int = 20
    landscape: int = 7
    """Points per side of the pictures of the cost; 0: none."""
    limits: Limits = field(default_factory=Limits)
    workers: int = 1
    force: bool = False
    """Whether the trials of another order may be replaced."""
    model: Path | None = None
    """Of the robot; the shipped one when None."""
    bounds: Bounds = field(default_factory=dict)
    """Of gains that may go less far than a factor of `search.WIDEST_FACTOR` either way."""
    gains: Gains | None = None
    """Before the search; those of the model and the shipped ones when None."""

    thresholds: Thresholds | None = None
    """Of the method; the shipped ones when None."""

    @property
    def before(self) -> Gains:
        """Gains before the search."""
        return Gains(read_robot(self.model).control) if self.gains is None else self.gains

    @property
    def changed(self) -> dict[str, float]:
        """Those of them that are not the model's or the shipped ones, by their names."""
        usual = gains_by_name(Gains(read_robot(self.model).control))
        return {name: value for name, value in gains_by_name(self.before).items() if value != usual[name]}

    @property
    def folder(self) -> Path:
        """Of the trials."""
        return self.out.with_name(f"{self.out.stem}_trials")

    def plan(self) -> dict[str, Any]:
        """What must be alike for kept trials to be gone on with; more generations are added to them."""
        return {
            "before": gains_by_name(self.before),
            "scenarios": list(self.scenarios),
            "digests": [
                scenario_digest(text, scenario)
                for text, scenario in read_tuned_scenarios(self.scenarios, self.model).items()
            ],
            "names": list(self.names),
            "plant": self.plant,
            "seed": self.seed,
            "trials": self.trials,
            "limits": [self.limits.saturation, self.limits.phase_margin, self.limits.overshoot],
            "thresholds": dataclasses.asdict(self.thresholds or Thresholds()),
            "bounds": {name: [repr(end) for end in ends] for name, ends in self.bounds.items()},
            "model": None if self.model is None else str(self.model),
            "version": omnimj.__version__,
        }


def check_config(order: TuningConfig) -> None:
    """Whether what is named in it exists.

    Raises:
      UnknownNameError: A plant or scenario that does not exist.
      InputError: A scenario that cannot be tuned with, a gain that is 0, or the twin asked for twice.
    """
    if order.plant not in PLANT_NAMES:
        raise UnknownNameError("--plant", "plant", order.plant, PLANT_NAMES)
    if order.twin and order.plant == TWIN:
        raise InputError("--twin", f"found {order.twin}", "--plant twin judges there already, with --judging")
    read_tuned_scenarios(order.scenarios, order.model)
    axes_of(order.before, order.names, order.bounds)


def gains_by_name(gains: Gains) -> dict[str, float]:
    """All of them."""
    return {name: gains.value(name) for name in GAIN_NAMES}


def generations_for(evaluations: int, names: Sequence[str]) -> int:
    """Whole generations that a number of candidates makes, at least one."""
    return max(1, evaluations // generation_size(len(names)))


@dataclass(frozen=True)
class ScoredCandidate:
    """A candidate and its score on the training draws."""

    generation: int
    """From 1; 0: the gains before; beyond the last: the middle of the search, and what was put back."""
    values: Candidate
    score: Score


@dataclass(frozen=True)
class Comparison:
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
class TuningResult:
    """What came of it."""

    order: TuningConfig
    axes: tuple[GainAxis, ...]
    gains: Gains
    """Those found."""
    values: Candidate
    """The same along the axes."""
    tried: tuple[ScoredCandidate, ...]
    verdicts: tuple[Comparison, ...]
    """On the order's plant, and on the twin where that was asked for too."""
    landscapes: tuple[Landscape, ...]
    margins_before: tuple[Margin, ...]
    margins_after: tuple[Margin, ...]

    @property
    def is_better(self) -> bool:
        """Whether it is better wherever it was judged."""
        return all(verdict.is_better for verdict in self.verdicts)


def run_tuning(
    order: TuningConfig, report: Progress, executor: Executor | None = None
) -> TuningResult | None:
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
    check_config(order)
    folder = prepare_folder(order.folder, order.plan(), order.force)
    found: list[TuningResult] = []

    def work(workers: WorkerPool) -> None:
        found.append(_Tuning(order, workers, folder, report).run())

    run_in_workers(work, order.workers, executor)
    return found[0] if found else None


class _Tuning:
    """One order under way."""

    def __init__(self, order: TuningConfig, workers: WorkerPool, folder: Path, report: Progress):
        self._order, self._report = order, report
        self._robot = read_robot(order.model)
        self._before = order.before
        self.axes = axes_of(self._before, order.names, order.bounds)
        self._start: Candidate = tuple(axis.start for axis in self.axes)
        self._scenarios = read_tuned_scenarios(order.scenarios, order.model)
        self._bench = TrialBatch(folder, self.axes, order.changed, order.thresholds, workers, self._tell)
        self._floors = _measured_floors()
        self._phrase, self._done, self._share = "", 0.0, 0.0
        self._loops_before = self._loops(self._start)
        self._draws = self._drawn(order.seed, order.trials, order.plant)
        self.tried: list[ScoredCandidate] = []

    def run(self) -> TuningResult:
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
            landscapes = survey_landscape(self.axes, best.values, self.tried, order.landscape, self._near)
        gains = with_values(self._before, self.axes, best.values)
        return TuningResult(
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
        self.tried = [ScoredCandidate(0, self._start, self._scores([self._start], self._draws)[0])]
        for plant, count in self._judges():  # what breaks down there does so now, not after hours
            self._scores([self._start], self._drawn(self._order.seed + JUDGING, count, plant))
        for generation in range(1, generations + 1):
            best = min(one.score.fitness for one in self.tried)
            self._step(f"{generation} of {generations}, best {best:.3g}", each)
            asked = search.ask()
            scores = self._scores(asked, self._draws)
            self.tried += [ScoredCandidate(generation, *pair) for pair in zip(asked, scores, strict=True)]
            search.tell([one.fitness for one in scores])
            if search.is_over:
                break
        self._step("middle", each)
        self.tried.append(
            ScoredCandidate(generations + 1, search.middle, self._scores([search.middle], self._draws)[0])
        )

    def _settled(self, best: ScoredCandidate) -> ScoredCandidate:
        """The best one with every gain that makes no difference where it was before the search.

        A gain that these draws do not feel drifts with those that they do; one after the other, that which
        went least far first, is put back, and stays there if nothing is lost by it.
        """
        far = [abs(axis.place(value)) for axis, value in zip(self.axes, best.values, strict=True)]
        for k in sorted(range(len(far)), key=far.__getitem__):
            values = tuple(self._start[j] if j == k else value for j, value in enumerate(best.values))
            if values == best.values:
                continue
            back = ScoredCandidate(
                self._order.generations + 1, values, self._scores([values], self._draws)[0]
            )
            self.tried.append(back)
            if not best.score.is_better_than(back.score):
                best = back
        return best

    def _judges(self) -> list[tuple[str, int]]:
        """Plants to be judged on, and with how many draws per scenario."""
        order = self._order
        return [(order.plant, order.judging), *([(TWIN, order.twin)] if order.twin else [])]

    def _judged(self, values: Candidate, plant: str, count: int) -> Comparison:
        seed = self._order.seed + JUDGING
        draws = self._drawn(seed, count, plant)
        after, before = self._scores([values, self._start], draws)
        return Comparison(plant, seed, len(draws), before, after)

    def _near(self, candidates: Sequence[Candidate]) -> list[Score]:
        """Scores on a part of the training draws: those of the two shortest scenarios."""
        shortest = sorted(self._scenarios, key=lambda text: self._scenarios[text].duration)[:2]
        return self._scores(candidates, [d for d in self._draws if d.scenario in shortest])

    def _scores(self, candidates: Sequence[Candidate], draws: Sequence[Draw]) -> list[Score]:
        """Score of each; a candidate whose loops are not steady enough is not driven."""
        limits = self._order.limits
        loops = {one: self._loops(one) for one in candidates}
        driven = [
            one for one in candidates if one == self._start or not stability_violation(loops[one], limits)
        ]
        facts = dict(zip(driven, self._bench.drive(driven, draws, "trials"), strict=True))
        before = self._bench.drive([self._start], draws, "trials")[0]
        broken = [one.broke for one in before if one.broke is not None]
        if broken:
            raise InputError("omnimj tune", "the gains before broke a run down", broken[0])
        return [
            score(facts[one], before, loops[one], self._loops_before, limits, self.axes, one)
            if one in facts
            else score_unstable(loops[one], limits)
            for one in candidates
        ]

    def _loops(self, values: Candidate) -> LoopStability:
        gains = with_values(self._before, self.axes, values)
        return loop_stability(self._robot, gains.control, self._floors)

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
