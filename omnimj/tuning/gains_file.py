"""The file of tuned gains, for `omnimj run --gains`: what was found, and where it comes from."""

from __future__ import annotations

import json
from collections.abc import Iterator

import omnimj
from omnimj.control.gains import NAMES, TABLES, TUNED, unit_of
from omnimj.tuning.tuning import Outcome


def gains_text(outcome: Outcome, command: str) -> str:
    """The file's text; the same trials and command give the same text.

    Args:
      outcome: What was found.
      command: What was typed.
    """
    return "\n".join((*_head(outcome), *_gains(outcome), *_origin(outcome, command))) + "\n"


def _head(outcome: Outcome) -> Iterator[str]:
    yield "# Gains of cascade, recovery and observer: omnimj run SCENARIO --gains THIS_FILE"
    if not outcome.is_better:
        yield "# NOT BETTER than the gains before on the seeds that it was judged with: see [tuned]."
    yield ""


def _gains(outcome: Outcome) -> Iterator[str]:
    """Those that were tuned, and those of the gains before that are not the model's."""
    tuned = {axis.name: axis for axis in outcome.axes}
    told = [name for name in NAMES if name in tuned or name in outcome.order.changed]
    for table in TABLES:
        own = [name for name in told if name.startswith(f"{table}.")]
        if own:
            yield f"[{table}]"
        for name in own:
            value = outcome.gains.value(name)
            source = "tuned" if name in tuned else "chosen"
            entry = f'{{ value = {value!r}, unit = "{unit_of(name)}", source = "{source}" }}'
            words = f"before: {tuned[name].start:g}" if name in tuned else "as before, not searched"
            yield f"{name.partition('.')[2]} = {entry}  # {words}"
        if own:
            yield ""


def _origin(outcome: Outcome, command: str) -> Iterator[str]:
    order = outcome.order
    yield f"[{TUNED}]"
    yield f"command = {_text(command)}"
    yield f"version = {_text(omnimj.__version__)}"
    yield f"scenarios = {json.dumps(list(order.scenarios), ensure_ascii=False)}"
    yield f"plant = {_text(order.plant)}"
    yield f"seed = {order.seed}"
    yield f"trials = {order.trials}  # per scenario and candidate"
    yield f"candidates = {len(outcome.tried)}"
    yield f"saturation_limit = {order.limits.saturation!r}  # s"
    yield f"phase_margin_limit = {order.limits.phase_margin!r}  # degrees"
    yield f"overshoot_limit = {order.limits.overshoot!r}"
    yield f"better = {str(outcome.is_better).lower()}"
    for verdict in outcome.verdicts:
        yield ""
        yield f"[{TUNED}.judged_on_{verdict.plant}]"
        yield f"seed = {verdict.seed}"
        yield f"draws = {verdict.draws}"
        yield f"better = {str(verdict.is_better).lower()}"
        for when, found in (("before", verdict.before), ("after", verdict.after)):
            yield f"cost_{when} = {_number(found.cost)}"
            yield f"violation_{when} = {_number(found.violation)}"
            yield f"false_alarms_{when} = {found.false_alarms}"
            yield f"missed_{when} = {found.missed}"
            yield f"phase_margin_{when} = {_number(found.loops.phase)}  # degrees"
            yield f"overshoot_{when} = {_number(found.loops.overshoot)}"


def _number(value: float) -> str:
    return repr(float(f"{value:.6g}"))


def _text(words: str) -> str:
    # a TOML basic string has JSON's escapes, but for what JSON leaves unescaped
    return json.dumps(words, ensure_ascii=False).replace("\x7f", "\\u007F")
