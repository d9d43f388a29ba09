"""The picture of the robot in the README: `python -m omnimj.view.readme_picture models/robot.png`."""

from __future__ import annotations

import argparse
from pathlib import Path

from omnimj.scenario.scenario import read_scenario
from omnimj.view.machine import visible_model
from omnimj.view.picture import Camera, Picture, render

SCENARIO = "nylon_patch"
_CAMERA = Camera(target=(0.012, -0.016, 0.05), distance=0.77, azimuth=146.0, elevation=-24.0)
_SIZE = (1200, 800)


def make(path: Path) -> Picture:
    """Renders the robot at its start: on stone, wheel 1 on a nylon sheet."""
    mj_model = visible_model(read_scenario(SCENARIO))
    return render(mj_model, mj_model.qpos0, path, "the robot, wheel 1 on a nylon sheet", _CAMERA, size=_SIZE)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Renders the README's picture of the robot.")
    parser.add_argument("png", type=Path, help="the file to write, e.g. models/robot.png")
    made = make(parser.parse_args().png)
    print(f"{made.path}: {made.way_in_words}")
