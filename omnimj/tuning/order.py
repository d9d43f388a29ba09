"""What `omnimj tune` is asked to do."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import omnimj
from omnimj.control.gains import NAMES, Gains
from omnimj.control.robust.verdict import Thresholds
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_robot
from omnimj.scenario.digest import digest_of
from omnimj.scenario.plants import PLANT_NAMES
from omnimj.tuning.cost import Limits
from omnimj.tuning.draws import read_tuned_scenarios
from omnimj.tuning.search import generation_size
from omnimj.tuning.space import Bounds, axes_of

TWIN = "twin"


@dataclass(frozen=True)
class Order:
    """What is to be done."""

    out: Path
    """The gains file."""
    scenarios: tuple[str, ...]
    names: tuple[str, ...] = NAMES
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
    """Of gains that may go less far than a factor of `space.WIDEST` either way."""
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
        usual = by_name(Gains(read_robot(self.model).control))
        return {name: value for name, value in by_name(self.before).items() if value != usual[name]}

    @property
    def folder(self) -> Path:
        """Of the trials."""
        return self.out.with_name(f"{self.out.stem}_trials")

    def plan(self) -> dict[str, Any]:
        """What must be alike for kept trials to be gone on with; more generations are added to them."""
        return {
            "before": by_name(self.before),
            "scenarios": list(self.scenarios),
            "digests": [
                digest_of(text, scenario)
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


def check_order(order: Order) -> None:
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


def by_name(gains: Gains) -> dict[str, float]:
    """All of them."""
    return {name: gains.value(name) for name in NAMES}


def evaluations_to_generations(evaluations: int, names: Sequence[str]) -> int:
    """Whole generations that a number of candidates makes, at least one."""
    return max(1, evaluations // generation_size(len(names)))
