"""ROS 2 bags and MCAP files made by the writers of their own libraries."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer as Ros2Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
START = 1_700_000_000_000_000_000
"""Stamp of the first message [ns]."""
RATE, COUNT = 100, 120
DELAY = 400_000
"""Time between stamp and logging [ns]."""
JOINTS = ("wheel_1", "wheel_2", "wheel_3", "wheel_4")

Message = tuple[str, str, int, Any]
"""Topic, type, time of logging [ns] and message."""


def header(stamp: int) -> Any:
    time = STORE.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id="base_link")


def vector(x: float, y: float, z: float) -> Any:
    return STORE.types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def turned(yaw: float) -> Any:
    kind = STORE.types["geometry_msgs/msg/Quaternion"]
    return kind(x=0.0, y=0.0, z=float(np.sin(yaw / 2.0)), w=float(np.cos(yaw / 2.0)))


def joint_state(stamp: int, t: float, names: Iterable[str] = JOINTS) -> Any:
    names = list(names)
    k = np.arange(len(names))
    kind = STORE.types["sensor_msgs/msg/JointState"]
    velocity, effort = np.sin(3.0 * t + k), np.cos(t + k)
    return kind(header=header(stamp), name=names, position=t + k, velocity=velocity, effort=effort)


def imu(stamp: int, t: float) -> Any:
    none = np.zeros(9)
    kind = STORE.types["sensor_msgs/msg/Imu"]
    return kind(
        header(stamp), turned(0.3 * t), none, vector(0.0, 0.0, 0.3), none, vector(2.0 * t, -t, 9.81), none
    )


def odometry(stamp: int, t: float) -> Any:
    types = STORE.types
    place = types["geometry_msgs/msg/Point"](x=t, y=2.0 * t, z=0.0)
    pose = types["geometry_msgs/msg/Pose"](position=place, orientation=turned(0.3 * t))
    twist = types["geometry_msgs/msg/Twist"](linear=vector(1.0, 2.0, 0.0), angular=vector(0.0, 0.0, 0.3))
    return types["nav_msgs/msg/Odometry"](
        header(stamp),
        "base_link",
        types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36)),
        types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=np.zeros(36)),
    )


def pose_stamped(stamp: int, x: float, y: float, yaw: float) -> Any:
    types = STORE.types
    place = types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0)
    pose = types["geometry_msgs/msg/Pose"](position=place, orientation=turned(yaw))
    return types["geometry_msgs/msg/PoseStamped"](header(stamp), pose)


def twist_stamped(stamp: int, ahead: float, yaw_rate: float) -> Any:
    types = STORE.types
    twist = types["geometry_msgs/msg/Twist"](
        linear=vector(ahead, 0.0, 0.0), angular=vector(0.0, 0.0, yaw_rate)
    )
    return types["geometry_msgs/msg/TwistStamped"](header(stamp), twist)


def numbers(values: Iterable[float]) -> Any:
    types = STORE.types
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return types["std_msgs/msg/Float64MultiArray"](layout, np.array(list(values)))


def number(value: float, kind: str = "Float64") -> Any:
    return STORE.types[f"std_msgs/msg/{kind}"](data=value)


def drive(start: int = START, count: int = COUNT, logged_from: int | None = None) -> list[Message]:
    """Joint states at 100 per second, inertial unit at 200, odometry at 25, voltage without header at 10.

    Values are straight lines over time where topics are joined, so that the joint values are known.
    """
    offset = (start if logged_from is None else logged_from) - start + DELAY
    made: list[Message] = []
    for k in range(count):
        stamp, t = start + k * 10**9 // RATE, k / RATE
        made.append(("/joint_states", "sensor_msgs/msg/JointState", stamp + offset, joint_state(stamp, t)))
        for half in (0, 1):
            own = stamp + half * 5_000_000
            made.append(("/imu", "sensor_msgs/msg/Imu", own + offset, imu(own, (own - start) * 1e-9)))
        if k % 4 == 0:
            made.append(("/odom", "nav_msgs/msg/Odometry", stamp + offset, odometry(stamp, t)))
        if k % 10 == 0:
            made.append(("/voltage", "std_msgs/msg/Float64", stamp + offset, number(24.0 - t)))
    text = STORE.types["std_msgs/msg/String"](data="hello")
    return [*made, ("/rosout", "std_msgs/msg/String", start + offset, text)]


def write_bag(path: Path, messages: Iterable[Message], plugin: StoragePlugin = StoragePlugin.SQLITE3) -> Path:
    """A bag by the writer of rosbags."""
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        opened: dict[str, Any] = {}
        for topic, kind, logged, message in messages:
            if topic not in opened:
                opened[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(opened[topic], logged, STORE.serialize_cdr(message, kind))
    return path


def write_mcap(
    path: Path, messages: Iterable[Message], compression: CompressionType = CompressionType.ZSTD
) -> Path:
    """An MCAP file by the writer of mcap, with messages packed by rosbags."""
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression, chunk_size=4096)
        writer.start(profile="ros2")
        opened: dict[str, int] = {}
        for topic, kind, logged, message in messages:
            if topic not in opened:
                definition, _ = STORE.generate_msgdef(kind, ros_version=2)
                schema = writer.register_schema(kind, "ros2msg", definition.encode())
                opened[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(opened[topic], logged, bytes(STORE.serialize_cdr(message, kind)), logged)
        writer.finish()
    return path


def write_ros2_mcap(path: Path, kind: str, definition: str, messages: Iterable[tuple[int, Any]]) -> Path:
    """An MCAP file by the writer of mcap_ros2, which packs messages itself, with one topic `/own`."""
    with path.open("wb") as file:
        writer = Ros2Writer(file)
        schema = writer.register_msgdef(kind, definition)
        for logged, message in messages:
            writer.write_message("/own", schema, message, log_time=logged, publish_time=logged)
        writer.finish()
    return path


def write_json_mcap(
    path: Path, rows: Iterable[tuple[int, Any]], schema: Any = None, kind: str = "robot.State"
) -> Path:
    """An MCAP file with JSON messages of one topic `/robot`."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        text = json.dumps(schema or {"type": "object"}).encode()
        number = writer.register_schema(kind, "jsonschema", text)
        channel = writer.register_channel("/robot", "json", number)
        for logged, content in rows:
            payload = content if isinstance(content, bytes) else json.dumps(content).encode()
            writer.add_message(channel, logged, payload, logged)
        writer.finish()
    return path


WRITERS: dict[str, Callable[[Path, Iterable[Message]], Path]] = {
    "bag in SQLite": lambda folder, made: write_bag(folder / "drive", made),
    "bag in MCAP": lambda folder, made: write_bag(folder / "drive", made, StoragePlugin.MCAP),
    "MCAP, zstd": lambda folder, made: write_mcap(folder / "drive.mcap", made),
    "MCAP, lz4": lambda folder, made: write_mcap(folder / "drive.mcap", made, CompressionType.LZ4),
    "MCAP, plain": lambda folder, made: write_mcap(folder / "drive.mcap", made, CompressionType.NONE),
}
"""Writers of a list of messages to a folder."""
