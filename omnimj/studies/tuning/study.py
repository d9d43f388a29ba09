"""Tuning study, `omnimj tune`: search gains over randomised runs, then compare them on other seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import omnimj
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.gains import GAIN_NAMES, Gains
from omnimj.display import Displayed
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Floor, read_floors, read_robot
from omnimj.recording.tabular import Tabular
from omnimj.simulate.plants import PLANT_NAMES
from omnimj.simulate.scenario.scenario import scenario_digest
from omnimj.studies.runner import run_study
from omnimj.studies.tuning.cost import (
    TERMS,
    Landscape,
    Limits,
    Score,
    score,
    score_unstable,
    stability_violation,
    survey_landscape,
)
from omnimj.studies.tuning.draws import JUDGING, Draw, draw_trial, read_tuned_scenarios
from omnimj.studies.tuning.margins import FLOORS, LoopStability, Margin, loop_stability, margins
from omnimj.studies.tuning.search import (
    Bounds,
    Candidate,
    GainAxis,
    Search,
    axes_of,
    generation_size,
    require_cma,
    with_values,
)
from omnimj.studies.tuning.trial import TrialBatch, claim_folder
from omnimj.studies.workers import Progress, WorkerPool

TWIN = "twin"


@dataclass(frozen=True)
class TuningConfig:
    """Settings of a tuning."""

    out: Path
    """Path of the gains file; trials are stored in a folder next to it."""
    scenarios: tuple[str, ...]
    names: tuple[str, ...] = GAIN_NAMES
    """Names of the gains to tune."""
    plant: str = "planar"
    seed: int = 0
    """Seed of the training draws, below 100."""
    trials: int = 4
    """Training draws per scenario; every four of them contain each kind of fault once."""
    judging: int = 8
    """Judging draws per scenario."""
    twin: int = 0
    """Judging draws per scenario on the twin, in addition."""
    generations: int = 20
    landscape: int = 7
    """Grid points per side of the cost landscapes; 0: none."""
    limits: Limits = field(default_factory=Limits)
    workers: int = 1
    force: bool = False
    """Replace the trials of another configuration."""
    model: Path | None = None
    """Model file of the robot; the shipped one when None."""
    bounds: Bounds = field(default_factory=dict)
    """Bounds of gains that are limited more tightly than by the factor `search.WIDEST_FACTOR`."""
    gains: Gains | None = None
    """Gains before the search; those of the model and the shipped ones when None."""
    thresholds: Thresholds | None = None
    """Thresholds of the diagnosis method; the shipped ones when None."""

    @property
    def before(self) -> Gains:
        """Gains before the search."""
        return Gains(read_robot(self.model).control) if self.gains is None else self.gains

    @property
    def changed(self) -> dict[str, float]:
        """Gains before the search that differ from the model's or the shipped ones, by name."""
        usual = gains_by_name(Gains(read_robot(self.model).control))
        return {name: value for name, value in gains_by_name(self.before).items() if value != usual[name]}

    @property
    def folder(self) -> Path:
        """Folder of the trials."""
        return self.out.with_name(f"{self.out.stem}_trials")

    def plan(self) -> dict[str, Any]:
        """Return the settings that stored trials depend on; more generations add to them."""
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
            "thresholds": (self.thresholds or Thresholds())._asdict(),
            "bounds": {name: [repr(end) for end in ends] for name, ends in self.bounds.items()},
            "model": None if self.model is None else str(self.model),
            "version": omnimj.__version__,
        }


def check_config(config: TuningConfig) -> None:
    """Check that all names in the configuration exist and that its scenarios are suitable for tuning.

    Raises:
      UnknownNameError: A plant or scenario does not exist.
      InputError: A scenario is not suitable for tuning, a gain is 0, or the twin would be evaluated twice.
      MissingLibrary: The library of the search is not installed.
    """
    if config.plant not in PLANT_NAMES:
        raise UnknownNameError("--plant", "plant", config.plant, PLANT_NAMES)
    if config.twin and config.plant == TWIN:
        rule = "--plant twin judges on it already, with --judging"
        raise InputError("--twin", f"found {config.twin}", rule)
    read_tuned_scenarios(config.scenarios, config.model)
    axes_of(config.before, config.names, config.bounds)
    require_cma()


def gains_by_name(gains: Gains) -> dict[str, float]:
    """Return all gains by name."""
    return {name: gains.value(name) for name in GAIN_NAMES}


def generations_for(evaluations: int, names: Sequence[str]) -> int:
    """Return the number of complete generations for a number of candidates, at least one."""
    return max(1, evaluations // generation_size(len(names)))


@dataclass(frozen=True)
class ScoredCandidate:
    """Candidate with its score on the training draws."""

    generation: int
    """Generation from 1 on; 0: the gains before; after the last: the mean of the search distribution, and
    candidates with gains reset."""
    values: Candidate
    score: Score


@dataclass(frozen=True)
class Comparison:
    """Scores of the gains before and after, on draws that were not used for tuning."""

    plant: str
    seed: int
    draws: int
    before: Score
    after: Score

    @property
    def is_better(self) -> bool:
        """True if the tuned gains are better than those before."""
        return self.after.is_better_than(self.before)


@dataclass(frozen=True)
class TuningResult(Displayed, Tabular):
    """Tuned gains with all scores on the way."""

    config: TuningConfig
    axes: tuple[GainAxis, ...]
    gains: Gains
    """The tuned gains."""
    values: Candidate
    """The tuned gains along the axes."""
    tried: tuple[ScoredCandidate, ...]
    comparisons: tuple[Comparison, ...]
    """Comparison on the configured plant and, if requested, on the twin."""
    landscapes: tuple[Landscape, ...]
    margins_before: tuple[Margin, ...]
    margins_after: tuple[Margin, ...]

    @property
    def is_better(self) -> bool:
        """True if the tuned gains are better in every comparison."""
        return all(comparison.is_better for comparison in self.comparisons)

    def table_columns(self) -> Mapping[str, Sequence[Any]]:
        """Generation, gains, score and its terms by name, a row per candidate that was tried."""
        columns: dict[str, Sequence[Any]] = {"generation": [one.generation for one in self.tried]}
        for k, axis in enumerate(self.axes):
            columns[axis.name] = [one.values[k] for one in self.tried]
        for name in ("cost", "violation", "false_alarms", "missed", "saturation", "broke"):
            columns[name] = [getattr(one.score, name) for one in self.tried]
        for name in ("phase", "overshoot"):
            columns[name] = [getattr(one.score.loops, name) for one in self.tried]
        for name in TERMS:
            columns[name] = [one.score.terms.get(name) for one in self.tried]
        return columns


def run_tuning(
    config: TuningConfig, report: Progress, executor: Executor | None = None
) -> TuningResult | None:
    """Search gains, compare them with those before, survey the cost around them; None after Ctrl-C.

    Arguments and errors as for `run_study`; a trial that fails is a SimulationError, too.
    """
    return run_study(_Tuning(config), report, executor)


class _Tuning:
    """Steps of a tuning for the study runner."""

    def __init__(self, config: TuningConfig):
        self.config, self.workers = config, config.workers
        self._result: TuningResult | None = None

    def prepare(self) -> None:
        check_config(self.config)
        claim_folder(self.config.folder, self.config.plan(), self.config.force)

    def work(self, pool: WorkerPool, report: Progress) -> None:
        self._result = _Steps(self.config, pool, report).run()

    def judge(self, interrupted: bool) -> TuningResult | None:
        return None if interrupted else self._result


class _Steps:
    """Sequence of a tuning: search, reset of gains without effect, comparison, survey of the cost."""

    def __init__(self, config: TuningConfig, pool: WorkerPool, report: Progress):
        self._config, self._report = config, report
        self._robot = read_robot(config.model)
        self._before = config.before
        self.axes = axes_of(self._before, config.names, config.bounds)
        self._start: Candidate = tuple(axis.start for axis in self.axes)
        self._scenarios = read_tuned_scenarios(config.scenarios, config.model)
        self._batch = TrialBatch(
            config.folder, self.axes, config.changed, config.thresholds, pool, self._report_step
        )
        self._floors = _measured_floors()
        self._phrase, self._done, self._share = "", 0.0, 0.0
        self._loops_before = self._loops(self._start)
        self._draws = self._make_draws(config.seed, config.trials, config.plant)
        self.tried: list[ScoredCandidate] = []

    def run(self) -> TuningResult:
        config = self._config
        self._search()
        self._begin_step("putting back gains without effect", 0.05)
        best = self._revert_indifferent(
            min(self.tried, key=lambda one: (one.score.violation, one.score.cost))
        )
        self._begin_step("judging", 0.05)
        comparisons = [self._compare(best.values, plant, count) for plant, count in self._judges()]
        self._begin_step("surveying the cost", 0.15)
        landscapes: tuple[Landscape, ...] = ()
        if config.landscape:
            landscapes = survey_landscape(
                self.axes, best.values, self.tried, config.landscape, self._survey_scores
            )
        gains = with_values(self._before, self.axes, best.values)
        return TuningResult(
            config,
            self.axes,
            gains,
            best.values,
            tuple(self.tried),
            tuple(comparisons),
            landscapes,
            margins(self._robot, self._before.control, self._floors),
            margins(self._robot, gains.control, self._floors),
        )

    def _search(self) -> None:
        config = self._config
        search, generations = Search(self.axes, config.seed), config.generations
        share = 0.75 / (generations + 2)
        self._begin_step("gains before", share)
        self._try([self._start], 0)
        for plant, count in self._judges():  # a failure there should show now, not after hours
            self._scores([self._start], self._make_draws(config.seed + JUDGING, count, plant))
        for generation in range(1, generations + 1):
            best = min(one.score.fitness for one in self.tried)
            self._begin_step(f"{generation} of {generations}, best {best:.3g}", share)
            search.tell([score.fitness for score in self._try(search.ask(), generation)])
            if search.is_over:
                break
        self._begin_step("mean of the search", share)
        self._try([search.middle], generations + 1)

    def _try(self, candidates: Sequence[Candidate], generation: int) -> list[Score]:
        """Score candidates on the training draws and record them."""
        scores = self._scores(candidates, self._draws)
        self.tried += [ScoredCandidate(generation, *pair) for pair in zip(candidates, scores, strict=True)]
        return scores

    def _revert_indifferent(self, best: ScoredCandidate) -> ScoredCandidate:
        """Return the best candidate with every gain without effect reset to its value before.

        A gain without effect on these draws drifts with the others. Gains are reset one after the other, the
        least changed first; a reset is kept unless the score becomes worse.
        """
        distance = [abs(axis.place(value)) for axis, value in zip(self.axes, best.values, strict=True)]
        for k in sorted(range(len(distance)), key=distance.__getitem__):
            values = tuple(self._start[j] if j == k else value for j, value in enumerate(best.values))
            if values == best.values:
                continue
            self._try([values], self._config.generations + 1)
            if not best.score.is_better_than(self.tried[-1].score):
                best = self.tried[-1]
        return best

    def _judges(self) -> list[tuple[str, int]]:
        """Return the plants for the comparison, with the number of draws per scenario."""
        config = self._config
        return [(config.plant, config.judging), *([(TWIN, config.twin)] if config.twin else [])]

    def _compare(self, values: Candidate, plant: str, count: int) -> Comparison:
        seed = self._config.seed + JUDGING
        draws = self._make_draws(seed, count, plant)
        after, before = self._scores([values, self._start], draws)
        return Comparison(plant, seed, len(draws), before, after)

    def _survey_scores(self, candidates: Sequence[Candidate]) -> list[Score]:
        """Return scores on those training draws that belong to the two shortest scenarios."""
        shortest = sorted(self._scenarios, key=lambda text: self._scenarios[text].duration)[:2]
        return self._scores(candidates, [draw for draw in self._draws if draw.scenario in shortest])

    def _scores(self, candidates: Sequence[Candidate], draws: Sequence[Draw]) -> list[Score]:
        """Return the score of each candidate; one whose loops violate the limits is not driven."""
        limits = self._config.limits
        loops = {one: self._loops(one) for one in candidates}
        driven = [
            one for one in candidates if one == self._start or not stability_violation(loops[one], limits)
        ]
        metrics = dict(zip(driven, self._batch.drive(driven, draws), strict=True))
        before = self._batch.drive([self._start], draws)[0]
        broken = [one.broke for one in before if one.broke is not None]
        if broken:
            raise InputError("omnimj tune", "a run with the gains before failed", broken[0])
        return [
            score(metrics[one], before, loops[one], self._loops_before, limits, self.axes, one)
            if one in metrics
            else score_unstable(loops[one], limits)
            for one in candidates
        ]

    def _loops(self, values: Candidate) -> LoopStability:
        gains = with_values(self._before, self.axes, values)
        return loop_stability(self._robot, gains.control, self._floors)

    def _make_draws(self, seed: int, count: int, plant: str) -> list[Draw]:
        return [
            draw_trial(text, scenario, seed, index, plant, self._config.model)
            for index in range(count)
            for text, scenario in self._scenarios.items()
        ]

    def _begin_step(self, phrase: str, share: float) -> None:
        """Name the next step and its share of the whole."""
        self._phrase, self._done, self._share = phrase, self._done + self._share, share

    def _report_step(self, phrase: str, share: float) -> None:
        self._report(f"{self._phrase}: {phrase}", min(self._done + self._share * share, 1.0))


def _measured_floors() -> tuple[Floor, ...]:
    floors = read_floors()
    return tuple(floors[name] for name in FLOORS)
