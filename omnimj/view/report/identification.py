"""`report.html` of an identification: parameters, curve, residuals, and what the runs cannot tell."""

from __future__ import annotations

import math
from pathlib import Path

import omnimj
from omnimj.estimate.identification.records import Estimate, Identification, IdentifiedFloor
from omnimj.view.plots import identification as identification_plots
from omnimj.view.plots.drawing import svg
from omnimj.view.report import page
from omnimj.view.wording import number

_MEANING = {
    "mu_c": "friction at high slip, μ_c",
    "mu_s": "friction at the onset of slip, μ_s",
    "V_s": "slip over which friction falls, V_s",
    "sigma_0": "stiffness of the bristle, σ0",
    "sigma_1": "damping of the bristle, σ1",
    "sigma_2": "viscous part, σ2",
}


def write_identification_report(path: Path, found: Identification, command: str = "") -> None:
    """Writes the report as one HTML file that needs nothing else.

    Args:
      path: The file to write.
      found: All floors.
      command: The command line that makes it again.
    """
    content = [_head(found), _table(found), *(_floor(floor) for floor in found.floors)]
    content += [page.section("How it was done", _method(found)), _foot(found, command)]
    heading = f"Floors of {found.dataset.name} · omnimj"
    path.write_text(page.document(heading, "\n".join(content)), encoding="utf-8")


def _head(found: Identification) -> str:
    runs = sum(len(floor.runs) for floor in found.floors)
    names = ", ".join(floor.floor.replace("_", " ") for floor in found.floors)
    stopped = "<p class='verdict bad'>Stopped before the last floor</p>" if found.interrupted else ""
    return (
        f"<h1>Floor friction identified from {page.text(found.dataset.name)}</h1>"
        f"<p class='lead'>LuGre parameters of {page.text(names)} out of {runs} runs of the test rig.</p>"
        f"{stopped}"
    )


def _table(found: Identification) -> str:
    rows = []
    for name, meaning in _MEANING.items():
        row = [f"<th scope='row'>{page.text(meaning)}</th>"]
        row += [_value(floor[name]) for floor in found.floors]
        rows.append(row)
    covered = ["<th scope='row'>slip covered by settled sliding</th>"]
    covered += [page.cell(_covered(floor)) for floor in found.floors]
    rows.append(covered)
    head = ("", *(floor.floor.replace("_", " ") for floor in found.floors))
    note = (
        "<p>Values with 90 % intervals. Where an end is open the runs do not bound it; the curve "
        "below holds all the same.</p>"
    )
    return page.section("Parameters", page.table(rows, head) + note)


def _value(estimate: Estimate) -> str:
    unit = "" if estimate.unit == "1" else f" {estimate.unit}"
    if estimate.low is None and estimate.high is None:
        said = "not determined"
    elif estimate.low is None:
        said = f"at most {number(estimate.high, 3)}, open below"
    elif estimate.high is None:
        said = f"at least {number(estimate.low, 3)}, open above"
    else:
        said = f"{number(estimate.low, 3)} … {number(estimate.high, 3)}"
    kind = "" if estimate.is_determined else " class='plain'"
    value = f"<b>{number(estimate.value)}{page.text(unit)}</b>"
    return f"<td class='number'>{value}<br><span{kind}>{said}</span></td>"


def _covered(floor: IdentifiedFloor) -> str:
    low, high = floor.curve.covered
    return f"{1000 * low:.3g} … {1000 * high:.3g} mm/s" if math.isfinite(low) else "none"


def _floor(floor: IdentifiedFloor) -> str:
    name = floor.floor
    said = "".join(f"<li>{page.text(words)}</li>" for words in floor.undetermined)
    words = (
        f"<p><b>What these runs cannot tell</b></p><ul>{said}</ul>"
        if said
        else "<p>These runs determine all six parameters.</p>"
    )
    facts = page.table(
        [
            (
                "runs",
                page.cell(f"{len(floor.runs)}, masses {', '.join(f'{mass:g}' for mass in floor.masses)} kg"),
            ),
            ("no slip shows in", page.cell(", ".join(floor.left_out) or "none")),
            ("speed not explained", page.cell(f"{1000 * floor.rms['carriage_speed']:.2g} mm/s RMS")),
            (
                "acceleration not explained",
                page.cell(f"{floor.rms['carriage_acceleration']:.2g} m/s² RMS"),
            ),
            ("rolling radius", page.cell(f"{100 * (floor.radius_scale - 1):+.3f} % of nominal, fitted")),
            (
                "samples",
                page.cell(
                    f"{floor.samples} block means, worth {floor.effective_samples:.0f} independent ones"
                ),
            ),
        ]
    )
    return page.section(
        name.replace("_", " ").capitalize(),
        f"<div class='columns'><div>{words}</div><div>{facts}</div></div>"
        f"<div class='columns plots'>{_figures(floor)}</div>",
    )


def _figures(floor: IdentifiedFloor) -> str:
    wanted = (
        (
            "curve",
            "Traction over slip",
            "A point per 10 ms; measured: Eq. (4.26) and the two encoders. Points lie off the steady curve "
            "while the bristle is stretched or let go; the fitted model goes with them.",
            identification_plots.curve,
        ),
        (
            "level",
            "Friction level g over slip",
            "F/F_N without its viscous part, with its 90 % band: where the band widens, the runs say less.",
            identification_plots.level,
        ),
        (
            "speeds",
            "Speed, measured less fitted",
            "A line per run, 10 ms means; what is left should be noise.",
            identification_plots.speed_residuals,
        ),
        (
            "accelerations",
            "Acceleration, measured less fitted",
            "A line per run, without its accelerometer's offset.",
            identification_plots.acceleration_residuals,
        ),
    )
    return "".join(
        page.figure(svg(draw(floor), f"{floor.floor}-{key}", page.text(heading)), heading, caption)
        for key, heading, caption, draw in wanted
    )


def _method(found: Identification) -> str:
    notes = "".join(f"<li>{page.text(note)}</li>" for note in found.notes)
    return (
        "<p>Every run's measured wheel speed pulls a simulated carriage over the floor (LuGre, "
        "Eqs. 4.32-4.35); the six parameters are those whose carriage speeds and accelerations come nearest "
        "to the measured ones, over all runs of a floor together. The small difference of two noisy speeds "
        "is thereby never a regressor, and neither motor nor gear matters. The rolling radius and each run's "
        "accelerometer offset are fitted beside them. Where slip is less than twice its own ripple nothing "
        "is fitted: the bristle relaxes with |V_r|, and ripple does not average out of that.</p>"
        "<p>Intervals: jackknife over whole conditions, hence for noise of any colour, plus what is taken as "
        "known (mass and rail friction within the uncertainties the model states, 0.5 ms between the two "
        "speeds). Friction levels and wide intervals: profile of the fit.</p>"
        + (f"<p>About the data:</p><ul>{notes}</ul>" if notes else "")
    )


def _foot(found: Identification, command: str) -> str:
    again = f"<p>To make it again:</p>{page.command(command)}" if command else ""
    return (
        f"<footer>{again}<p>Model {page.text(found.model)}. Beside this page: <code>floors.toml</code> "
        "(the floors for the twin), <code>identification.json</code> (the numbers above and the curves). "
        f"Written by omnimj {page.text(omnimj.__version__)}.</p></footer>"
    )
