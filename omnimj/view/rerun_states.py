"""The fault states of a Rerun recording: what was broken, what was believed, and the mode over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from omnimj.control.recovery.modes import NAMES, NORMAL
from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.timeline import time_column
from omnimj.view.wording import (
    RECOVERY,
    Span,
    diagnosis_spans,
    fault_spans,
    is_diagnosed,
    mode_name,
    recovery_spans,
)

Array = NDArray[np.float64]
TRUTH, BELIEF, MODE = "fault", "diagnosis", "mode"
FINE, AS_PLANNED = "healthy", NAMES[NORMAL]


def log_states(
    stream: rr.RecordingStream, trace: Trace, metrics: Mapping[str, Any], wheels: int, is_rig: bool
) -> None:
    """What was broken and what the controller believed, a lane per wheel; the controller's mode.

    Args:
      stream: Where to log.
      trace: The whole run; its first row alone shows that nothing has happened yet.
      metrics: Content of `metrics.json`, as far as it is known.
      wheels: n.
      is_rig: Whether the machine is the test rig.
    """
    duration = float(trace["time"][-1])
    _log_lanes(stream, TRUTH, fault_spans(metrics, duration), wheels)
    if is_diagnosed(metrics):
        _log_lanes(stream, BELIEF, diagnosis_spans(metrics, duration), wheels)
    if "mode" in trace:
        _log_mode(stream, trace, str(metrics.get("method")), is_rig)
    if RECOVERY in trace:
        times, states = lane_states(recovery_spans(trace))
        log_lane(stream, RECOVERY, times, [AS_PLANNED if state == FINE else state for state in states])


def eventful_lanes(metrics: Mapping[str, Any], duration: float) -> list[str]:
    """Entities of the lanes in which something happens; all where nothing does.

    A wheel with a fault also has its lane of beliefs, empty or not.

    Args:
      metrics: Content of `metrics.json`.
      duration: Of the run [s].
    """
    true = {span.lane for span in fault_spans(metrics, duration)}
    named = true | {span.lane for span in diagnosis_spans(metrics, duration)}
    lanes = [f"/{TRUTH}/{lane}" for lane in sorted(true)] + [f"/{BELIEF}/{lane}" for lane in sorted(named)]
    return [*(lanes or (f"/{TRUTH}/**", f"/{BELIEF}/**")), f"/{MODE}", f"/{RECOVERY}"]


def _log_lanes(stream: rr.RecordingStream, entity: str, spans: Sequence[Span], wheels: int) -> None:
    all_wheels = {f"wheel_{i}" for i in range(1, wheels + 1)}
    for lane in sorted({span.lane for span in spans} | all_wheels):
        times, states = lane_states([span for span in spans if span.lane == lane])
        log_lane(stream, f"{entity}/{lane}", times, states)


def log_lane(stream: rr.RecordingStream, entity: str, times: Array, states: list[str]) -> None:
    """One lane of the state timeline; a state has the same colour in every lane."""
    values = sorted(set(states), key=lambda state: (state != FINE, state))
    colors = [(*palette.rgb(palette.state_color(state)), 255) for state in values]
    stream.log(entity, rr.StateConfiguration(values=values, labels=values, colors=colors), static=True)
    stream.send_columns(entity, [time_column(times)], rr.StateChange.columns(state=states))


def lane_states(spans: Sequence[Span]) -> tuple[Array, list[str]]:
    """Times of change and the state from then on; faults that hold at once are joined by `+`."""
    times = sorted({0.0, *(span.start for span in spans), *(span.end for span in spans)})
    states = []
    for time in times:
        held = [span.state for span in spans if span.start <= time < span.end]
        states.append(" + ".join(dict.fromkeys(held)) or FINE)
    return np.array(times), states


def _log_mode(stream: rr.RecordingStream, trace: Trace, method: str, is_rig: bool) -> None:
    mode = trace["mode"].astype(int)
    rows = np.concatenate([[0], np.flatnonzero(np.diff(mode)) + 1])
    states = [mode_name(method, is_rig, value) for value in mode[rows].tolist()]
    log_lane(stream, MODE, trace["time"][rows], states)
