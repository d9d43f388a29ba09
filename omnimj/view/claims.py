"""The README's figures, one per claim: `python -m omnimj.view.claims models`."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from omnimj.gap.engine import find_gap
from omnimj.gap.per_run import runs_of, worst_run
from omnimj.resources import models_folder
from omnimj.scenario.running import run_scenario
from omnimj.scenario.scenario import read_scenario
from omnimj.scenario.suites.catalogue import find_suite
from omnimj.scenario.suites.recording import Order, record_suite
from omnimj.view import gap_plots_runs, palette, plots_compared, plots_diagnosis, wording
from omnimj.view.drawing import MIDDLE, legend, line, new_figure, time_axis, value_axis
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


def twin_beside_equations() -> Figure:
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


def motors_on_trial() -> Figure:
    """`degraded_motor`: the likelihood of a weak motor, wheel by wheel, and its threshold."""
    run = run_scenario(read_scenario("degraded_motor"), "twin", "robust")
    spans = wording.fault_spans(run.metrics, float(run.trace["time"][-1]))
    told = {family.name: family for family in families(run.trace.columns, "robust")}
    return plots_diagnosis.residuals(run.trace, told["motor"], spans)


def recovered_path() -> Figure:
    """`two_motors_lost` from above: as planned, without help, with recovery."""
    scenario = read_scenario("two_motors_lost")
    traces = {method: run_scenario(scenario, "twin", method).trace for method in ("robust", "off")}
    return plots_compared.paths(traces, scenario.patches)


def gap_before_and_after() -> Figure:
    """The rig moved sideways, and a model without friction in its rollers: the worst held-out run."""
    with tempfile.TemporaryDirectory() as folder:
        data, model = Path(folder) / "lateral", Path(folder) / "rig.toml"
        record_suite(find_suite("rig_lateral"), Order(data, _LATERAL_SEED))
        text = (models_folder() / "quarter_rig" / "rig.toml").read_text(encoding="utf-8")
        model.write_text(text + _NO_ROLLER_FRICTION, encoding="utf-8")
        finding = find_gap(data, model)
    run = worst_run(finding)
    assert run is not None  # some are held out
    return gap_plots_runs.overlay(finding, runs_of(finding)[run])


CLAIMS: Mapping[str, Callable[[], Figure]] = MappingProxyType(
    {
        "claim_twin": twin_beside_equations,
        "claim_diagnosis": motors_on_trial,
        "claim_recovery": recovered_path,
        "claim_gap": gap_before_and_after,
    }
)
"""By the name of the picture's file."""


def make(folder: Path, names: tuple[str, ...] = tuple(CLAIMS)) -> None:
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
    make(arguments.folder, tuple(arguments.names) or tuple(CLAIMS))
