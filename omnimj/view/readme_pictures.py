"""Pictures of README and docs.

`MUJOCO_GL=osmesa python -m omnimj.view.readme_pictures omnimj/docs/pictures` generates them. That of the
sensitivity is a file of the study itself, `--tuning REPORT` arranges the plots of a report of `omnimj tune`.
"""

from __future__ import annotations

import argparse
import functools
import re
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from omnimj.estimate.gap.find import find_gap
from omnimj.estimate.gap.records import Finding, overlays_by_run, worst_run
from omnimj.resources import models_folder
from omnimj.signals import Array
from omnimj.simulate.run import PoseTrack, run_scenario
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.simulate.suites.catalogue import find_suite
from omnimj.simulate.suites.recording import RecordingConfig, record_suite
from omnimj.view import palette, wording
from omnimj.view.picture import Camera, camera_at, frames
from omnimj.view.plots import comparison, diagnosis, mismatch
from omnimj.view.plots.over_time import finish
from omnimj.view.plots.panels import MIDDLE, Drawing, new_drawing
from omnimj.view.plots.static import FONTS, WIDTH, svg_file
from omnimj.view.poses import visible_model
from omnimj.view.report.gap import write_gap_report
from omnimj.view.residuals import families
from omnimj.wheels import LAYOUTS, robot_file, wheeled_robot

_CURRENTS = (0.45, 0.6, 0.9, 1.35)  # [A] motor currents of the rig
_LABELS_AT = 0.9  # [m/s] speed at which curves are labelled
_LATERAL_SEED = 5
_SHOT_SIZE, _COLUMNS, _GAP = (560, 400), 3, 8  # [pixels]
_ROBOT_CAMERA = Camera(target=(0.012, -0.016, 0.05), distance=0.77, azimuth=146.0, elevation=-24.0)
_WHEELS_CAMERA = Camera(target=(0.0, 0.0, 0.04), distance=0.74, azimuth=140.0, elevation=-24.0)
_ROBOT_SIZE, _ANIMATION_SIZE = (1200, 800), (560, 360)  # [pixels]
_FRAME_RATE = 15  # [1/s]
_CLOSE = 0.72  # [m] distance of the camera from the machine in the gallery
_BROWSER, _SCREEN = "chromium", "1200,860"  # [pixels]
_HEADING = 22  # [pixels]
_STILL = r"<figcaption><b>([^<]*)</b>[^<]*</figcaption>.*?<div class='still'>"
_STILL += r"(<svg viewBox=\"0 0 \d+ (\d+)\".*?</svg>)</div>"
"""A figure of a report: heading, still picture, its height."""
_NO_ROLLER_FRICTION = """
[wheel]
roller_dry = { value = 0.0, unit = "1", source = "chosen" }
roller_viscous = { value = 0.0, unit = "s/m", source = "chosen" }
"""


def twin_against_equations() -> Drawing:
    """Plot the twin against the equations of the dissertation: rig at constant currents on natural stone."""
    drawing = new_drawing(MIDDLE)
    (panel,) = drawing.panels
    panel.values("carriage [m/s]")
    time = np.zeros(0)
    for current in _CURRENTS:
        scenario = read_scenario("rig_constant_current", (f"current={current}", "checks={}"))
        for plant, label, color, dash, width in (
            ("twin", "twin", palette.lighter(palette.MEASURED, 0.45), "-", 3.4),
            ("planar", "equations", palette.INK, (0, (5, 3)), 1.1),
        ):
            trace = run_scenario(scenario, plant, "off").trace
            time, speed = trace["time"], trace["carriage_speed"]
            panel.line(time, speed, color, label, dash, width)
        at = int(np.argmax(speed > _LABELS_AT))
        panel.text(time[at], speed[at], f"{current:g} A", x_offset=8, y_offset=-6)
    panel.legend()
    return finish(drawing, time, ())


def motor_evidence() -> Drawing:
    """Plot the evidence for a weak motor in `degraded_motor`, by wheel, with its threshold."""
    run = run_scenario(read_scenario("degraded_motor"), "twin", "robust")
    spans = wording.fault_spans(run.metrics, float(run.trace["time"][-1]))
    by_name = {family.name: family for family in families(run.trace.columns, "robust")}
    return diagnosis.residual_families(run.trace, [by_name["motor"]], spans)


def recovered_path() -> Drawing:
    """Plot the path of `two_motors_lost` from above: planned, and driven without and with recovery."""
    scenario = read_scenario("two_motors_lost")
    traces = {method: run_scenario(scenario, "twin", method).trace for method in ("robust", "off")}
    return comparison.paths(traces, scenario.patches)


@functools.cache
def _lateral_gap() -> Finding:
    """Search for the gap between a rig driven sideways and a model without roller friction."""
    with tempfile.TemporaryDirectory() as folder:
        data, model = Path(folder) / "lateral", Path(folder) / "rig.toml"
        record_suite(find_suite("rig_lateral"), RecordingConfig(data, _LATERAL_SEED))
        text = (models_folder() / "quarter_rig" / "rig.toml").read_text(encoding="utf-8")
        model.write_text(text + _NO_ROLLER_FRICTION, encoding="utf-8")
        return find_gap(data, model)


def gap_before_and_after() -> Drawing:
    """Plot the worst held-out run of a rig driven sideways, whose model lacks roller friction."""
    finding = _lateral_gap()
    run = worst_run(finding)
    assert run is not None  # some runs are held out
    return mismatch.overlay(finding, overlays_by_run(finding)[run])


def make_gap_report(path: Path) -> None:
    """Take a screenshot of the top of a gap report in headless Chromium."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        write_gap_report(page, _lateral_gap(), new_model="rig.toml")
        options = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            f"--window-size={_SCREEN}",
            "--virtual-time-budget=8000",  # the browser draws the plots
        ]
        profile = f"--user-data-dir={folder}/profile"
        command = [_BROWSER, *options, profile, f"--screenshot={path.resolve()}", page.as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)


FIGURES: Mapping[str, Callable[[], Drawing]] = MappingProxyType(
    {
        "twin": twin_against_equations,
        "diagnosis": motor_evidence,
        "recovery": recovered_path,
        "gap": gap_before_and_after,
    }
)
"""Functions that make the figures, by file name."""


@dataclass(frozen=True)
class Shot:
    """View of a scenario at one time, from near the machine."""

    scenario: str
    time: float
    """Time in the scenario [s]."""
    azimuth: float = 140.0
    """Azimuth of the camera [°]."""
    elevation: float = -34.0
    """Elevation of the camera [°]; negative: looking down."""
    height: float = 0.045
    """Height of the point in the middle of the picture [m]."""


GALLERY = (
    Shot("nylon_patch", 0.9),
    Shot("circle_8m_wheel_locked", 30.0, azimuth=118.0),
    Shot("ramp", 2.6, azimuth=112.0, elevation=-24.0, height=0.07),
    Shot("three_wheel_circle", 9.0, azimuth=160.0),
    Shot("three_wheel_nylon", 0.9, azimuth=160.0),
    Shot("rig_slip", 0.6, azimuth=-58.0, elevation=-26.0, height=0.13),
)
"""Pictures of the gallery, from left to right, row by row."""


def _drive(name: str) -> tuple[mujoco.MjModel, PoseTrack, Array]:
    """Drive a scenario on the twin; return its visible model, its poses and its path, shape (k, 2) [m]."""
    scenario = read_scenario(name)
    result = run_scenario(scenario, "twin", "robust" if scenario.plant == "uto_robot" else "off")
    trace, poses = result.trace, result.poses
    assert poses is not None  # the twin records poses
    path = np.column_stack([trace["x"], trace["y"]]) if "x" in trace else np.empty((0, 2))
    if len(path):
        path = path[np.searchsorted(trace["time"], poses.time - 1e-9)]
    return visible_model(scenario), poses, path


def make_gallery(path: Path) -> None:
    """Render six scenarios in close-up on one sheet."""
    pictures = []
    for shot in GALLERY:
        mj_model, poses, trail = _drive(shot.scenario)
        k = int(np.argmin(np.abs(poses.time - shot.time)))
        x, y, _ = camera_at(mj_model, poses.position[k]).target
        camera = Camera((x, y, shot.height), _CLOSE, shot.azimuth, shot.elevation)
        pictures += frames(mj_model, [(poses.position[k], camera, trail[: k + 1])], _SHOT_SIZE)
    _save_sheet(pictures, path)


def _save_sheet(pictures: Sequence[NDArray[np.uint8]], path: Path) -> None:
    """Arrange pictures of `_SHOT_SIZE` on white, row by row."""
    width, height = _SHOT_SIZE
    rows = -(-len(pictures) // _COLUMNS)
    sheet = np.full((rows * (height + _GAP) - _GAP, _COLUMNS * (width + _GAP) - _GAP, 3), 255, np.uint8)
    for number, pixels in enumerate(pictures):
        row, column = divmod(number, _COLUMNS)
        top, left = row * (height + _GAP), column * (width + _GAP)
        sheet[top : top + height, left : left + width] = pixels
    Image.fromarray(sheet).save(path)


def make_wheels(path: Path) -> None:
    """Render robots on omni and mecanum wheels, as `omnimj robot` writes them, on one sheet."""
    models = [mujoco.MjModel.from_xml_string(robot_file(wheeled_robot(layout))) for layout in LAYOUTS]
    shots = [(model, [(model.qpos0, _WHEELS_CAMERA, np.empty((0, 2)))]) for model in models]
    _save_sheet([pixels for model, shot in shots for pixels in frames(model, shot, _SHOT_SIZE)], path)


def make_robot(path: Path) -> None:
    """Render the robot at its start: on stone, wheel 1 on a nylon sheet."""
    mj_model = visible_model(read_scenario("nylon_patch"))
    (pixels,) = frames(mj_model, [(mj_model.qpos0, _ROBOT_CAMERA, np.empty((0, 2)))], _ROBOT_SIZE)
    Image.fromarray(pixels).save(path)


def make_animation(path: Path) -> None:
    """Render `nylon_patch` as a short animation that follows the robot."""
    mj_model, poses, trail = _drive("nylon_patch")
    times = np.arange(poses.time[0], poses.time[-1], 1.0 / _FRAME_RATE)
    shots = []
    for k in np.searchsorted(poses.time, times):
        x, y = poses.position[k, :2]
        shots.append((poses.position[k], Camera((x, y, 0.045), 0.78, 146.0, -33.0), trail[: k + 1]))
    images = [Image.fromarray(pixels) for pixels in frames(mj_model, shots, _ANIMATION_SIZE)]
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=1000 // _FRAME_RATE, loop=0, quality=60
    )


def arrange_tuning(report: Path, path: Path) -> None:
    """Arrange the still pictures of a report of `omnimj tune` in two columns, with their headings."""
    figures = re.findall(_STILL, report.read_text(encoding="utf-8"), re.DOTALL)
    parts, (width, top) = [], (2 * WIDTH, 0)
    for row in range(0, len(figures), 2):
        heights = [int(height) for _, _, height in figures[row : row + 2]]
        for column, (heading, picture, height) in enumerate(figures[row : row + 2]):
            left, words = column * WIDTH, heading.rpartition(": ")[2].capitalize()
            parts.append(f'<text x="{left + 8}" y="{top + 16}" font-weight="bold">{words}</text>')
            place = f'<svg x="{left}" y="{top + _HEADING}" width="{WIDTH}" height="{height}" '
            parts.append(picture.replace("<svg ", place, 1))
        top += max(heights) + _HEADING + _GAP
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{top}" viewBox="0 0 {width} {top}"'
    )
    look = f'font-family="{FONTS}" font-size="12" fill="{palette.INK}"'
    white = '<rect width="100%" height="100%" fill="white"/>'
    path.write_text(f"{head} {look}>{white}{''.join(parts)}</svg>\n", encoding="utf-8")


def _save_figure(draw: Callable[[], Drawing], path: Path) -> None:
    path.write_text(svg_file(draw()), encoding="utf-8")


PICTURES: Mapping[str, Callable[[Path], None]] = MappingProxyType(
    {
        "robot.png": make_robot,
        "wheels.png": make_wheels,
        "gallery.png": make_gallery,
        "drive.webp": make_animation,
        "gap_report.png": make_gap_report,
        **{f"{name}.svg": functools.partial(_save_figure, draw) for name, draw in FIGURES.items()},
    }
)
"""Functions that make the pictures, by file name."""


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Makes the pictures of README and docs.")
    parser.add_argument("folder", type=Path, help="folder for the pictures, e.g. omnimj/docs/pictures")
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"any of {', '.join(PICTURES)} (default all)"
    )
    parser.add_argument("--tuning", type=Path, metavar="REPORT", help="arrange tuning.svg and nothing else")
    arguments = parser.parse_args()
    for name in arguments.names:
        if name not in PICTURES:
            parser.error(f"found {name!r}; choose from {', '.join(PICTURES)}")
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if arguments.tuning:
        arrange_tuning(arguments.tuning, arguments.folder / "tuning.svg")
    for name in arguments.names or (() if arguments.tuning else PICTURES):
        PICTURES[name](arguments.folder / name)
