"""The loop with plants made for it: the content of each row, the order of calls, and how a run ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from omnimj.errors import SimulationError
from omnimj.plant.interface import RIG_CHANNELS, robot_channels
from omnimj.signals import Array, CurrentCommand, Diagnosis, Measurement, Reference, RigMeasurement, Target
from omnimj.simulate.driving import TARGET_NAMES, drive, drive_rig
from omnimj.simulate.loop import Callbacks, column_names, steps

N = 3


class CountingRobot:
    """Every number of step k encodes k and its place; fails at a given step."""

    period = 0.01

    def __init__(self, fail_at: int = -1, error: BaseException | None = None, broken: float | None = None):
        self.truth_names: tuple[str, ...] = ("x", "y", "heading")
        self.commands: list[Array] = []
        self._fail_at, self._error, self._broken = fail_at, error, broken
        self._k = 0

    def reset(self) -> Measurement:
        self._k = 0
        return self._measured()

    def step(self, command: CurrentCommand) -> Measurement:
        if self._error is not None and self._k == self._fail_at:
            raise self._error
        self._k += 1
        self.commands.append(command.current)
        return self._measured()

    def truth(self) -> Array:
        if self._broken is not None and self._k == self._fail_at:
            return np.array([0.0, self._broken, 1.0])
        return self._k + np.array([0.1, 0.2, 0.3])

    def pose(self) -> Array:
        return np.array([float(self._k)])

    def close(self) -> None:
        pass

    def _measured(self) -> Measurement:
        k, wheels = float(self._k), np.arange(1.0, N + 1)
        return Measurement(
            0.01 * k, k + 0.01 * wheels, k + 0.02 * wheels, np.array([k, -k]), k + 0.5, k + 0.6
        )


@dataclass
class Remembered:
    log: Array
    diagnoses: tuple[Diagnosis, ...] = ()
    time_scaling: float = 1.0


class Echo:
    """Commands the sum of its measurement and target; logs the number of steps that its state has seen."""

    log_names = ("seen", "asked_yaw_rate")

    def __init__(self):
        self.targets: list[Target] = []

    def start(self, measurement: Measurement) -> Remembered:
        assert measurement.time == 0.0
        return Remembered(np.zeros(2))

    def step(self, state: Remembered, measurement: Measurement, target: Target):
        self.targets.append(target)
        log = np.array([state.log[0] + 1.0, target.yaw_rate])
        return CurrentCommand(np.full(N, measurement.yaw_rate + target.heading)), Remembered(log)


def reference(rows: int) -> Reference:
    k = np.arange(float(rows))
    pairs = np.column_stack([k, 2.0 * k])
    return Reference(0.01 * k, pairs + 0.5, k + 7.0, 0.1 * k, pairs, True)


def test_a_row_holds_measurement_truth_target_and_command_at_its_time():
    plant, controller = CountingRobot(), Echo()
    trace = drive(plant, controller, reference(6), about={"seed": 3})
    k = np.arange(6.0)
    names = {"time", *robot_channels(N), "x", "y", "heading", *TARGET_NAMES, "seen", "asked_yaw_rate"}
    assert set(trace.columns) == names | {f"current_target_{i}" for i in range(1, N + 1)}
    assert np.allclose(trace["time"], 0.01 * k)
    assert np.allclose(trace.wheels("current"), k[:, None] + 0.01 * np.arange(1, N + 1))
    assert np.allclose(trace.wheels("wheel_speed"), k[:, None] + 0.02 * np.arange(1, N + 1))
    assert np.allclose(trace["acceleration_x"], k) and np.allclose(trace["acceleration_y"], -k)
    assert np.allclose(trace["yaw_rate"], k + 0.5) and np.allclose(trace["yaw"], k + 0.6)
    assert np.allclose(trace["x"], k + 0.1) and np.allclose(trace["heading"], k + 0.3)
    assert np.allclose(trace["seen"], k + 1.0) and np.allclose(trace["asked_yaw_rate"], k + 7.0)
    assert np.allclose(trace["current_target_2"], k + 0.5 + 0.1 * k)
    assert np.allclose(trace["target_y"], 2.0 * k) and np.allclose(trace["target_velocity_x"], k + 0.5)
    assert trace.about["seed"] == 3 and trace.about["interrupted"] is False
    assert trace.about["failure"] is None


class Halved(Echo):
    """Asks for half the pace from its third step on."""

    def step(self, state: Remembered, measurement: Measurement, target: Target):
        command, after = super().step(state, measurement, target)
        return command, Remembered(after.log, time_scaling=0.5 if after.log[0] >= 3.0 else 1.0)


def test_at_half_the_pace_every_sample_of_the_plan_lasts_two_steps_at_half_the_speed():
    controller = Halved()
    trace = drive(CountingRobot(), controller, reference(9))
    samples = [0, 1, 2, 3, 3, 4, 4, 5, 5]
    paces = np.array([1.0, 1.0, 1.0] + [0.5] * 6)
    assert trace["target_x"].tolist() == samples
    assert trace["target_velocity_x"] == pytest.approx(paces * (np.array(samples) + 0.5))
    assert [t.yaw_rate for t in controller.targets] == pytest.approx(paces * (np.array(samples) + 7.0))


def test_the_command_of_a_row_is_what_the_plant_gets_for_the_period_after_it():
    plant = CountingRobot()
    trace = drive(plant, Echo(), reference(6))
    assert len(plant.commands) == 5  # the last row's command is not driven: the run is over
    assert np.allclose(plant.commands, trace.wheels("current_target")[:-1])


@pytest.mark.parametrize("fail_at", [0, 1, 4])
def test_ctrl_c_keeps_the_rows_before_it(fail_at):
    whole = drive(CountingRobot(), Echo(), reference(9))
    cut = drive(CountingRobot(fail_at, KeyboardInterrupt()), Echo(), reference(9))
    assert cut.about["interrupted"] is True
    assert set(cut.columns) == set(whole.columns)
    for name, values in cut.columns.items():
        assert np.array_equal(values, whole[name][: fail_at + 1]), name


@pytest.mark.parametrize("fail_at", [0, 1, 4])
@pytest.mark.parametrize("broken", [float("nan"), float("inf"), -float("inf"), 2e10, -2e10, 1e308])
def test_a_truth_that_is_no_number_of_a_robot_ends_the_run_with_its_time_and_name_and_keeps_the_rows_before(
    fail_at, broken
):
    whole = drive(CountingRobot(), Echo(), reference(9))
    cut = drive(CountingRobot(fail_at, broken=broken), Echo(), reference(9))
    assert (
        cut.about["failure"] == f"at 0.0{fail_at}00 s: y is {broken:g}" and cut.about["interrupted"] is True
    )
    assert set(cut.columns) == set(whole.columns)
    for name, values in cut.columns.items():
        assert np.array_equal(values, whole[name][:fail_at]), name


@pytest.mark.parametrize("error", [SimulationError("the robot fell over"), ZeroDivisionError("by nothing")])
def test_an_error_of_the_plant_names_its_time_and_keeps_the_rows_before(error):
    whole = drive(CountingRobot(), Echo(), reference(9))
    cut = drive(CountingRobot(4, error), Echo(), reference(9))
    assert cut.about["failure"] == f"at 0.0500 s: {error}" and cut.about["interrupted"] is True
    for name, values in cut.columns.items():
        assert np.array_equal(values, whole[name][:5]), name


def test_an_error_that_is_no_failure_of_the_plant_is_raised():
    with pytest.raises(KeyError):
        drive(CountingRobot(4, KeyError("a slip of the pen")), Echo(), reference(9))


def test_poses_are_taken_every_20_ms_and_progress_reaches_the_end():
    taken, reached = [], []
    callbacks = Callbacks(
        lambda done, rows: reached.append((done, rows)), lambda t, pose: taken.append((t, pose[0]))
    )
    drive(CountingRobot(), Echo(), reference(250), callbacks)
    assert [pose for _, pose in taken] == [float(k) for k in range(0, 250, 2)]
    assert np.allclose([t for t, _ in taken], 0.01 * np.arange(0, 250, 2))
    assert reached == [(100, 250), (200, 250), (250, 250)]


def test_two_columns_of_one_name_are_refused():
    plant = CountingRobot()
    plant.truth_names = ("x", "y", "yaw")
    with pytest.raises(ValueError, match="yaw"):
        drive(plant, Echo(), reference(3))


class CountingRig:
    period = 0.001
    truth_names: tuple[str, ...] = ("carriage_position",)

    def __init__(self):
        self.got: list[float] = []

    def reset(self) -> RigMeasurement:
        return self._measured()

    def step(self, command: CurrentCommand) -> RigMeasurement:
        assert command.current.shape == (1,)
        self.got.append(float(command.current[0]))
        return self._measured()

    def truth(self) -> Array:
        return np.array([len(self.got) + 0.5])

    def close(self) -> None:
        pass

    def _measured(self) -> RigMeasurement:
        k = float(len(self.got))
        return RigMeasurement(0.001 * k, k + 0.1, k + 0.2, k + 0.3, k + 0.4, k + 0.5)


def test_the_rig_gets_its_currents_in_order():
    plant, current = CountingRig(), np.array([0.1, 0.2, 0.3, 0.4])
    trace = drive_rig(plant, current)
    assert plant.got == [0.1, 0.2, 0.3]
    assert set(trace.columns) == {"time", *RIG_CHANNELS, "current_target", "carriage_position"}
    for name, offset in zip(RIG_CHANNELS, (0.1, 0.2, 0.3, 0.4, 0.5), strict=True):
        assert np.allclose(trace[name], np.arange(4) + offset), name
    assert trace["current_target"].tolist() == [0.1, 0.2, 0.3, 0.4]
    assert trace["carriage_position"].tolist() == [0.5, 1.5, 2.5, 3.5]


class ThreeSteps:
    """Policy that ends the run itself."""

    names, target_names = ("time",), ("left",)

    def __init__(self):
        self.left = 3

    def command(self, measurement: RigMeasurement, row: Array) -> CurrentCommand | None:
        if self.left == 0:
            return None
        row[0], row[-1] = measurement.time, self.left
        self.left -= 1
        return CurrentCommand(np.array([float(self.left)]))


def test_each_row_is_yielded_before_the_plant_steps_and_a_short_table_is_used_again():
    plant, policy, table = CountingRig(), ThreeSteps(), np.full((2, 3), np.nan)
    assert column_names(plant, policy) == ("time", "carriage_position", "left")
    seen = [
        (done, len(plant.got), table[(done - 1) % 2].tolist())
        for done in steps(plant, policy, plant.reset(), table)
    ]
    assert seen == [(1, 0, [0.0, 0.5, 3.0]), (2, 1, [0.001, 1.5, 2.0]), (3, 2, [0.002, 2.5, 1.0])]
    assert plant.got == [2.0, 1.0, 0.0]


def test_a_limit_ends_the_run_before_the_plant_steps_once_more():
    plant = CountingRig()
    assert list(steps(plant, ThreeSteps(), plant.reset(), np.zeros((2, 3)), limit=2)) == [1, 2]
    assert plant.got == [2.0]
