"""Driving by hand.

- `devices`: terminal and gamepad as sources of bytes, and the operator, who reads them once per control step.
- `steering`: keys and sticks become targets.
- `driving`: the loop without a planned end, held to the wall clock.
"""
