"""No sequence of events makes current flow without a fresh command of the armed session.

The search is exhaustive for all sequences up to its depth, over the real device in simulated time.
"""

from __future__ import annotations

from typing import Any

import pytest
from make_state_picture import PAGE, updated
from session_model import EVENTS, at_power_up, driving, explore, explored

from omnimj.link.device import limits, state_machine
from omnimj.link.device.state_machine import Device

FROM_POWER_UP, FROM_DRIVING, FROM_DRIVING_AT_NIGHT = 7, 5, 6
"""Numbers of events."""


@pytest.mark.slow
def test_no_sequence_of_events_from_power_up_makes_current_flow_unasked():
    found = explored(FROM_POWER_UP, at_power_up)
    assert found.counterexample == ()
    assert found.states > 4000 and found.moving > 0, "the search has seen a moving robot"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("depth", "states", "moving"),
    [(FROM_DRIVING, 4000, 300), (FROM_DRIVING_AT_NIGHT, 5000, 500)],
)
def test_no_sequence_of_events_while_driving_makes_current_flow_without_a_fresh_command(
    depth, states, moving
):
    found = explored(depth, driving)
    assert found.counterexample == ()
    assert found.states > states and found.moving > moving
    assert set(EVENTS) - found.events == {"replay"}, "all but a replay changes something"


def believes_any_age(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Device, "_age_of_answered", lambda *_: 0.0)


def forgets_the_age_of_commands(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(limits, "check_command_age", lambda *_: None)


def arms_after_a_stop(patch: pytest.MonkeyPatch) -> None:
    right = limits.check_arming
    patch.setattr(
        limits, "check_arming", lambda arm, same, fault, stopped, *a: right(arm, same, fault, False, *a)
    )


def takes_frames_twice(patch: pytest.MonkeyPatch) -> None:
    right = Device.on_frame

    def on_frame(self: Any, *arguments: Any) -> Any:
        self._last_sequence = 0
        return right(self, *arguments)

    patch.setattr(Device, "on_frame", on_frame)


def arms_on_any_command(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(limits, "is_zero_command", lambda command: True)


def drives_on_after_a_stop(patch: pytest.MonkeyPatch) -> None:
    class Deaf(state_machine.Stop):
        pass

    patch.setattr(state_machine, "Stop", Deaf)


BROKEN = (
    (believes_any_age, driving),
    (forgets_the_age_of_commands, driving),
    (arms_after_a_stop, driving),
    (takes_frames_twice, driving),
    (arms_on_any_command, at_power_up),
    (drives_on_after_a_stop, driving),
)
"""Devices and where the way to current begins."""


@pytest.mark.slow
@pytest.mark.parametrize(("broken", "begin"), BROKEN, ids=lambda one: one.__name__)
def test_the_search_finds_the_way_to_current_in_a_device_that(monkeypatch, broken, begin):
    broken(monkeypatch)
    assert explore(5 if begin is driving else 6, begin).counterexample


@pytest.mark.slow
def test_the_page_of_threats_shows_the_states_that_the_device_has():
    text = PAGE.read_text(encoding="utf-8")
    assert updated(text) == text, "run tests/link/device/make_state_picture.py"
