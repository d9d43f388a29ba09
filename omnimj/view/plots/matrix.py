"""Matrix of shaded cells with numbers: the layout of several plots of studies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from bokeh.palettes import Blues256

from omnimj.view import palette
from omnimj.view.plots.panels import Array, Panel

ROW = 22
"""Height of a row [pixels]."""
_AROUND, _LETTER = 40, 6.2  # [pixels] height of the frame, and of a letter in the name of a column
SHADES = Blues256[::-1]
"""Colours from the smallest to the largest share."""


def matrix_panel(
    shares: Array, rows: Sequence[str], columns: Sequence[str], words: Sequence[str], names: Sequence[str]
) -> Panel:
    """Draw a matrix of shades 0 … 1, shape (rows, columns), from the top down; the caller finishes the panel.

    The text in each cell (`words`) and that below the cursor (`names`) go row by row.
    """
    panel = Panel(_AROUND + round(ROW * len(rows) + _LETTER * max(map(len, columns))), over_time=False)
    x, y = np.arange(-0.5, len(columns)), np.arange(-0.5, len(rows))
    colors = [SHADES[round(255 * share)] for share in shares.ravel()]
    panel.cells(x, y, colors, names)
    for k, word in enumerate(words):
        if word:
            row, column = divmod(k, len(columns))
            panel.text(column, row, word, palette.ink_on(colors[k]), text_align="center")
    panel.rows(rows)
    panel.ticks(range(len(columns)), columns, across=True)
    panel.x_limits(x[0], x[-1])
    panel.x_axis.major_label_orientation = "vertical"
    panel.hide_grid(across=True)
    return panel
