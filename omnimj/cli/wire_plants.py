"""Robots over a wire, as plants: `--plant udp:…` and `--plant serial:…`."""

from __future__ import annotations

from omnimj.errors import InputError
from omnimj.hardware.address import Address
from omnimj.plant.interface import Plant
from omnimj.scenario.plants import PLANT_NAMES
from omnimj.scenario.scenario import Scenario

WIRES = ("serial:", "udp:")
"""How the name of such a plant begins."""


def make_wire_plant(address: Address, scenario: Scenario) -> Plant:
    """The robot at an address; its `step` waits for its own clock.

    Args:
      address: From `parse_address`.
      scenario: For the constants that the robot was commissioned with.

    Raises:
      InputError: Nobody can be driven there.
    """
    raise InputError("--plant", f"found '{address}'", "this version drives no real robot", PLANT_NAMES)
