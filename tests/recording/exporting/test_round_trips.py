"""Exported runs come back with their times, values and units, and other libraries read the same numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat

from omnimj.errors import InputError
from omnimj.recording.dataset import PLANT_COLUMNS
from omnimj.recording.exporting.files import write_csv, write_mat
from omnimj.recording.exporting.messages import write_mcap
from omnimj.recording.exporting.source import ExportedRun, column_unit, matlab_names, read_run, ros_names
from omnimj.recording.importing.source import read_source
from omnimj.recording.importing.tables import SourceTable
from omnimj.recording.importing.units import find_unit
from omnimj.recording.traces import write_trace
from omnimj.signals import Array, Trace, robot_channels

ROWS = 400
TIME: Array = (0.001 * np.arange(ROWS)).astype(float)
WRITERS = {"csv": write_csv, "mat": write_mat, "mcap": write_mcap}
NAMES = (
    *robot_channels(4),
    *(f"{name}_{k}" for name in ("current_target", "slip_velocity", "normal_force") for k in (1, 2, 3, 4)),
    *("residual_force_x", "residual_moment", "mode", "x", "y", "heading", "twist_x", "twist_y", "twist_yaw"),
    *("target_x", "target_y", "target_heading", "target_twist_x", "target_twist_y", "target_yaw_rate"),
)


def robot_run(names: tuple[str, ...] = NAMES, seed: int = 0) -> ExportedRun:
    """A run with values of all magnitudes in columns of a robot."""
    rng = np.random.default_rng(seed)
    columns: dict[str, Array] = {
        name: rng.normal(size=ROWS) * 10.0 ** float(rng.integers(-12, 9)) for name in names
    }
    columns |= {name: rng.uniform(0.0, 2.0 * np.pi, ROWS) for name in ("yaw", "heading") if name in names}
    return ExportedRun(Path("run"), {"time": TIME, **columns}, {"scenario": "made", "seed": seed})


def exported(path: Path, run: ExportedRun) -> SourceTable:
    WRITERS[path.suffix[1:]](path, run)
    return read_source(path)


def column_of(table: SourceTable, name: str) -> str:
    """Name in the table of a column of the run."""
    return next(key for key, one in table.columns.items() if name in (key, one.kind))


@pytest.mark.parametrize("suffix", WRITERS)
def test_times_and_values_come_back_and_units_are_kept(tmp_path, suffix):
    run = robot_run()
    table = exported(tmp_path / f"a.{suffix}", run)
    assert np.abs(table.columns["time"].values - TIME).max() < 1e-9
    for name, values in run.columns.items():
        found = table.columns[column_of(table, name)]
        assert np.abs(found.values - values).max() < 1e-9, name
        assert found.unit == column_unit(name), name


@pytest.mark.slow
@pytest.mark.parametrize("suffix", WRITERS)
@given(seed=st.integers(0, 2**32))
def test_every_double_comes_back_bit_for_bit_as_it_was(tmp_path_factory, suffix, seed):
    rng = np.random.default_rng(seed)
    bits = rng.integers(0, 2**64, ROWS, dtype=np.uint64).view(float)
    values = np.where(np.isfinite(bits), bits, 0.0)
    values[:3] = np.nan, np.finfo(float).max, 5e-324
    run = ExportedRun(Path("run"), {"time": TIME, "effectiveness_1": values})
    table = exported(tmp_path_factory.mktemp("bits") / f"a.{suffix}", run)
    (name,) = [name for name in table.columns if "effectiveness_1" in name]
    assert np.array_equal(table.columns[name].values, values, equal_nan=True)


@pytest.mark.parametrize("suffix", WRITERS)
def test_columns_of_any_name_come_back_under_it(tmp_path, suffix):
    names = (
        "position:shaft",
        "control:Motor 1",
        "position_shaft",
        "end",
        "Über",
        "1st",
        "limit_ms",
        "a" * 70,
    )
    run = robot_run(names)
    table = exported(tmp_path / f"a.{suffix}", run)
    found = [column.values.tobytes() for column in table.columns.values()]
    for name in names:
        assert run.columns[name].tobytes() in found, name
    if suffix != "mcap":  # there the names are kinds
        assert set(table.columns) == {"time", *names}
    assert column_of(table, "position:shaft")


def test_foreign_libraries_read_every_topic_of_an_exported_run(tmp_path):
    """`rosbags` and `mcap_ros2` decode all messages; poses, joints and units are where their users look."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory
    from rosbags.highlevel import AnyReader

    run = robot_run()
    write_mcap(tmp_path / "a.mcap", run)
    columns = run.columns
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        topics = {one.topic: one for one in summary.channels.values()}
        decoded: dict[str, list] = {topic: [] for topic in topics}
        for _, channel, message, content in reader.iter_decoded_messages():
            decoded[channel.topic].append((message.log_time, content))
    assert set(topics) == {"/trace", "/joint_states", "/imu", "/odom", "/tf", "/target_pose", "/target_twist"}
    assert {len(messages) for messages in decoded.values()} == {ROWS}
    assert topics["/trace"].metadata["unit.current_1"] == "A"
    with AnyReader([tmp_path / "a.mcap"]) as bag:
        theirs: dict[str, list] = {topic: [] for topic in topics}
        for connection, stamp, raw in bag.messages():
            theirs[connection.topic].append((stamp, bag.deserialize(raw, connection.msgtype)))
    for k in range(0, ROWS, 37):
        for all_messages in (decoded, theirs):
            at = {topic: messages[k] for topic, messages in all_messages.items()}
            assert {stamp for stamp, _ in at.values()} == {1_000_000 * k}
            content = {topic: message for topic, (_, message) in at.items()}
            assert content["/trace"].header.stamp.nanosec == 1_000_000 * k
            for name, values in columns.items():
                assert getattr(content["/trace"], name) == values[k], name
            joints = content["/joint_states"]
            assert list(joints.name) == ["wheel_1", "wheel_2", "wheel_3", "wheel_4"]
            assert list(joints.velocity) == [columns[f"wheel_speed_{n}"][k] for n in (1, 2, 3, 4)]
            assert len(joints.position) == len(joints.effort) == 0
            assert content["/imu"].linear_acceleration.x == columns["acceleration_x"][k]
            assert np.isnan(content["/imu"].linear_acceleration.z)
            moved = content["/tf"].transforms[0]
            assert (moved.header.frame_id, moved.child_frame_id) == ("world", "base_link")
            pose = content["/odom"].pose.pose
            for where in (pose.position, moved.transform.translation):
                assert (where.x, where.y, where.z) == (columns["x"][k], columns["y"][k], 0.0)
            for turn in (pose.orientation, moved.transform.rotation):
                heading = 2.0 * np.arctan2(turn.z, turn.w)
                assert np.cos(heading - columns["heading"][k]) == pytest.approx(1.0, abs=1e-15)
            assert content["/odom"].twist.twist.linear.y == columns["twist_y"][k]
            assert content["/target_twist"].twist.angular.z == columns["target_yaw_rate"][k]
            assert content["/target_pose"].pose.position.x == columns["target_x"][k]


def test_a_matlab_file_has_a_variable_for_each_column_and_their_units(tmp_path):
    run = robot_run()
    write_mat(tmp_path / "a.mat", run)
    content = loadmat(tmp_path / "a.mat")
    assert content["time"].shape == (ROWS, 1) and content["units"]["current_1"][0, 0] == "A"
    assert set(run.columns) <= set(content) and '"scenario": "made"' in str(content["about"])


def test_names_of_other_tools_are_distinct_and_keep_their_rules():
    names = ["a:b", "a_b", "A b", "a__b", "end", "1", "", "_x", "ä", "x" * 90, "x" * 91]
    for valid, pattern in (
        (matlab_names(names), r"[A-Za-z][A-Za-z0-9_]{0,62}"),
        (ros_names(names), r"[a-z](?:[a-z0-9]|_(?=[a-z0-9]))*"),
    ):
        assert len(set(valid.values())) == len(names) == len(valid)
        assert all(re.fullmatch(pattern, one) for one in valid.values()), valid


def test_the_columns_of_every_plant_have_a_known_unit():
    """Where the plant fixes it; the force of an axis is in N, its channels are no parts of an MJCF file."""
    for columns in PLANT_COLUMNS.values():
        for name in columns.known:
            unit = find_unit(column_unit(name))
            assert unit is not None and unit.factor == 1.0, name


def test_units_of_residuals_are_those_of_the_plots():
    from omnimj.view.residuals import families

    columns = [f"residual_{name}" for name in ("force_x", "force_y", "moment", "motor_1", "slip_1")]
    shown = {one.column: family.unit for family in families(columns, "robust") for one in family.residuals}
    words = {"N": "N", "N·m": "Nm", "nat": "1", "m": "m", "rad/s": "rad/s"}
    assert {name: words[unit] for name, unit in shown.items()} == {
        name: column_unit(name) for name in columns
    }


@pytest.mark.parametrize(
    ("time", "words"),
    [
        ([0.0, 1.0, np.nan], "row 3: time is nan; must be finite"),
        ([0.0, 1.0, 1.0], "row 3: time is 1 s after 1 s; must increase"),
        ([], "has no rows"),
    ],
)
def test_a_trace_with_wrong_times_is_refused(tmp_path, time, words):
    write_trace(tmp_path / "trace.parquet", Trace({"time": np.array(time, float)}))
    with pytest.raises(InputError, match=words):
        read_run(tmp_path)


def test_a_time_that_stamps_cannot_hold_is_refused_and_nothing_is_written(tmp_path):
    run = ExportedRun(Path("run"), {"time": TIME - 1.0, "x": TIME})
    with pytest.raises(InputError, match="a time is -1 s; stamps hold 0 to 2147483647 s"):
        write_mcap(tmp_path / "a.mcap", run)
    assert not list(tmp_path.iterdir())
