"""Tables 5.1 and 5.2: from residuals that are above their thresholds to a fault."""

from __future__ import annotations

from collections.abc import Sequence

SLIP, MOTOR = "slip", "motor"


def rig_fault(speed_is_over: bool, force_is_over: bool) -> str | None:
    """Table 5.1: (R1, R2) = (1, 0) slip, (1, 1) motor; a pattern without a row names nothing."""
    if not speed_is_over:
        return None
    return MOTOR if force_is_over else SLIP


def robot_fault(own_axis_is_over: bool, other_axis_is_over: bool, printed: bool) -> str | None:
    """Table 5.2 for the wheel whose r3 … r6 crossed first: its rows f1 … f4 and f5 … f8.

    Args:
      own_axis_is_over: R8 for a wheel that drives along y, R7 for one along x.
      other_axis_is_over: The other one.
      printed: A motor fault shows on its own axis only, as the table has it. Repaired: whatever the other
        axis says, since a motor's fault turns the robot and shows on both.

    Returns:
      `slip`, `motor`, or None for a pattern without a row.
    """
    if own_axis_is_over:
        return None if printed and other_axis_is_over else MOTOR
    return None if other_axis_is_over else SLIP


def over(residuals: Sequence[float], threshold: float, printed: bool) -> list[bool]:
    """Which of r3 … r6 are above threshold 3: |r|, or r as printed (erratum 5)."""
    if printed:
        return [r > threshold for r in residuals]
    return [abs(r) > threshold for r in residuals]


def first_to_cross(first: int, is_over: Sequence[bool], residuals: Sequence[float]) -> int:
    """The wheel that an event belongs to: the first of r3 … r6 above the threshold, of several the largest.

    Args:
      first: Of the event so far; −1 when there is none.
      is_over: From `over`.
      residuals: r3 … r6.

    Returns:
      0 … n−1; −1 once all are below again, which ends the event.
    """
    if not any(is_over):
        return -1
    if first >= 0:
        return first
    return max((i for i, above in enumerate(is_over) if above), key=lambda i: abs(residuals[i]))
