"""Recorded messages become one table: values of all writers, one clock, honest rules between messages."""

from __future__ import annotations

import sys
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording.made_bags import (
    COUNT,
    DELAY,
    JOINTS,
    RATE,
    START,
    STORE,
    WRITERS,
    drive,
    joint_state,
    number,
    numbers,
    odometry,
    pose_stamped,
    twist_stamped,
    write_bag,
    write_json_mcap,
    write_mcap,
    write_ros2_mcap,
)

from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.importing.source import read_source
from omnimj.recording.importing.tables import SourceHints
from omnimj.recording.importing.topics.join import LONGEST_GAP, TopicChoice, Track, values_at

TIME = np.arange(COUNT) / RATE


@pytest.mark.parametrize("writer", WRITERS)
def test_every_writer_gives_the_same_times_values_and_units(tmp_path, writer):
    table = read_source(WRITERS[writer](tmp_path, drive()))
    columns = table.columns
    assert columns["time"].values == pytest.approx(TIME, abs=1e-9)
    for k, joint in enumerate(JOINTS):
        assert np.array_equal(columns[f"/joint_states.velocity[{joint}]"].values, np.sin(3.0 * TIME + k))
        assert columns[f"/joint_states.velocity[{joint}]"].unit == "rad/s"
    assert columns["/imu.linear_acceleration.x"].values == pytest.approx(2.0 * TIME, abs=1e-9)
    assert columns["/imu.orientation.yaw"].values == pytest.approx(0.3 * TIME, abs=1e-9)
    covered = slice(0, COUNT - 3)  # the last odometry is three rows before the end
    assert columns["/odom.pose.pose.position.y"].values[covered] == pytest.approx(
        2.0 * TIME[covered], abs=1e-9
    )
    assert np.isnan(columns["/odom.pose.pose.position.y"].values[-3:]).all()
    units = ("/imu.angular_velocity.z", "/imu.linear_acceleration.x", "/odom.pose.pose.position.y")
    assert [columns[name].unit for name in units] == ["rad/s", "m/s2", "m"]
    assert "/rosout" in table.others and table.scalars == {"start": f"{START} ns"}


def test_a_topic_without_header_is_taken_at_its_log_times_and_says_so(tmp_path):
    table = read_source(write_mcap(tmp_path / "a.mcap", drive()))
    stamps = {one.name: one.stamps for one in table.topics}
    assert stamps["/imu"] == "header" and stamps["/voltage"] == "log: no header stamps"
    found = table.columns["/voltage.data"].values[1:111]
    assert found == pytest.approx(24.0 - (TIME[1:111] - DELAY * 1e-9), abs=1e-9)


def test_header_stamps_that_run_backwards_give_way_to_log_times(tmp_path):
    made = [
        ("/joint_states", "sensor_msgs/msg/JointState", START + k * 10**7, joint_state(stamp, 0.01 * k))
        for k, stamp in enumerate([START, START + 5, START + 3, *(START + 10 + k for k in range(60))])
    ]
    table = read_source(write_mcap(tmp_path / "a.mcap", made))
    assert table.topics[0].stamps == "log: header stamps run backwards once"
    assert np.diff(table.columns["time"].values) == pytest.approx(0.01)
    with pytest.raises(InputError, match=r"header stamps run backwards once; stamps = \"log\" takes"):
        read_source(tmp_path / "a.mcap", SourceHints(choice=TopicChoice(stamps="header")))


def test_topics_of_two_clocks_are_not_mixed(tmp_path):
    """Header stamps of a simulation from 0 on, logged by the wall clock: what has no header is left out."""
    made = drive(start=0, logged_from=START)
    table = read_source(write_mcap(tmp_path / "a.mcap", made))
    assert table.columns["time"].values == pytest.approx(TIME, abs=1e-12) and "start" not in table.scalars
    assert "log times are 1.7e+09 s after the header stamps" in table.others["/voltage"]
    by_log = read_source(tmp_path / "a.mcap", SourceHints(choice=TopicChoice(stamps="log")))
    assert "/voltage.data" in by_log.columns and {one.stamps[:3] for one in by_log.topics} == {"log"}


def test_messages_out_of_order_are_sorted_by_their_stamps(tmp_path):
    made = drive()
    shuffled = [made[k] for k in np.random.default_rng(0).permutation(len(made))]
    ordered, found = (
        read_source(write_mcap(tmp_path / name, some))
        for name, some in (("a.mcap", made), ("b.mcap", shuffled))
    )
    for name, column in ordered.columns.items():
        assert np.array_equal(column.values, found.columns[name].values, equal_nan=True), name


def test_headings_of_messages_out_of_order_are_unwrapped_in_the_order_of_time(tmp_path):
    made = [
        ("/pose", "nav_msgs/msg/Odometry", START + k * 10**8, odometry(START + k * 10**8, 5.0 * k))
        for k in range(60)
    ]
    shuffled = [made[k] for k in np.random.default_rng(1).permutation(60)]
    table = read_source(write_mcap(tmp_path / "a.mcap", shuffled))
    yaw = table.columns["/pose.pose.pose.orientation.yaw"].values
    assert yaw == pytest.approx(1.5 * np.arange(60))


def test_a_chosen_base_and_the_previous_value_are_applied(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", drive())
    table = read_source(path, SourceHints(choice=TopicChoice("/imu", "previous")))
    assert len(table.columns["time"].values) == 2 * COUNT
    velocity = table.columns["/joint_states.velocity[wheel_1]"].values
    assert np.array_equal(velocity, np.repeat(np.sin(3.0 * TIME), 2))
    with pytest.raises(UnknownNameError, match=r"unknown topic '/imv'; did you mean '/imu'\?"):
        read_source(path, SourceHints(choice=TopicChoice("/imv")))


@given(st.lists(st.integers(1, 60), min_size=2, max_size=20), st.integers(0, 2**31))
def test_a_joined_value_lies_between_its_neighbours_and_gaps_are_not_bridged(steps, seed):
    rng = np.random.default_rng(seed)
    times = np.cumsum([0, *steps]).astype(np.int64)
    values = rng.normal(size=len(times))
    rows = np.arange(-5, times[-1] + 5, dtype=np.int64)
    line, held = (values_at(Track(times, values), rows, rule) for rule in ("linear", "previous"))
    usual = np.median(np.diff(times))
    for row, one, before in zip(rows, line, held, strict=True):
        k = int(np.searchsorted(times, row, side="right")) - 1
        assert np.isnan(before) if k < 0 else before == values[k]
        if k >= 0 and times[k] == row:
            assert one == values[k]
        elif k < 0 or k == len(times) - 1 or times[k + 1] - times[k] > LONGEST_GAP * usual:
            assert np.isnan(one)
        else:
            assert min(values[k : k + 2]) - 1e-12 <= one <= max(values[k : k + 2]) + 1e-12


def test_joints_that_are_sent_in_two_parts_are_joined(tmp_path):
    made = []
    for k in range(100):
        stamp, names = START + k * 10**7, JOINTS[:2] if k % 2 else JOINTS[2:]
        made.append(
            ("/joint_states", "sensor_msgs/msg/JointState", stamp, joint_state(stamp, k / 100, names))
        )
    table = read_source(write_bag(tmp_path / "bag", made))
    velocity = table.columns["/joint_states.velocity[wheel_1]"].values
    assert len(velocity) == 100 and np.isnan(velocity[0]) and np.isfinite(velocity[1:]).all()
    assert velocity[1::2] == pytest.approx(np.sin(3.0 * TIME[1:100:2]))


def test_json_messages_have_the_units_and_stamps_of_their_schema(tmp_path):
    schema = {
        "type": "object",
        "properties": {
            "current": {"type": "number", "unit": "mA"},
            "speed": {"type": "array", "description": "wheel speeds [rpm]"},
            "pose": {"properties": {"x": {"description": "forwards [mm]"}}},
        },
    }
    rows = [
        (START + k, {
            "timestamp": {"sec": 5, "nsec": 10_000_000 * k},
            "current": 10.0 * k,
            "name": ["left", "right"],
            "speed": [1.0 * k, 2.0 * k],
            "pose": {"x": -k, "frame": "map"},
            "on": k % 2 == 0,
        })
        for k in range(60)
    ]  # fmt: skip
    table = read_source(write_json_mcap(tmp_path / "a.mcap", rows, schema))
    assert table.columns["time"].values == pytest.approx(5.0 + 0.01 * np.arange(60), abs=1e-9)
    units = {name: column.unit for name, column in table.columns.items()}
    assert units["/robot.current"] == "mA" and units["/robot.pose.x"] == "mm"
    assert units["/robot.speed[left]"] == "rpm"
    assert table.columns["/robot.speed[right]"].values.tolist() == [2.0 * k for k in range(60)]
    assert table.columns["/robot.on"].values.tolist() == [1.0, 0.0] * 30


def test_a_message_type_of_the_user_is_read_by_its_definition(tmp_path):
    definition = (
        "# state of the drive\nuint8 MODE_OFF=0\nfloat32[4] current # of all motors [mA]\nstring text\n"
        "int16 ticks\nMotor[] motors\nuint8[] blob\nfloat64 volts  # [V]\n"
        "================================================================================\n"
        "MSG: my_msgs/Motor\nstring name\nbool on\nfloat64 speed\n"
    )
    rows = [
        (START + k * 10**7, {
            "current": [k, 2 * k, 3 * k, 4 * k], "text": "x" * (k % 5), "ticks": -k,
            "blob": list(range(k % 7)),
            "motors": [{"name": "a", "on": True, "speed": 0.5 * k}, {"name": "b", "on": False, "speed": 1.5}],
            "volts": 24.0 + k,
        })
        for k in range(60)
    ]  # fmt: skip
    path = write_ros2_mcap(tmp_path / "a.mcap", "my_msgs/Drive", definition, rows)
    columns = read_source(path, SourceHints(topics=("/own",))).columns
    assert columns["/own.current[2]"].values.tolist() == [3.0 * k for k in range(60)]
    assert columns["/own.ticks"].values.tolist() == [-1.0 * k for k in range(60)]
    assert columns["/own.motors[a].speed"].values.tolist() == [0.5 * k for k in range(60)]
    assert columns["/own.volts"].values.tolist() == [24.0 + k for k in range(60)]
    assert columns["/own.volts"].unit == "V" and columns["/own.current[2]"].unit == "mA"


def test_numbers_of_standard_messages_are_those_of_two_other_decoders(tmp_path):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    path = write_mcap(tmp_path / "a.mcap", drive(count=60))
    columns = read_source(path).columns
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [m for *_, m in reader.iter_decoded_messages(topics=["/joint_states"])]
        raw = [one.data for _, _, one in reader.iter_messages(topics=["/joint_states"])]
    for k, (theirs, payload) in enumerate(zip(decoded, raw, strict=True)):
        other = STORE.deserialize_cdr(payload, "sensor_msgs/msg/JointState")
        for j, joint in enumerate(JOINTS):
            found = columns[f"/joint_states.effort[{joint}]"].values[k]
            assert found == theirs.effort[j] == other.effort[j]  # pyright: ignore


@pytest.mark.parametrize("writer", ["bag in SQLite", "MCAP, zstd"])
def test_memory_does_not_grow_with_topics_that_are_not_read(tmp_path, writer):
    """Peak memory with 30 MB of images between the joint states is that without them, and a chunk."""

    def peak(folder, images: int) -> int:
        folder.mkdir()
        kind = STORE.types["sensor_msgs/msg/Image"]
        head = joint_state(START, 0.0).header
        image = kind(head, 1, 1, "mono8", 0, 1, np.zeros(1_000_000, np.uint8))
        made = [one for one in drive(count=60) if one[0] == "/joint_states"]
        made += [("/camera", "sensor_msgs/msg/Image", START + k, image) for k in range(images)]
        path = WRITERS[writer](folder, made)
        tracemalloc.start()
        read_source(path)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    peak(tmp_path / "first", 1)  # imports
    few, many = peak(tmp_path / "few", 3), peak(tmp_path / "many", 30)
    assert many < few + 500_000


def test_topics_that_the_mapping_does_not_need_are_not_decoded(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", drive())
    table = read_source(path, SourceHints(columns=("/imu.angular_velocity.z",)))
    assert {one.name for one in table.topics} == {"/imu"} and table.others["/odom"] == "not needed"


@pytest.mark.parametrize("library", ["mcap.records", "rosbags.rosbag2", "rosbags.typesys"])
def test_a_missing_library_is_named_with_its_extra(tmp_path, monkeypatch, library):
    path = WRITERS["bag in SQLite" if library == "rosbags.rosbag2" else "MCAP, zstd"](
        tmp_path, drive(count=60)
    )
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(InputError, match=r"is not installed.*pip install 'omnimj\[import\]'"):
        read_source(path)


def test_numbers_without_header_are_rows_at_their_log_times(tmp_path):
    made = [("/current", "std_msgs/msg/Float32", k * 10**7, number(k / 2, "Float32")) for k in range(80)]
    table = read_source(write_mcap(tmp_path / "a.mcap", made))
    assert table.columns["time"].values == pytest.approx(0.01 * np.arange(80), abs=1e-12)
    assert table.columns["/current.data"].values.tolist() == [k / 2 for k in range(80)]


def test_poses_twists_and_arrays_have_their_units_and_meaning(tmp_path):
    made = []
    for k in range(60):
        at, t = START + k * 20_000_000, 0.02 * k
        made.append(("/mocap", "geometry_msgs/msg/PoseStamped", at, pose_stamped(at, t, -t, 0.5 * t)))
        made.append(("/twist", "geometry_msgs/msg/TwistStamped", at, twist_stamped(at, 2.0 * t, -t)))
        made.append(("/currents", "std_msgs/msg/Float64MultiArray", at, numbers((t, 2.0 * t, 3.0 * t))))
    columns = read_source(write_bag(tmp_path / "bag", made)).columns
    time = columns["time"].values
    assert columns["/mocap.pose.orientation.yaw"].values == pytest.approx(0.5 * time, abs=1e-9)
    assert columns["/twist.twist.linear.x"].values == pytest.approx(2.0 * time, abs=1e-9)
    assert columns["/currents.data[2]"].values == pytest.approx(3.0 * time, abs=1e-9)
    units = {name: column.unit for name, column in columns.items()}
    assert (units["/mocap.pose.position.x"], units["/twist.twist.linear.x"]) == ("m", "m/s")
    assert (units["/twist.twist.angular.z"], units["/mocap.pose.orientation.yaw"]) == ("rad/s", "rad")
    kinds = {column.kind: name for name, column in columns.items() if column.kind}
    assert kinds["x"] == "/mocap.pose.position.x" and kinds["heading"] == "/mocap.pose.orientation.yaw"


def test_joint_states_in_json_mean_what_they_mean_in_cdr(tmp_path):
    rows = [
        (START + k, {
            "header": {"stamp": {"sec": 0, "nanosec": 10_000_000 * k}, "frame_id": "base"},
            "name": ["wheel_1", "wheel_2"], "velocity": [1.0 * k, 2.0 * k], "effort": [],
        })
        for k in range(60)
    ]  # fmt: skip
    path = write_json_mcap(tmp_path / "a.mcap", rows, kind="sensor_msgs/msg/JointState")
    column = read_source(path).columns["/robot.velocity[wheel_2]"]
    assert (column.unit, column.part) == ("rad/s", "wheel_2")
    assert column.values.tolist() == [2.0 * k for k in range(60)]


@pytest.mark.parametrize("writer", WRITERS)
def test_progress_grows_with_the_share_of_the_file_that_is_read(tmp_path, writer):
    shown: list[float] = []
    read_source(WRITERS[writer](tmp_path, drive()), SourceHints(progress=shown.append))
    assert shown and shown == sorted(shown) and shown[0] >= 0.0 and shown[-1] <= 1.0
