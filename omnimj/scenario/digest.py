"""What a scenario consists of, as one short text: alike only where everything that acts on a run is alike."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path

from omnimj.parameters.toml_file import read_toml
from omnimj.scenario.listing import find_scenario
from omnimj.scenario.scenario import Scenario


def digest_of(text: str, scenario: Scenario) -> str:
    """Of the scenario's file, the numbers of its machine and its floors; where files lie does not matter.

    Args:
      text: Its name or path.
      scenario: As read from there.
    """
    machine = dataclasses.replace(scenario.constants, file=Path(), provenance={})
    floors = {name: dict(floor.numbers) for name, floor in scenario.floors.items()}
    told = repr((read_toml(find_scenario(text)), machine, floors))
    return hashlib.sha256(told.encode()).hexdigest()


def located(text: str) -> str:
    """The same scenario for who works in another folder: a path is made absolute, a name stays."""
    path = find_scenario(text)
    return text if path.stem == text else str(path.absolute())
