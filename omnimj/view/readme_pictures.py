"""The README's figures, one per claim: `python -m omnimj.view.readme_pictures models`."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import imread, imsave

from omnimj.estimate.gap.find import find_gap
from omnimj.estimate.gap.records import overlays_by_run, worst_run
from omnimj.resources import models_folder
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.simulate.suites.catalogue import find_suite
from omnimj.simulate.suites.recording import RecordingConfig, record_suite
from omnimj.view import palette, wording
from omnimj.view.picture import Camera, Picture, render
from omnimj.view.plots import comparison, diagnosis, mismatch
from omnimj.view.plots.drawing import MIDDLE, legend, line, new_figure, time_axis, value_axis
from omnimj.view.poses import visible_model
from omnimj.view.residuals import families

_DPI = 110
_CURRENTS = (0.45, 0.6, 0.9, 1.35)  # [A]
_LABELS_AT = 0.9  # [m/s]
_LABEL: Mapping[str, Any] = MappingProxyType({"textcoords": "offset points", "fontsize": 8})
_LATERAL_SEED = 5
_NO_ROLLER_FRICTION = """
[wheel]
roller_dry = { value = 0.0, unit = "1", source = "chosen" }
roller_viscous = { value = 0.0, unit = "s/m", source = "chosen" }
"""


def twin_against_equations() -> Figure:
    """The rig at constant currents on natural stone: the twin, and the source's equations."""
    figure, (ax,) = new_figure(MIDDLE)
    time = np.zeros(0)
    for current in _CURRENTS:
        scenario = read_scenario("rig_constant_current", (f"current={current}", "checks={}"))
        for plant, style in (
            ("twin", {"color": palette.lighter(palette.MEASURED, 0.45), "linewidth": 3.4}),
            ("planar", {"color": palette.INK, "linestyle": (0, (5, 3)), "linewidth": 1.1}),
        ):
            trace = run_scenario(scenario, plant, "off").trace
            words = {"twin": "twin", "planar": "equations"}[plant] if current == _CURRENTS[0] else None
            time = trace["time"]
            line(ax, time, trace["carriage_speed"], label=words, **style)
        at = int(np.argmax(trace["carriage_speed"] > _LABELS_AT))
        ax.annotate(f"{current:g} A", (time[at], trace["carriage_speed"][at]), (6, -11), **_LABEL)
    value_axis(ax, "carriage [m/s]")
    time_axis(ax, time)
    legend(ax)
    return figure


def motor_evidence() -> Figure:
    """`degraded_motor`: the likelihood of a weak motor, wheel by wheel, and its threshold."""
    run = run_scenario(read_scenario("degraded_motor"), "twin", "robust")
    spans = wording.fault_spans(run.metrics, float(run.trace["time"][-1]))
    told = {family.name: family for family in families(run.trace.columns, "robust")}
    return diagnosis.residual_family(run.trace, told["motor"], spans)


def recovered_path() -> Figure:
    """`two_motors_lost` from above: as planned, without help, with recovery."""
    scenario = read_scenario("two_motors_lost")
    traces = {method: run_scenario(scenario, "twin", method).trace for method in ("robust", "off")}
    return comparison.paths(traces, scenario.patches)


def gap_before_and_after() -> Figure:
    """The rig moved sideways, and a model without friction in its rollers: the worst held-out run."""
    with tempfile.TemporaryDirectory() as folder:
        data, model = Path(folder) / "lateral", Path(folder) / "rig.toml"
        record_suite(find_suite("rig_lateral"), RecordingConfig(data, _LATERAL_SEED))
        text = (models_folder() / "quarter_rig" / "rig.toml").read_text(encoding="utf-8")
        model.write_text(text + _NO_ROLLER_FRICTION, encoding="utf-8")
        finding = find_gap(data, model)
    run = worst_run(finding)
    assert run is not None  # some are held out
    return mismatch.overlay(finding, overlays_by_run(finding)[run])


CLAIMS: Mapping[str, Callable[[], Figure]] = MappingProxyType(
    {
        "claim_twin": twin_against_equations,
        "claim_diagnosis": motor_evidence,
        "claim_recovery": recovered_path,
        "claim_gap": gap_before_and_after,
    }
)
"""By the name of the picture's file."""


def make_figures(folder: Path, names: tuple[str, ...] = tuple(CLAIMS)) -> None:
    """Drives and draws them into a folder."""
    for name in names:
        CLAIMS[name]().savefig(folder / f"{name}.png", dpi=_DPI)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draws the README's figures.")
    parser.add_argument("folder", type=Path, help="where the pictures go, e.g. models")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(CLAIMS)} (default all)")
    arguments = parser.parse_args()
    for name in arguments.names:
        if name not in CLAIMS:
            parser.error(f"found {name!r}; choose from {', '.join(CLAIMS)}")
    make_figures(arguments.folder, tuple(arguments.names) or tuple(CLAIMS))


# The gallery in the README: `python -m omnimj.view.readme_pictures models/gallery.png`.

_SHOT_SIZE = (420, 280)
_COLUMNS = 3
_GAP = 6  # [pixels] of white between pictures


@dataclass(frozen=True)
class GalleryShot:
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


GALLERY = (
    GalleryShot("nylon_patch", 0.9),
    GalleryShot("circle_8m_wheel_locked", 30.0, distance=10.2, elevation=-42.0, in_the_middle=True),
    GalleryShot("ramp", 2.6, distance=1.6, azimuth=110.0, elevation=-12.0),
    GalleryShot("three_wheel_circle", 9.0, distance=5.2, elevation=-35.0, in_the_middle=True),
    GalleryShot("three_wheel_nylon", 0.9),
    GalleryShot("rig_slip", 0.6, distance=1.0, azimuth=-58.0, elevation=-16.0),
)
"""From left to right, row by row."""


def _render_shot(shown: GalleryShot, path: Path) -> None:
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
    render(visible_model(scenario), poses.position[k], path, shown.scenario, camera, trail, _SHOT_SIZE)


def make_gallery(path: Path) -> None:
    """Renders all pictures into one."""
    width, height = _SHOT_SIZE
    rows = -(-len(GALLERY) // _COLUMNS)
    sheet = np.ones((rows * (height + _GAP) - _GAP, _COLUMNS * (width + _GAP) - _GAP, 3))
    with tempfile.TemporaryDirectory() as folder:
        for k, shown in enumerate(GALLERY):
            _render_shot(shown, Path(folder) / "one.png")
            row, column = divmod(k, _COLUMNS)
            top, left = row * (height + _GAP), column * (width + _GAP)
            sheet[top : top + height, left : left + width] = imread(Path(folder) / "one.png")[..., :3]
    imsave(path, sheet)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Renders the README's gallery of scenarios.")
    parser.add_argument("png", type=Path, help="the file to write, e.g. models/gallery.png")
    make_gallery(parser.parse_args().png)


# The picture of the robot in the README: `python -m omnimj.view.readme_pictures models/robot.png`.

ROBOT_SCENARIO = "nylon_patch"
_ROBOT_CAMERA = Camera(target=(0.012, -0.016, 0.05), distance=0.77, azimuth=146.0, elevation=-24.0)
_ROBOT_SIZE = (1200, 800)


def make_robot(path: Path) -> Picture:
    """Renders the robot at its start: on stone, wheel 1 on a nylon sheet."""
    mj_model = visible_model(read_scenario(ROBOT_SCENARIO))
    return render(
        mj_model, mj_model.qpos0, path, "the robot, wheel 1 on a nylon sheet", _ROBOT_CAMERA, size=_ROBOT_SIZE
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Renders the README's picture of the robot.")
    parser.add_argument("png", type=Path, help="the file to write, e.g. models/robot.png")
    made = make_robot(parser.parse_args().png)
    print(f"{made.path}: {made.way_in_words}")
