"""`report.html` of an identification: LuGre parameters, friction curves, residuals."""

from __future__ import annotations

import math
from pathlib import Path

from omnimj.estimate.identification.records import Estimate, Identification, IdentifiedFloor
from omnimj.view.plots import identification as plots
from omnimj.view.report.page import Cell, Figure, Table, table, write_page
from omnimj.view.wording import number

_PARAMETERS = {
    "mu_c": "friction at high slip, μ_c",
    "mu_s": "friction at the onset of slip, μ_s",
    "V_s": "slip velocity over which friction falls, V_s",
    "sigma_0": "bristle stiffness, σ0",
    "sigma_1": "bristle damping, σ1",
    "sigma_2": "viscous coefficient, σ2",
}
_FIGURES = (
    (
        "curve",
        "Traction over slip",
        "A point per 10 ms; measured: Eq. (4.26) and the two encoders. Points deviate from the steady curve "
        "while the bristle is stretched or released; the fitted model follows them.",
        plots.curve,
    ),
    (
        "level",
        "Friction level g over slip",
        "F/F_N without its viscous part, with its 90 % band; where the band is wide, the runs say little.",
        plots.level,
    ),
    (
        "speeds",
        "Speed, measured less fitted",
        "A line per run, 10 ms means; the remainder should be noise.",
        plots.speed_residuals,
    ),
    (
        "accelerations",
        "Acceleration, measured less fitted",
        "A line per run, without its accelerometer's offset.",
        plots.acceleration_residuals,
    ),
)


def write_identification_report(path: Path, found: Identification, command: str = "") -> None:
    """Write the report of an identification."""
    write_page(
        path,
        "identification",
        f"Floors of {found.dataset.name} · omnimj",
        found=found,
        floors=", ".join(_name(floor) for floor in found.floors),
        runs=sum(len(floor.runs) for floor in found.floors),
        parameters=parameters_table(found),
        sections=[
            (_name(floor).capitalize(), floor.undetermined, _facts(floor), floor_figures(floor))
            for floor in found.floors
        ],
        command=command,
    )


def _name(floor: IdentifiedFloor) -> str:
    return floor.floor.replace("_", " ")


def parameters_table(found: Identification) -> Table:
    """List the parameters with their intervals, a column per floor."""
    rows: list[tuple[object, ...]] = [
        (meaning, *(_estimate(floor[name]) for floor in found.floors))
        for name, meaning in _PARAMETERS.items()
    ]
    rows.append(("slip range of steady sliding", *(_slip_range(floor) for floor in found.floors)))
    return table(rows, ("", *map(_name, found.floors)), row_headings=True)


def _estimate(estimate: Estimate) -> Cell:
    """Return a value with its 90 % interval."""
    low, high = number(estimate.low, 3), number(estimate.high, 3)
    if estimate.low is None and estimate.high is None:
        interval = "not determined"
    elif estimate.low is None:
        interval = f"at most {high}, open below"
    elif estimate.high is None:
        interval = f"at least {low}, open above"
    else:
        interval = f"{low} … {high}"
    value = number(estimate.value) + ("" if estimate.unit == "1" else f" {estimate.unit}")
    return Cell(interval, "number" if estimate.is_determined else "number plain", title=value)


def _slip_range(floor: IdentifiedFloor) -> str:
    low, high = floor.curve.covered
    return f"{1000 * low:.3g} … {1000 * high:.3g} mm/s" if math.isfinite(low) else "none"


def _facts(floor: IdentifiedFloor) -> Table:
    masses = ", ".join(f"{mass:g}" for mass in floor.masses)
    samples = f"{floor.samples} block means, equivalent to {floor.effective_samples:.0f} independent ones"
    return table(
        [
            ("runs", f"{len(floor.runs)}, masses {masses} kg"),
            ("without visible slip", ", ".join(floor.left_out) or "none"),
            ("unexplained speed", f"{1000 * floor.rms['carriage_speed']:.2g} mm/s RMS"),
            ("unexplained acceleration", f"{floor.rms['carriage_acceleration']:.2g} m/s² RMS"),
            (
                "rolling radius",
                f"{100 * (floor.radius_scale - 1):+.3f} % from nominal, fitted".replace("-", "−"),
            ),
            ("samples", samples),
        ]
    )


def floor_figures(floor: IdentifiedFloor) -> list[Figure]:
    """Plot the curves and the residuals of a floor."""
    return [
        Figure(draw(floor), f"{floor.floor}-{key}", heading, caption)
        for key, heading, caption, draw in _FIGURES
    ]
