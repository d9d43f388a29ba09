"""Reports whose plots are made and not embedded, for tests of everything else on a page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def without_embedding() -> Iterator[None]:
    """Plots of reports get their places and static pictures, but neither scripts nor the plotting library."""
    nothing = {"embed": lambda drawings: ("", dict.fromkeys(drawings, "")), "library": lambda: ""}
    with pytest.MonkeyPatch.context() as patched:
        for name, stub in nothing.items():
            patched.setattr(f"omnimj.view.report.page.{name}", stub)
        yield
