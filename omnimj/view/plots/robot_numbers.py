"""Plot of an identified robot: its numbers relative to those of the model file, with their intervals."""

from __future__ import annotations

from omnimj.estimate.robot.records import RobotIdentification
from omnimj.view import palette
from omnimj.view.plots.mismatch import row_panel
from omnimj.view.plots.panels import Drawing

_SOURCES = {"data": (palette.MEASURED, "circle"), "data and prior": (palette.ACCENT, "diamond")}
_PRIOR = (palette.MUTED, "square")


def identified_numbers(found: RobotIdentification) -> Drawing:
    """Plot each number over that of the model file, with its 90 % interval, unless the latter is 0."""
    shown = [one for one in found.estimates if one.nominal]
    panel = row_panel([one.words for one in shown], "identified / model file")
    for source in ("data", "data and prior", "prior"):
        rows = [row for row, one in enumerate(shown) if one.source == source]
        if not rows:
            continue
        color, marker = _SOURCES.get(source, _PRIOR)
        ends = [
            sorted((shown[row].low / shown[row].nominal, shown[row].high / shown[row].nominal))
            for row in rows
        ]
        panel.bars(
            [low for low, _ in ends], [high for _, high in ends], rows, 0.3, palette.lighter(color, 0.6)
        )
        names = [f"{shown[row].value:.4g} {shown[row].unit}" for row in rows]
        values = [shown[row].value / shown[row].nominal for row in rows]
        panel.points(values, rows, color, f"by {source}", marker, 8, names=names)
    panel.rule(1.0, across=False)
    panel.legend()
    return panel.finish()
