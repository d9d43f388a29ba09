"""What recovery did is seen beside truth and belief."""

from __future__ import annotations

import numpy as np

from omnimj.control.recovery.modes import COMPENSATING, MODE_NAMES, NORMAL, PIVOTING
from omnimj.signals import Trace
from omnimj.view.plots.diagnosis import state_lanes
from omnimj.view.wording import RECOVERY, recovery_spans

TIME = np.arange(0.0, 10.0, 0.1)
MODES = np.where(TIME < 3.0, NORMAL, np.where(TIME < 5.0, COMPENSATING, PIVOTING)).astype(float)
TRACE = Trace({"time": TIME, "recovery": MODES, "mode": np.zeros(len(TIME))})


def test_every_stretch_of_recovery_is_a_span_and_driving_as_planned_is_none():
    first, second = recovery_spans(TRACE)
    assert (first.state, second.state) == (MODE_NAMES[COMPENSATING], MODE_NAMES[PIVOTING])
    assert np.allclose((first.start, first.end, second.start, second.end), (3.0, 5.0, 5.0, 9.9))
    assert first.lane == second.lane == RECOVERY
    assert recovery_spans(Trace({"time": TIME})) == []
    assert recovery_spans(Trace({"time": TIME, "recovery": 0.0 * TIME})) == []


def test_the_report_has_a_strip_for_it():
    (axis,) = state_lanes(TRACE, [], [], "robust", False).axes
    labels = [label.get_text() for label in axis.get_yticklabels()]
    assert "done: recovery" in labels
    written = {text.get_text() for text in axis.texts}
    assert MODE_NAMES[PIVOTING] in written
