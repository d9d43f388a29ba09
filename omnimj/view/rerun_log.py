"""`run.rrd`: a run for the Rerun viewer, written in columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from omnimj.signals import Trace
from omnimj.view import wording
from omnimj.view.blueprint import Eye, run_blueprint
from omnimj.view.rerun_scene import MACHINE, NORMAL_SCALE, TRACTION_SCALE, log_scene
from omnimj.view.rerun_signals import Plot, log_plots, log_states, rig_plots, robot_plots
from omnimj.view.scene3d import Poses
from omnimj.view.wording import Described

_LEGEND = (
    f"Orange arrows: traction, {1000 * TRACTION_SCALE:.0f} mm per N. "
    f"Light blue arrows: normal force, {1000 * NORMAL_SCALE:.0f} mm per N. "
    "Blue line: driven path. Grey line: planned path. Light blue area: a patch of other floor. "
    "The dark stripes show how the rollers turn."
)


def write_recording(
    path: Path,
    trace: Trace,
    scenario: Described,
    metrics: Mapping[str, Any],
    poses: Poses | None = None,
) -> None:
    """Writes a run as a Rerun recording with its blueprint.

    Args:
      path: The `.rrd` file to write.
      trace: What was recorded, at least two rows.
      scenario: What was asked for.
      metrics: Content of `metrics.json`.
      poses: What moved; without them the recording holds plots, states and paths.
    """
    plots = rig_plots(trace, scenario.constants.wheel.radius) if _is_rig(trace) else robot_plots(trace)
    stream = rr.RecordingStream("omnimj")
    stream.save(path, default_blueprint=_blueprint(trace, plots, poses))
    with stream:
        stream.send_recording_name(wording.title(metrics))
        words = rr.TextDocument(_about(scenario, metrics), media_type="text/markdown")
        stream.log("about", words, static=True)
        log_scene(stream, trace, poses, scenario.patches, str(metrics.get("floor", scenario.floor)))
        log_plots(stream, trace, plots)
        log_states(stream, trace, metrics)
    stream.disconnect()


def _is_rig(trace: Trace) -> bool:
    return "carriage_speed" in trace


def _blueprint(trace: Trace, plots: list[Plot], poses: Poses | None) -> rrb.Blueprint:
    if _is_rig(trace):
        return run_blueprint(plots, trace, Eye((0.1, 1.35, 0.65), (0.75, 0.0, 0.12)))
    x, y = (float(trace["x"][0]), float(trace["y"][0])) if "x" in trace else (0.0, 0.0)
    if poses is None:
        return run_blueprint(plots, trace, Eye((x - 2.5, y - 2.5, 4.0), (x, y, 0.0)))
    return run_blueprint(
        plots, trace, Eye((x - 0.8, y - 0.95, 0.75), (x, y, 0.08), f"{MACHINE}/chassis/surface")
    )


def _about(scenario: Described, metrics: Mapping[str, Any]) -> str:
    floor = str(metrics.get("floor", scenario.floor)).replace("_", " ")
    lines = [scenario.description, ""]
    lines.append(f"Floor: {floor}. Method: {metrics.get('method', '–')}. Seed: {metrics.get('seed', '–')}.")
    lines.append("")
    for check in metrics.get("checks") or ():
        name, unit = check["name"], scenario.metric_units.get(check["name"], "")
        sign = "✓" if check["ok"] else "✗"
        value = wording.number(check.get("value"), 3)
        lines.append(f"- {sign} {name.replace('_', ' ')}: {value} {unit}")
    return "\n".join([*lines, "", _LEGEND])
