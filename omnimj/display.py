"""Records that show themselves in a notebook, without knowing how.

Tables and plots are made by `omnimj.view.notebook`, which imports the records and therefore lies above them.
It is loaded by its name when a record is shown for the first time, as the public names of `omnimj` are: a
program that only computes loads no drawing library, and control runs where there is none.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_NOTEBOOK = "omnimj.view.notebook"


class Displayed:
    """Record with a table for notebooks and with plots."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """Compact table of the record, which a notebook shows in the place of `repr`."""
        return import_module(_NOTEBOOK).html(self)

    @property
    def plots(self) -> tuple[str, ...]:
        """Names of the record's plots."""
        return import_module(_NOTEBOOK).plot_names(self)

    def plot(self, *names: str) -> Any:
        """Draw the record with Bokeh; `bokeh.io.show` shows what is returned.

        Args:
          *names: Plots below each other, of `plots`; the first of them when none is given.

        Returns:
          A layout of Bokeh figures over a common time axis where they have one.

        Raises:
          UnknownNameError: No such plot; the message lists the names.
        """
        return import_module(_NOTEBOOK).layout(self, names)
