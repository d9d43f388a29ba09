"""Which conditions the user wants held out."""

from __future__ import annotations

from collections.abc import Sequence

from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.dataset import Run


def held_out_conditions(names: Sequence[str], runs: Sequence[Run]) -> tuple[str, ...]:
    """The conditions of the named runs; a repeat that stayed behind would give the answer away.

    Args:
      names: Of runs or of conditions.
      runs: All runs of the dataset.

    Returns:
      Conditions in the order of the runs, each once.

    Raises:
      UnknownNameError: A name that is neither.
      InputError: Nothing is left to fit to.
    """
    known = {run.name for run in runs} | {run.condition for run in runs}
    for name in names:
        if name not in known:
            raise UnknownNameError("--holdout", "run or condition", name, sorted(known))
    wanted = {run.condition for run in runs if run.name in names or run.condition in names}
    if wanted and all(run.condition in wanted for run in runs):
        raise InputError(
            "--holdout", f"holds out all {len(runs)} runs", "one condition at least is needed to fit to"
        )
    return tuple(dict.fromkeys(run.condition for run in runs if run.condition in wanted))
