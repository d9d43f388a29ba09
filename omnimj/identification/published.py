"""RMS speed errors that the dissertation prints: Tables 4.2, 4.3 and 4.4 [m/s]."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

TABLE_4_2_CURRENTS = (0.45, 0.60, 0.75, 0.90, 1.05, 1.20, 1.35, 1.50)
"""[A]"""
TABLE_4_2: Mapping[tuple[float, str], tuple[float, ...]] = MappingProxyType(
    {
        (3.9593, "natural_stone"): (0.024, 0.016, 0.007, 0.010, 0.012, 0.016, 0.020, 0.012),
        (3.9593, "pvc"): (0.037, 0.035, 0.014, 0.008, 0.019, 0.009, 0.017, 0.024),
        (3.9593, "paperboard"): (0.035, 0.006, 0.010, 0.021, 0.017, 0.011, 0.021, 0.013),
        (2.9593, "natural_stone"): (0.022, 0.015, 0.013, 0.008, 0.022, 0.016, 0.025, 0.029),
        (2.9593, "pvc"): (0.036, 0.013, 0.011, 0.010, 0.011, 0.010, 0.014, 0.015),
        (2.9593, "paperboard"): (0.031, 0.012, 0.011, 0.008, 0.015, 0.014, 0.012, 0.025),
        (1.9593, "natural_stone"): (0.035, 0.015, 0.029, 0.018, 0.028, 0.038, 0.037, 0.025),
        (1.9593, "pvc"): (0.019, 0.016, 0.016, 0.018, 0.026, 0.033, 0.031, 0.029),
        (1.9593, "paperboard"): (0.022, 0.022, 0.019, 0.022, 0.025, 0.025, 0.032, 0.015),
    }
)
"""Mass [kg] and floor → error per current."""

TABLE_4_3_CURRENTS = (0.6, 0.9, 1.2, 1.5)
"""[A]"""
TABLE_4_3_FLOOR, TABLE_4_3_MASS = "natural_stone", 3.9593
TABLE_4_3: Mapping[float, tuple[float, ...]] = MappingProxyType(
    {
        0.20: (0.045, 0.029, 0.033, 0.024),
        0.35: (0.068, 0.054, 0.040, 0.027),
        0.50: (0.075, 0.038, 0.033, 0.029),
        0.65: (0.072, 0.040, 0.028, 0.033),
        -0.20: (0.023, 0.055, 0.051, 0.078),
        -0.35: (0.047, 0.066, 0.079, 0.102),
        -0.50: (0.034, 0.064, 0.067, 0.093),
        -0.65: (0.057, 0.082, 0.088, 0.103),
    }
)
"""Lateral speed [m/s] → error per current, without lateral friction in the model."""
TABLE_4_4: Mapping[float, tuple[float, ...]] = MappingProxyType(
    {
        0.20: (0.021, 0.005, 0.008, 0.009),
        0.35: (0.029, 0.013, 0.011, 0.024),
        0.50: (0.029, 0.014, 0.022, 0.032),
        0.65: (0.024, 0.019, 0.029, 0.028),
        -0.20: (0.018, 0.018, 0.015, 0.041),
        -0.35: (0.016, 0.008, 0.020, 0.044),
        -0.50: (0.059, 0.023, 0.019, 0.018),
        -0.65: (0.047, 0.018, 0.014, 0.024),
    }
)
"""The same with lateral friction in the model."""

_MASS, _CURRENT, _LATERAL = 0.02, 0.03, 0.03  # [kg, A, m/s] by which a measured condition may be off


def published_errors(floor: str, mass: float, lateral_speed: float, current: float) -> tuple[float, ...]:
    """What is printed for a condition [m/s].

    Returns:
      The one number of Table 4.2; with the gantry moving those of Tables 4.3 and 4.4, without and with
      lateral friction; nothing where there is no such cell.
    """
    if lateral_speed == 0.0:
        column = _nearest(TABLE_4_2_CURRENTS, current, _CURRENT)
        masses = sorted({m for m, _ in TABLE_4_2})
        row = _nearest(masses, mass, _MASS)
        if column is None or row is None or (masses[row], floor) not in TABLE_4_2:
            return ()
        return (TABLE_4_2[masses[row], floor][column],)
    speeds = tuple(TABLE_4_3)
    column, row = (
        _nearest(TABLE_4_3_CURRENTS, current, _CURRENT),
        _nearest(speeds, lateral_speed, _LATERAL),
    )
    if floor != TABLE_4_3_FLOOR or abs(mass - TABLE_4_3_MASS) > _MASS or column is None or row is None:
        return ()
    return TABLE_4_3[speeds[row]][column], TABLE_4_4[speeds[row]][column]


def _nearest(values, wanted: float, most: float) -> int | None:
    k = min(range(len(values)), key=lambda i: abs(values[i] - wanted))
    return k if abs(values[k] - wanted) <= most else None
