"""Uneventful blocks are judged by a kernel alone: nothing may be lost by that."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnimj.control.detection.robust.accommodation import accommodate, known_faults
from omnimj.control.detection.robust.answered import answered_by, is_answered
from omnimj.control.detection.robust.decision import decide, is_uneventful
from omnimj.control.detection.robust.evidence import CONVERTER, ROLLED, initial_evidence
from omnimj.control.detection.robust.judgement import initial_judgement
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.detection.robust.verdict import (
    LOOKBACK,
    Verdict,
    archive_cleared,
    is_stalled,
    with_diagnosis,
)
from omnimj.control.records import packed
from omnimj.physics.native import kernel
from omnimj.signals import Diagnosis, robot_channels

THRESHOLDS = Thresholds()
AS_FLOATS = Thresholds._make(map(float, THRESHOLDS))
CHANNELS = robot_channels(4)[:-1]
MONITORS = {
    "slipped": THRESHOLDS.slip,
    "implausible": THRESHOLDS.odd,
    "stuck": THRESHOLDS.stuck,
    "stalled": THRESHOLDS.stuck,
    "silent": THRESHOLDS.current,
    "disobeying": THRESHOLDS.current,
}
near = st.sampled_from([0.0, 0.0, 0.0, 0.5, 0.9, 0.999, 1.0, 1.001, 3.0])


@st.composite
def evidences(draw):
    """Evidence whose statistics lie around their thresholds, most of them well below."""
    evidence, shares = initial_evidence(4), iter(lambda: draw(near), None)
    body = [THRESHOLDS.accelerometer] * 2
    limits = np.array([THRESHOLDS.motor] * 4 + [THRESHOLDS.drag] * 4 + body)
    evidence.scores.likelihood[:] = [limit * next(shares) for limit in limits]
    for name, limit in MONITORS.items():
        getattr(evidence.monitors, name)[draw(st.integers(0, 3))] = limit * next(shares)
    evidence.theta[:4] = [THRESHOLDS.worn * next(shares) for _ in range(4)]
    evidence.cov[:4, :4] *= draw(st.sampled_from([1.0, 0.1, 0.001]))
    evidence.yaw[CONVERTER] = THRESHOLDS.turning * next(shares)
    evidence.yaw[ROLLED] = THRESHOLDS.turning * next(shares)
    failed = np.zeros(len(CHANNELS), np.uint8)
    failed[draw(st.integers(0, len(failed) - 1))] = draw(st.sampled_from([0, 0, 0, 0, 1]))
    return evidence, failed


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(evidences())
def test_after_an_uneventful_block_the_decisions_would_have_changed_nothing(given_block):
    evidence, failed = given_block
    uneventful = is_uneventful(AS_FLOATS, evidence, failed)
    names = tuple(c for c, has_failed in zip(CHANNELS, failed, strict=True) if has_failed)
    losses = np.zeros(4)
    after = decide(evidence, THRESHOLDS, Verdict(), 3.0, losses + evidence.theta[:4], names)
    if uneventful:
        assert after.diagnoses == () and np.isnan(after.suspected) and after.renewed == 0
        assert accommodate(evidence, THRESHOLDS, Verdict(), after, losses) is losses
    else:
        assert failed.any() or any_statistic_near(evidence), "a quiet block is worth no call"


@kernel
def _is_answered(thresholds, evidence, judged, time):
    return is_answered(thresholds, evidence, judged[0], time)


@st.composite
def diagnoses(draw):
    """Diagnosis of any kind, active or withdrawn a while ago."""
    wheel, rival = draw(st.permutations([1, 2, 3, 4]))[:2]
    kind = draw(
        st.sampled_from(
            ["slip", "all_wheel_slip", "locked", "motor", "stalled", "free", "hard_over", "sensor"]
        )
    )
    cleared = draw(st.sampled_from([None, None, 3.0 - LOOKBACK, 1.5, 2.9]))
    if kind == "sensor":
        channel = draw(st.sampled_from((*CHANNELS, "yaw")))
        wheels = (int(channel[-1]),) if channel[-1].isdigit() else ()
        return Diagnosis(-9.0, kind, wheels, 0.9, channel=channel, cleared=cleared)
    if kind == "stalled":
        return Diagnosis(-9.0, "motor", (wheel,), 0.9, (f"locked {wheel}",), 0.0, cleared=cleared)
    if kind == "motor":
        rivals = draw(st.sampled_from([(), (), (f"motor {rival}",)]))
        left = draw(st.sampled_from([0.0, 0.05, 0.5, 0.98, 1.0]))
        return Diagnosis(-9.0, kind, (wheel,), 0.9, rivals, left, cleared=cleared)
    return Diagnosis(-9.0, kind, () if kind == "all_wheel_slip" else (wheel,), 0.9, cleared=cleared)


@pytest.mark.slow
@settings(max_examples=600, deadline=None)
@given(
    evidences(),
    st.lists(diagnoses(), min_size=1, max_size=3),
    st.tuples(near, near, near),
    st.sampled_from([0.0, 0.5, 0.95]),
)
def test_after_an_answered_block_the_decisions_would_have_changed_nothing(given_block, known, ends, loss):
    (evidence, failed), verdict = given_block, Verdict()
    for diagnosis in known:
        verdict = with_diagnosis(verdict, diagnosis)
    regained, slipped, turning = ends
    evidence.monitors.regained[:] = THRESHOLDS.healthy * regained
    evidence.monitors.slipped[1:] = min(slipped, 1.0) * 1e-4
    evidence.monitors.turning[:] = THRESHOLDS.released * turning
    losses = np.full(4, loss)
    judgement = initial_judgement(4, THRESHOLDS)._replace(
        known=known_faults(verdict, 4),
        answered=answered_by(verdict, 4, CHANNELS),
        losses=losses,
        failed=failed.astype(bool),
    )
    judged = packed(judgement)
    if _is_answered(AS_FLOATS, evidence, judged, 3.0):
        names = tuple(c for c, has_failed in zip(CHANNELS, failed, strict=True) if has_failed)
        after = decide(evidence, THRESHOLDS, verdict, 3.0, losses + evidence.theta[:4], names)
        assert after.diagnoses == verdict.diagnoses and np.isnan(after.suspected) and after.renewed == 0
        assert accommodate(evidence, THRESHOLDS, verdict, after, losses) is losses
        assert archive_cleared(after, (), 3.0)[1] == ()


def any_statistic_near(evidence):
    """True if a statistic reaches its threshold, or the yaw comparison 0.4 of it."""
    monitors = any((getattr(evidence.monitors, name) >= limit).any() for name, limit in MONITORS.items())
    scores, least = evidence.scores.likelihood, min(THRESHOLDS.motor, THRESHOLDS.drag)
    learnt = (evidence.theta[:4] > THRESHOLDS.worn).any()
    yaw = abs(evidence.yaw[CONVERTER]) > 0.4 * THRESHOLDS.turning
    return bool(monitors or (scores >= least).any() or learnt or yaw)


def of(kind, *wheels, **more):
    return Diagnosis(1.0, kind, wheels, 0.9, **more)


@pytest.mark.parametrize(
    ("diagnosis", "marked"),
    [
        (of("slip", 2), {"unrolling", "slipping"}),
        (of("locked", 2), {"unrolling", "unknown_force", "held"}),
        (of("motor", 2, effectiveness=0.4), {"degraded", "weak"}),
        (of("motor", 2, ambiguous_with=("motor 3",)), {"degraded"}),
        (
            of("motor", 2, ambiguous_with=("locked 2",)),
            {"degraded", "unknown_force", "stalled", "powerless"},
        ),
        (of("free", 2), {"powerless"}),
        (of("hard_over", 2), {"runaway"}),
        (of("sensor", 2, channel="wheel_speed_2"), {"unrolling", "unknown_force", "failed_speed"}),
        (of("sensor", 2, channel="current_2"), {"unrolling"}),
    ],
)
def test_a_diagnosis_marks_its_own_wheel_and_nothing_else(diagnosis, marked):
    verdict = with_diagnosis(Verdict(), diagnosis)
    known = known_faults(verdict, 4)._asdict()
    masks = {name: mask for name, mask in known.items() if isinstance(mask, np.ndarray) and len(mask) == 4}
    for name, mask in masks.items():
        assert mask.tolist() == [False, name in marked, False, False], name
    assert known["active"] and known["observed"] and known["decided"] == 1.0
    assert bool(masks["stalled"].any()) == is_stalled(diagnosis)


def test_sensors_of_the_body_and_slip_of_all_wheels_mark_what_they_concern():
    body = with_diagnosis(Verdict(), of("sensor", channel="acceleration_y"))
    body = with_diagnosis(body, of("sensor", channel="yaw_rate"))
    known = known_faults(body, 4)
    assert known.excluded_axes.tolist() == [False, True] and known.failed_gyro
    assert not known.unrolling.any()
    everywhere = known_faults(with_diagnosis(Verdict(), of("all_wheel_slip")), 4)
    assert everywhere.slipping.all() and everywhere.unrolling.all()
