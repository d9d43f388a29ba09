"""Picture of a real run and its twin side by side: both robots where the run ends, and their paths.

`MUJOCO_GL=osmesa python -m omnimj.view.twin_picture DATASET RUN PICTURE --model FILE --floors FILE` makes it.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.integrate import cumulative_trapezoid

from omnimj.errors import UnknownNameError
from omnimj.estimate.drives.records import DrivenRun, DriveValidation
from omnimj.estimate.drives.validate import validate_drives
from omnimj.estimate.replay.base_parameters import floor_name
from omnimj.parameters import Floor, Robot, read_robot
from omnimj.parameters.floor import all_floors
from omnimj.plant.mujoco.assembly import robot_model
from omnimj.recording.read_dataset import read_dataset
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.picture import SUPERSAMPLING, add_path, place, smoothed
from omnimj.view.poses import robot_poses
from omnimj.view.rerun.side_by_side import side_by_side

_SIZE = 1000, 520  # [pixels]
_RADIUS = 0.006  # [m] of a path
_POINTS = 150  # most capsules of a path
_COLORS = {"measured": palette.MEASURED, "twin": palette.ACCENT, "rolling": palette.MUTED}
_WORDS = {"measured": "real robot", "twin": "twin", "rolling": "wheels without slip"}


class Line(NamedTuple):
    """Path of one robot."""

    points: Array
    """Shape (k, 2) [m]."""
    color: str


def make_twin_picture(path: Path, found: DriveValidation, run: str, robot: Robot, floor: Floor) -> None:
    """Render a run of a validation with both robots at its end.

    Raises:
      UnknownNameError: No such run.
    """
    by_plant = {one.plant: one for one in found.runs if one.run == run}
    if "twin" not in by_plant:
        raise UnknownNameError("picture", "run", run, tuple(dict.fromkeys(one.run for one in found.runs)))
    poses = side_by_side(by_plant["twin"])
    mj_model = robot_model(robot, floor)
    qpos = {name: _last(mj_model, by_plant["twin"], pose) for name, pose in poses.items()}
    lines = [Line(pose[:, :2], _COLORS[name]) for name, pose in poses.items()]
    real, rolled = poses["measured"][:, :2], by_plant["rolling"].simulated.pose[:, :2]
    lines += [Line(real - real[0], _COLORS["measured"]), Line(rolled - rolled[0], _COLORS["rolling"])]
    image = Image.fromarray(_rendered(mj_model, qpos, lines))
    _write_legend(image)
    image.quantize(200).save(path, optimize=True)


def _last(mj_model: mujoco.MjModel, run: DrivenRun, pose: Array) -> Array:
    angles = cumulative_trapezoid(run.wheel_speed, run.time, axis=0, initial=0.0)
    return robot_poses(mj_model, np.column_stack([pose[-1:], angles[-1:]]))[0]


def _rendered(mj_model: mujoco.MjModel, qpos: dict[str, Array], lines: Sequence[Line]) -> NDArray[np.uint8]:
    """Pixels of both robots and all paths, shape (height, width, 3)."""
    width, height = (SUPERSAMPLING * side for side in _SIZE)
    mj_model.vis.global_.offwidth, mj_model.vis.global_.offheight = width, height
    eye = _camera([line.points for line in lines])
    mj_model.light_pos[:, :2] += eye.lookat[:2]
    twin, real = (_placed(mj_model, qpos[name]) for name in ("twin", "measured"))
    with mujoco.Renderer(mj_model, height, width, max_geom=20_000) as renderer:
        renderer.update_scene(twin, eye)
        scene = renderer.scene
        moving = int(mujoco.mjtCatBit.mjCAT_DYNAMIC)
        mujoco.mjv_addGeoms(mj_model, real, mujoco.MjvOption(), mujoco.MjvPerturb(), moving, scene)
        for line in lines:
            red, green, blue = (channel / 255.0 for channel in palette.rgb(line.color))
            add_path(scene, line.points, (red, green, blue), _RADIUS, _POINTS)
        return smoothed(renderer.render(), _SIZE)


def _placed(mj_model: mujoco.MjModel, qpos: Array) -> mujoco.MjData:
    mj_data = mujoco.MjData(mj_model)
    place(mj_model, mj_data, qpos)
    return mj_data


def _camera(paths: Sequence[Array]) -> mujoco.MjvCamera:
    """Camera that looks across the paths from above."""
    points = np.vstack(paths)
    low, high = points.min(axis=0), points.max(axis=0)
    away = paths[0][-1] - paths[0][0]
    eye = mujoco.MjvCamera()
    eye.lookat[:] = (*(0.5 * (low + high)), 0.0)
    eye.distance = 0.5 + 0.75 * float(np.hypot(*(high - low)))
    eye.azimuth, eye.elevation = float(np.degrees(np.arctan2(away[1], away[0]))) + 90.0, -52.0
    return eye


def _write_legend(image: Image.Image) -> None:
    draw, font, left = ImageDraw.Draw(image), ImageFont.load_default(18), 16
    draw.rectangle((0, 0, image.width, 36), fill="white")
    for name, words in _WORDS.items():
        draw.rectangle((left, 15, left + 28, 20), fill=_COLORS[name])
        draw.text((left + 36, 7), words, fill=palette.INK, font=font)
        left += 60 + int(draw.textlength(words, font=font))


def _main() -> None:
    parser = argparse.ArgumentParser(description="Renders a real run and its twin.")
    parser.add_argument("dataset", type=Path, help="dataset of a robot with a measured pose")
    parser.add_argument("run", help="name of a run")
    parser.add_argument("picture", type=Path, help="PNG file to write")
    parser.add_argument("--model", required=True, help="model file")
    parser.add_argument("--floors", type=Path, help="floors beside the shipped ones")
    arguments = parser.parse_args()
    robot, floors = read_robot(arguments.model), all_floors(arguments.floors)
    dataset = read_dataset(arguments.dataset, floors)
    names = {run.name: run for run in dataset.runs}
    if arguments.run not in names:
        parser.error(f"found {arguments.run!r}; choose from {', '.join(names)}")
    floor = floors[floor_name(dataset, names[arguments.run], floors)]
    found = validate_drives(dataset, robot, floors, ("twin",))
    make_twin_picture(arguments.picture, found, arguments.run, robot, floor)


if __name__ == "__main__":
    _main()
