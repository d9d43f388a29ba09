"""The gallery in the README: `python -m omnimj.view.gallery models/gallery.png`."""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.image import imread, imsave

from omnimj.scenario.running import run_scenario
from omnimj.scenario.scenario import read_scenario
from omnimj.view.machine import visible_model
from omnimj.view.picture import Camera, render

_SIZE = (420, 280)
_COLUMNS = 3
_GAP = 6  # [pixels] of white between pictures


@dataclass(frozen=True)
class Shown:
    """One picture: a scenario at a time, from a place beside the robot."""

    scenario: str
    time: float
    """[s]"""
    distance: float = 1.1
    """Of the camera from the robot [m]."""
    azimuth: float = 140.0
    """[°]"""
    elevation: float = -24.0
    """[°]"""
    in_the_middle: bool = False
    """Whether the camera looks at the middle of the path instead of at the robot."""


SHOWN = (
    Shown("nylon_patch", 0.9),
    Shown("circle_8m_wheel_locked", 30.0, distance=10.2, elevation=-42.0, in_the_middle=True),
    Shown("ramp", 2.6, distance=1.6, azimuth=110.0, elevation=-12.0),
    Shown("three_wheel_circle", 9.0, distance=5.2, elevation=-35.0, in_the_middle=True),
    Shown("three_wheel_nylon", 0.9),
    Shown("rig_slip", 0.6, distance=1.0, azimuth=-58.0, elevation=-16.0),
)
"""From left to right, row by row."""


def _one(shown: Shown, path: Path) -> None:
    """Drives a scenario on the twin and renders what was driven."""
    scenario = read_scenario(shown.scenario)
    outcome = run_scenario(scenario, "twin", "robust" if scenario.plant == "uto_robot" else "off")
    trace, poses = outcome.trace, outcome.poses
    assert poses is not None  # the twin has some
    k = int(np.argmin(np.abs(poses.time - shown.time)))
    trail = None
    if "x" in trace:
        trail = np.column_stack([trace["x"], trace["y"]])[trace["time"] <= shown.time]
    x, y = poses.position[k, :2] if scenario.plant == "uto_robot" else poses.position[k, 1::-1]
    if shown.in_the_middle:
        x, y = 0.0, 0.0
    camera = Camera((float(x), float(y), 0.08), shown.distance, shown.azimuth, shown.elevation)
    render(visible_model(scenario), poses.position[k], path, shown.scenario, camera, trail, _SIZE)


def make(path: Path) -> None:
    """Renders all pictures into one."""
    width, height = _SIZE
    rows = -(-len(SHOWN) // _COLUMNS)
    sheet = np.ones((rows * (height + _GAP) - _GAP, _COLUMNS * (width + _GAP) - _GAP, 3))
    with tempfile.TemporaryDirectory() as folder:
        for k, shown in enumerate(SHOWN):
            _one(shown, Path(folder) / "one.png")
            row, column = divmod(k, _COLUMNS)
            top, left = row * (height + _GAP), column * (width + _GAP)
            sheet[top : top + height, left : left + width] = imread(Path(folder) / "one.png")[..., :3]
    imsave(path, sheet)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Renders the README's gallery of scenarios.")
    parser.add_argument("png", type=Path, help="the file to write, e.g. models/gallery.png")
    make(parser.parse_args().png)
