"""Addresses of devices: `serial:/dev/ttyACM0?baud=921600`, `udp:127.0.0.1:9750`, `udp:[::1]:9750`."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from urllib.parse import parse_qsl

from omnimj.errors import InputError, UnknownNameError

BAUD = 921_600
"""Default rate of a serial port [1/s]."""
LOOPBACK = "127.0.0.1"
"""Default host of a UDP address."""
_FORMS = "serial:DEVICE?baud=N or udp:HOST:PORT, with IPv6 as udp:[::1]:PORT"


@dataclass(frozen=True)
class SerialAddress:
    """Serial port."""

    path: str
    """Name of the port, such as `/dev/ttyACM0` or `COM3`."""
    baud: int = BAUD
    """Rate [1/s]; USB and pseudo-terminals ignore it."""

    def __str__(self) -> str:
        return f"serial:{self.path}?baud={self.baud}"


@dataclass(frozen=True)
class UdpAddress:
    """Host and UDP port."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"udp:[{self.host}]:{self.port}" if ":" in self.host else f"udp:{self.host}:{self.port}"


Address = SerialAddress | UdpAddress


def is_loopback(numeric: str) -> bool:
    """True if a numeric address is on this machine's loopback."""
    try:
        return ipaddress.ip_address(numeric.partition("%")[0]).is_loopback
    except ValueError:
        return False


def parse_address(text: str, place: object = "address") -> Address:
    """Parse an address.

    Args:
      text: Address in one of the forms above.
      place: Argument or file that holds it, for the error message.

    Raises:
      InputError: The text has neither form, or a number is out of range.
    """
    kind, colon, rest = text.partition(":")
    if colon and kind == "serial":
        return _parse_serial(rest, place)
    if colon and kind == "udp":
        return _parse_udp(rest, place)
    raise InputError(place, f"'{text}'", f"must be {_FORMS}")


def _parse_integer(text: str, place: object, name: str, most: int) -> int:
    # isdecimal alone accepts the digits of other alphabets, int alone "+5", "1_0" and spaces
    if not (text.isascii() and text.isdecimal() and len(text) <= 10 and 0 < int(text) <= most):
        raise InputError(place, f"{name} '{text}'", f"must be a whole number 1…{most}")
    return int(text)


def _parse_serial(rest: str, place: object) -> SerialAddress:
    path, _, query = rest.partition("?")
    if not path or "\0" in path:
        raise InputError(place, f"serial device '{path}'", f"must be {_FORMS}")
    baud = BAUD
    for name, value in parse_qsl(query, keep_blank_values=True):
        if name != "baud":
            raise UnknownNameError(place, "option of a serial address", name, ["baud"])
        baud = _parse_integer(value, place, "baud", 20_000_000)
    return SerialAddress(path, baud)


def _parse_udp(rest: str, place: object) -> UdpAddress:
    host, _, port = rest.rpartition(":")
    bracketed = host.startswith("[") and host.endswith("]")
    if bracketed:
        host = host[1:-1]
        if ":" not in host:
            raise InputError(place, f"host '[{host}]'", "brackets are for IPv6")
    elif ":" in host or "[" in host or "]" in host:
        raise InputError(place, f"host '{host}'", f"must be {_FORMS}")
    if any(letter.isspace() or letter in "/?#@" for letter in host) or "\0" in host:
        raise InputError(place, f"host '{host}'", "must be a name or an address")
    return UdpAddress(host or LOOPBACK, _parse_integer(port, place, "port", 65535))
