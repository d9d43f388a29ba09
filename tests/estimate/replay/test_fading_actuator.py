"""An actuator whose force per command falls as the force grows, against hand-written equations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from servo_logs import SERVO, write_servo_logs

from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf import kernels
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.read_dataset import read_dataset

TRUTH = [0.012, 0.025, 0.52, 4.8, 0.0005]
FADING = 0.8  # 1/(N.m)
ON = np.array([[True]])


def law_of(gear, gain, back_emf, fading):
    law = np.zeros(kernels.LAW)
    law[kernels.GEAR], law[kernels.GAIN], law[kernels.VELOCITY_GAIN] = gear, gain, -back_emf
    law[[kernels.LOW, kernels.DECLARED_LOW]], law[[kernels.HIGH, kernels.DECLARED_HIGH]] = -np.inf, np.inf
    law[kernels.FADING] = fading
    law[kernels.FORCE_PER_UNIT] = gear * gain
    return law


laws = st.builds(
    law_of,
    st.sampled_from([-3.0, -1.0, 0.5, 1.0, 20.0]),
    st.floats(0.05, 4.0),
    st.floats(0.0, 0.5),
    st.floats(0.0, 2.0),
)
inputs = st.floats(-2.0, 2.0)


@pytest.mark.slow
@given(laws, inputs, st.floats(-0.1, 0.1))
def test_the_input_that_gives_a_force_is_found_from_the_force(law, command, speed):
    zero, v = np.zeros((1, 1)), np.array([[speed]])
    added = kernels.drive_force(law, command, 0.0, speed) - kernels.drive_force(law, 0.0, 0.0, speed)
    found = np.array([[added]])
    kernels.to_inputs(law[None], zero, v, ON, found)
    assert found[0, 0] == pytest.approx(command, rel=1e-6, abs=1e-9)


@given(laws, inputs, st.floats(-0.1, 0.1))
def test_an_error_of_the_input_gives_the_missing_force(law, command, speed):
    force = kernels.drive_force(law, command, 0.0, speed)
    tiny = 1e-6 * (kernels.drive_force(law, command + 1.0, 0.0, speed) - force)
    found = np.array([[tiny]])
    kernels.to_input_errors(
        law[None], np.array([[command]]), np.zeros((1, 1)), np.array([[speed]]), ON, found
    )
    after = kernels.drive_force(law, command + found[0, 0], 0.0, speed)
    assert after - force == pytest.approx(tiny, rel=1e-3)


@pytest.fixture(scope="module")
def fading(tmp_path_factory):
    folder = tmp_path_factory.mktemp("servo") / "fading"
    write_servo_logs(folder, runs=3, fading=FADING)
    return MachineReplay(read_dataset(folder), read_machine_file(SERVO))


def test_a_servo_whose_force_fades_needs_the_measured_voltage_and_moves_as_measured(fading):
    errors = []
    for effects in ({}, {"soft_saturation (motor)": np.array([FADING])}):
        (found,) = fading.simulate([Setting(np.array(TRUTH), effects)])
        errors.append(np.sqrt(np.nanmean((fading.measured - found) ** 2, axis=0)))
    plain, true = errors
    assert true[0] < 0.1 and true[1] < 0.004
    assert plain[0] > 5.0 * true[0] and plain[1] > 5.0 * true[1]


def test_a_large_gain_does_not_hide_the_error_of_a_force_that_fades(fading):
    size = np.sqrt(np.nanmean(fading.measured[:, 0] ** 2))
    for resistance in (1.0, 0.1):
        setting = Setting(
            np.array([*TRUTH[:3], resistance, TRUTH[4]]), {"soft_saturation (motor)": np.array([6.0])}
        )
        (found,) = fading.simulate([setting])
        assert np.sqrt(np.nanmean((fading.measured - found)[:, 0] ** 2)) > 0.5 * size


@given(st.floats(0.01, 1.0), st.floats(1.1, 20.0), st.floats(-1.0, 1.0), st.sampled_from([-1.0, 1.0]))
def test_a_limit_explains_no_input_of_a_motion_that_needs_less_than_half_of_it(limit, times, share, side):
    command, needed = side * times * limit, 0.5 * share * limit
    (error,) = errors_of_limited([command], [needed], limit)
    assert error == pytest.approx(needed - command, rel=1e-9)


@given(st.floats(0.01, 1.0), st.floats(1.1, 20.0), st.floats(0.0, 2.0))
def test_a_limited_actuator_that_gives_what_is_needed_has_no_error(limit, times, excess):
    errors = errors_of_limited([times * limit] * 2, [limit, limit * (1.0 + excess)], limit)
    assert errors == pytest.approx([0.0, excess * limit], abs=1e-12)


@given(st.floats(0.01, 1.0), st.floats(-20.0, 20.0), st.floats(-2.0, 2.0))
def test_a_limit_that_the_model_declares_hides_nothing(limit, command, needed):
    (error,) = errors_of_limited([command], [needed], limit, declared=limit)
    assert error == pytest.approx(needed - np.clip(command, -limit, limit), abs=1e-12)


def errors_of_limited(commands, needed, limit, declared=np.inf):
    """Errors of the inputs of an actuator of gain 1, at rest."""
    law = law_of(1.0, 1.0, 0.0, 0.0)
    law[[kernels.LOW, kernels.HIGH]] = -limit, limit
    law[[kernels.DECLARED_LOW, kernels.DECLARED_HIGH]] = -declared, declared
    inputs, zero = np.array(commands)[:, None], np.zeros((len(commands), 1))
    found = np.array(needed)[:, None] - np.clip(inputs, -limit, limit)
    kernels.to_input_errors(law[None], inputs, zero, zero, zero == 0.0, found)
    return found[:, 0]
