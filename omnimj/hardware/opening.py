"""From an address to a link."""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import Any

from omnimj.hardware.address import Address, SerialAddress, parse_address
from omnimj.hardware.calibration import commissioned_for, require_hardware
from omnimj.hardware.frame_log import FrameLog
from omnimj.hardware.host import Host
from omnimj.hardware.key_file import read_key
from omnimj.hardware.link import Link
from omnimj.hardware.link_mode import Mode
from omnimj.hardware.serial_port import SerialTransport
from omnimj.hardware.udp import UdpTransport
from omnimj.hardware.wire import Transport
from omnimj.parameters.robot import Robot


def open_link(
    address: str | Address,
    robot: Robot,
    *,
    key_file: Path | str | None = None,
    lock_step: bool = False,
    mode: Mode = Mode.DRIVE,
    log_to: Path | None = None,
    about: dict[str, Any] | None = None,
) -> Link:
    """A link to the device at an address, which must be wired as the robot's model file says.

    Args:
      address: `serial:DEVICE?baud=N` or `udp:HOST:PORT`.
      robot: With [hardware].
      key_file: Of a link that may leave this machine.
      lock_step: As opposed to real time.
      mode: What may be sent.
      log_to: A new file for every frame.
      about: What the log says of itself, beside the address and the calibration's hash.

    Raises:
      InputError: No [hardware], a wrong address or key file, or a wire that cannot be opened.
    """
    where = parse_address(address, "--plant") if isinstance(address, str) else address
    key = None if key_file is None else read_key(key_file)
    period = 1.0 / robot.sensors.sample_rate
    hardware = require_hardware(robot)
    expected = commissioned_for(hardware, period, lock_step=lock_step, keyed=key is not None)
    if isinstance(where, SerialAddress):
        transport: Transport = SerialTransport(where)
    else:
        transport = UdpTransport(where, key is not None)
    log = None
    if log_to is not None:
        facts = {"address": str(where), "calibration_hash": f"{expected.calibration_hash:016x}"}
        log = FrameLog(log_to, {"plant": "uto_robot", **facts, "mode": mode.value, **(about or {})})
    host = Host(expected, lambda: secrets.randbits(64))
    return Link(host, transport, key=key, mode=mode, log=log, name=str(where))
