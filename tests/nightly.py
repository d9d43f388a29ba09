"""Grids of parameters of which every second point is left to nightly runs."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

import pytest


def checkerboard(*axes: Iterable[Any]) -> list[Any]:
    """All combinations of the axes' values; those where the places of the values have an odd sum are slow.

    Each value of each axis still occurs in the fast suite, with every second value of each other axis.
    """
    points = []
    for numbered in itertools.product(*(list(enumerate(axis)) for axis in axes)):
        odd = sum(place for place, _ in numbered) % 2
        points.append(pytest.param(*(value for _, value in numbered), marks=[pytest.mark.slow] * odd))
    return points
