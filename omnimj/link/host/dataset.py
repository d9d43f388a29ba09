"""Recording of a link as a dataset of one run: raw readings calibrated again, commands as accepted."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from omnimj.errors import InputError
from omnimj.link.calibration import Calibration, WheelMap, calibration_hash, require_hardware
from omnimj.link.codec.messages import Command, Status, Telemetry
from omnimj.link.host.frame_log import FRAMES_FILE, FrameRecording
from omnimj.parameters.hardware import Hardware
from omnimj.parameters.robot import Robot
from omnimj.plant.interface import robot_channels
from omnimj.recording.dataset import Dataset, Run, plant_columns
from omnimj.recording.dataset_file import DATASET_FILE
from omnimj.recording.read_dataset import MIN_SAMPLES, mask_runs
from omnimj.signals import Array


def is_link_recording(folder: Path) -> bool:
    """True if a folder holds a log of frames and no dataset."""
    return (folder / FRAMES_FILE).is_file() and not (folder / DATASET_FILE).exists()


def read_link_recording(folder: Path, robot: Robot, floor: str | None = None) -> Dataset:
    """Read a run that was driven or observed over a link.

    Time 0 is the first telemetry of the armed device, or the first telemetry if it never was. Row k holds the
    measurement and the next command that the device accepted, as in a trace.

    Args:
      folder: Folder with `frames.bin`.
      robot: Robot whose [hardware] calibrates the raw readings.
      floor: Floor of the run; the recording's if None.

    Raises:
      InputError: No recording, too few samples, or fewer channels than the wiring has.
    """
    file, hardware = folder / FRAMES_FILE, require_hardware(robot)
    recording = FrameRecording(file)
    rows = _rows(recording, hardware, file)
    if len(rows) < MIN_SAMPLES:
        raise InputError(file, f"has {len(rows)} samples", f"at least {MIN_SAMPLES} are needed")
    finite = np.isfinite(rows).all(axis=1)
    columns = _columns(rows[finite], len(robot.wheels))
    conditions = {"floor": str(recording.about.get("floor", "")) if floor is None else floor}
    run = Run(
        _name(recording.about), MappingProxyType(columns), MappingProxyType({}), MappingProxyType(conditions)
    )
    masked, notes = mask_runs(plant_columns("uto_robot", len(robot.wheels)), [run])
    notes = [*_notes(recording, hardware, int((~finite).sum())), *notes]
    return Dataset(folder, "uto_robot", tuple(masked), tuple(notes), len(robot.wheels))


def _rows(recording: FrameRecording, hardware: Hardware, file: Path) -> Array:
    """Time [s], channels and the next accepted currents [A], shape (k, 1 + 2 n + 4 + n)."""
    calibration, wheels, n = Calibration(hardware), WheelMap.from_hardware(hardware), len(hardware.outputs)
    channels = 1 + max(i.channel for i in hardware.inputs)
    sent: dict[int, tuple[float, ...]] = {}
    rows, width = array("d"), 1 + 3 * n + 4
    current, zero, last_time, was_armed, accepted = np.zeros(n), math.nan, -math.inf, False, 0
    for logged in recording:
        frame, message = logged.frame, logged.frame.message
        if logged.is_sent and isinstance(message, Command) and len(message.currents) == n:
            sent[frame.sequence] = message.currents
        if not isinstance(message, Telemetry) or frame.time <= last_time:
            continue
        if len(message.raw) < channels:
            raise InputError(file, f"has {len(message.raw)} channels", f"the wiring needs {channels}")
        if message.acknowledged != accepted and message.acknowledged in sent:
            accepted = message.acknowledged
            current = wheels.from_device(sent[accepted], 0).current
            sent = {number: currents for number, currents in sent.items() if number > accepted}
            if rows:
                rows[-n:] = array("d", current)  # the command answered the previous row
        if Status.ARMED in message.status and not was_armed:
            was_armed, rows, zero = True, array("d"), math.nan
        zero = frame.time if math.isnan(zero) else zero
        last_time = frame.time
        m = calibration.convert(frame.time / 1e6, message.raw)
        rows.append((frame.time - zero) / 1e6)
        for part in (m.current, m.wheel_speed, m.acceleration, (m.yaw_rate, m.yaw), current):
            rows.extend(part)
    return np.array(rows).reshape(-1, width)


def _columns(rows: Array, wheels: int) -> dict[str, Array]:
    targets = [f"current_target_{i}" for i in range(1, wheels + 1)]
    names = ("time", *robot_channels(wheels), *targets)
    columns = dict(zip(names, np.ascontiguousarray(rows.T), strict=True))
    for values in columns.values():
        values.flags.writeable = False
    return columns


def _name(about: Mapping[str, object]) -> str:
    name = str(about.get("scenario", ""))
    plain = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if plain else "recorded"


def _notes(recording: FrameRecording, hardware: Hardware, broken: int) -> list[str]:
    found = []
    if recording.about.get("calibration_hash") != f"{calibration_hash(hardware):016x}":
        found.append("calibrated with another [hardware] than the run was driven with")
    if not recording.is_whole:
        found.append("the recording breaks off within a frame")
    if broken:
        found.append(f"{broken} samples omitted, since a reading is not finite")
    return found
