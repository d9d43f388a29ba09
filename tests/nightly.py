"""Grids of parameters of which most points are left to nightly runs."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

import pytest

from omnimj.simulate.scenario.scenario import read_scenario


def representative(*values: Any, keep: int = 1) -> list[Any]:
    """Values of a parameter, tuples for several ones, of which all but the first `keep` are slow."""
    rest = (value if isinstance(value, tuple) else (value,) for value in values[keep:])
    return [*values[:keep], *(pytest.param(*value, marks=pytest.mark.slow) for value in rest)]


def latin(*axes: Iterable[Any]) -> list[Any]:
    """All combinations of the axes' values; those off the diagonal are slow.

    The fast suite takes the first values together, then the second, up to the end of the shortest axis.
    """
    points = []
    for numbered in itertools.product(*(list(enumerate(axis)) for axis in axes)):
        places = {place for place, _ in numbered}
        points.append(pytest.param(*(v for _, v in numbered), marks=[pytest.mark.slow] * (len(places) > 1)))
    return points


def in_turn(*axes: Iterable[Any]) -> list[Any]:
    """All combinations of the axes' values, of which the fast suite takes each value in turn.

    It takes the first values together, then the second, and so on, where shorter axes begin again, until
    every value of the longest axis has occurred once.
    """
    values = [list(axis) for axis in axes]
    turns = range(max(map(len, values)))
    chosen = {tuple(k % len(axis) for axis in values) for k in turns}
    return [
        pytest.param(
            *(axis[place] for axis, place in zip(values, places, strict=True)),
            marks=[pytest.mark.slow] * (places not in chosen),
        )
        for places in itertools.product(*(range(len(axis)) for axis in values))
    ]


def three_wheels_nightly(names: Iterable[str]) -> list[Any]:
    """Names of scenarios; those of robots with three wheels are slow, as their kernels compile apart."""
    return [
        pytest.param(name, marks=[pytest.mark.slow] * (read_scenario(name).constants.wheel_count == 3))
        for name in names
    ]


def checkerboard(*axes: Iterable[Any]) -> list[Any]:
    """All combinations of the axes' values; those where the places of the values have an odd sum are slow.

    Each value of each axis still occurs in the fast suite, with every second value of each other axis.
    """
    points = []
    for numbered in itertools.product(*(list(enumerate(axis)) for axis in axes)):
        odd = sum(place for place, _ in numbered) % 2
        points.append(pytest.param(*(value for _, value in numbered), marks=[pytest.mark.slow] * odd))
    return points
