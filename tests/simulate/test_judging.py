"""What diagnoses are worth: every rule of `omnimj.simulate.judging` as a sentence."""

from __future__ import annotations

from typing import Any

import pytest

from omnimj.simulate.judging import GRACE, judge_diagnoses


def fault(kind: str, wheel: int | None, onset: float | None, end: float | None = None, **own: Any) -> dict:
    return {"kind": kind, "wheel": wheel, "onset": onset, "end": end, **own}


def diagnosis(
    time: float, kind: str, *wheels: int, cleared: float | None = None, also: tuple[str, ...] = (), **own: Any
) -> dict:
    common = {"confidence": 1.0, "effectiveness": None, "ambiguous_with": also, "cleared": cleared}
    return {"time": time, "kind": kind, "wheels": wheels, **common, **own}


def test_without_diagnoses_and_without_faults_there_is_no_alarm():
    verdict = judge_diagnoses([], [])
    assert (verdict.detection_delay, verdict.isolated, verdict.false_alarms) == (None, None, 0)


def test_a_fault_without_a_diagnosis_is_neither_detected_nor_isolated():
    verdict = judge_diagnoses([fault("motor", 1, 2.0, loss=0.57)], [])
    assert (verdict.detection_delay, verdict.isolated, verdict.false_alarms) == (None, False, 0)
    assert verdict.named == (False,)


def test_the_right_name_detects_and_isolates():
    verdict = judge_diagnoses([fault("motor", 1, 2.0, loss=0.57)], [diagnosis(2.3, "motor", 1)])
    assert verdict.detection_delay == pytest.approx(0.3)
    assert verdict.isolated
    assert verdict.false_alarms == 0


@pytest.mark.parametrize("name", [("motor", 3), ("slip", 1), ("locked", 1), ("sensor", 1)])
def test_a_wrong_name_detects_but_isolates_nothing_and_is_a_false_alarm(name: tuple[str, int]):
    verdict = judge_diagnoses([fault("motor", 1, 2.0, loss=0.57)], [diagnosis(2.3, *name)])
    assert verdict.detection_delay == pytest.approx(0.3)
    assert verdict.isolated is False
    assert verdict.false_alarms == 1


def test_an_alarm_before_the_onset_is_false_and_detects_nothing():
    verdict = judge_diagnoses([fault("motor", 1, 2.0, loss=0.57)], [diagnosis(1.9, "motor", 1)])
    assert (verdict.detection_delay, verdict.isolated, verdict.false_alarms) == (None, False, 1)


def test_an_alarm_before_the_onset_does_not_spoil_what_is_isolated_later():
    verdict = judge_diagnoses(
        [fault("motor", 1, 2.0, loss=0.57)], [diagnosis(1.0, "slip", 2), diagnosis(2.1, "motor", 1)]
    )
    assert verdict.isolated
    assert verdict.false_alarms == 1


@pytest.mark.parametrize(
    ("true", "name"),
    [
        (fault("free", 2, 1.0), "motor"),
        (fault("motor", 2, 1.0, loss=0.95), "free"),
        (fault("motor", 2, 1.0, loss=1.0), "motor"),
        (fault("motor", 2, 1.0, braking_torque=0.02), "motor"),
    ],
)
def test_a_motor_without_torque_and_a_free_wheel_are_alike(true: dict, name: str):
    assert judge_diagnoses([true], [diagnosis(1.5, name, 2)]).isolated


@pytest.mark.parametrize(
    "true", [fault("motor", 2, 1.0, loss=0.94), fault("motor", 2, 1.0, braking_torque=0.02)]
)
def test_a_motor_with_torque_is_not_free(true: dict):
    verdict = judge_diagnoses([true], [diagnosis(1.5, "free", 2)])
    assert (verdict.isolated, verdict.false_alarms) == (False, 1)


@pytest.mark.parametrize("kind", ["payload", "slope", "misalignment", "wheel_radius", "demand_lost"])
def test_what_is_no_fault_to_diagnose_makes_every_diagnosis_false(kind: str):
    verdict = judge_diagnoses([fault(kind, 1, 1.0)], [diagnosis(1.5, "motor", 1)])
    assert (verdict.detection_delay, verdict.isolated, verdict.false_alarms) == (None, None, 1)


@pytest.mark.parametrize(("late", "false_alarms"), [(GRACE - 0.01, 0), (GRACE + 0.01, 1)])
def test_a_fault_may_be_named_until_shortly_after_its_end(late: float, false_alarms: int):
    verdict = judge_diagnoses([fault("slip", 1, 1.0, 2.0, grip=0.2)], [diagnosis(2.0 + late, "slip", 1)])
    assert verdict.false_alarms == false_alarms
    assert verdict.isolated is (false_alarms == 0)
    assert (verdict.detection_delay is None) is (false_alarms == 1)


def test_every_fault_must_be_named():
    faults = [fault("motor", 1, 1.0, loss=0.5), fault("slip", 3, 2.0, 3.0, floor="nylon")]
    one = judge_diagnoses(faults, [diagnosis(1.2, "motor", 1)])
    both = judge_diagnoses(faults, [diagnosis(1.2, "motor", 1), diagnosis(2.2, "slip", 3, cleared=3.1)])
    assert (one.isolated, one.named) == (False, (True, False))
    assert (both.isolated, both.named, both.false_alarms) == (True, (True, True), 0)


def test_something_more_than_the_truth_is_not_isolated_unless_it_is_taken_back_soon():
    faults = [fault("motor", 1, 1.0, loss=0.5)]
    stays = judge_diagnoses(faults, [diagnosis(1.1, "slip", 1), diagnosis(1.2, "motor", 1)])
    goes = judge_diagnoses(faults, [diagnosis(1.1, "slip", 1, cleared=1.2), diagnosis(1.2, "motor", 1)])
    assert (stays.isolated, stays.false_alarms) == (False, 1)
    assert (goes.isolated, goes.false_alarms) == (True, 1)


def test_wrong_names_that_come_and_go_add_up():
    faults = [fault("motor", 1, 1.0, loss=0.5)]
    flicker = [diagnosis(1.1 + 0.2 * k, "slip", 2, cleared=1.2 + 0.2 * k) for k in range(8)]
    verdict = judge_diagnoses(faults, [diagnosis(1.05, "motor", 1), *flicker])
    assert (verdict.isolated, verdict.false_alarms) == (False, 8)
    assert judge_diagnoses(faults, [diagnosis(1.05, "motor", 1), *flicker[:4]]).isolated


def test_a_diagnosis_of_two_wheels_names_both_or_neither():
    faults = [fault("motor", 1, 1.0, loss=0.5), fault("motor", 2, 1.0, loss=0.5)]
    assert judge_diagnoses(faults, [diagnosis(1.2, "motor", 1, 2)]).isolated
    verdict = judge_diagnoses(faults[:1], [diagnosis(1.2, "motor", 1, 2)])
    assert (verdict.isolated, verdict.false_alarms) == (False, 1)


def test_an_ambiguous_answer_with_the_truth_in_it_is_right_but_isolates_nothing():
    faults = [fault("motor", 3, 1.0, loss=0.5)]
    verdict = judge_diagnoses(faults, [diagnosis(1.2, "motor", 1, also=("motor 3",))])
    assert (verdict.isolated, verdict.false_alarms) == (False, 0)
    assert verdict.detection_delay == pytest.approx(0.2)
    wrong = judge_diagnoses(faults, [diagnosis(1.2, "motor", 1, also=("motor 2",))])
    assert wrong.false_alarms == 1


def test_slip_of_any_wheel_is_right_while_all_slip_but_does_not_name_it():
    faults = [fault("all_wheel_slip", None, 1.0, floor="oil")]
    one = judge_diagnoses(faults, [diagnosis(1.2, "slip", 2)])
    assert (one.isolated, one.false_alarms) == (False, 0)
    assert judge_diagnoses(faults, [diagnosis(1.2, "all_wheel_slip")]).isolated
    assert judge_diagnoses(faults, [diagnosis(1.2, "slip", 1, 2, 3, 4)]).isolated


def test_all_wheels_on_a_patch_is_all_wheel_slip():
    faults = [fault("slip", i, 1.0 + 0.1 * i, floor="oil") for i in range(1, 5)]
    verdict = judge_diagnoses(faults, [diagnosis(1.5, "all_wheel_slip")])
    assert (verdict.isolated, verdict.false_alarms) == (True, 0)
    assert judge_diagnoses(faults[:3], [diagnosis(1.5, "all_wheel_slip")]).false_alarms == 1


def test_sensor_faults_are_distinguished_by_their_channel():
    faults = [fault("sensor", None, 1.0, channel="yaw_rate", mode="bias", size=0.1)]
    right = judge_diagnoses(faults, [diagnosis(1.2, "sensor", channel="yaw_rate")])
    wrong = judge_diagnoses(faults, [diagnosis(1.2, "sensor", channel="acceleration_x")])
    assert (right.isolated, right.false_alarms) == (True, 0)
    assert (wrong.isolated, wrong.false_alarms) == (False, 1)
    also = judge_diagnoses(faults, [diagnosis(1.2, "motor", 1, also=("sensor yaw_rate",))])
    assert also.false_alarms == 0


def test_a_standing_name_holds_for_the_next_stay_on_a_patch():
    faults = [fault("slip", 1, 1.0, 1.5, floor="nylon"), fault("slip", 1, 2.0, 2.5, floor="nylon")]
    assert judge_diagnoses(faults, [diagnosis(1.1, "slip", 1)]).isolated
    assert judge_diagnoses(faults, [diagnosis(1.1, "slip", 1, cleared=1.6)]).isolated is False


def test_a_fault_that_never_came_is_none():
    verdict = judge_diagnoses([fault("slip", 1, None, floor="nylon")], [])
    assert (verdict.detection_delay, verdict.isolated) == (None, None)


def test_the_delay_counts_from_the_first_onset_whatever_the_order():
    faults = [fault("slip", 1, 3.0, grip=0.2), fault("motor", 2, 1.0, loss=0.5)]
    verdict = judge_diagnoses(faults, [diagnosis(3.2, "slip", 1), diagnosis(1.4, "motor", 2)])
    assert verdict.detection_delay == pytest.approx(0.4)
    assert verdict.isolated
