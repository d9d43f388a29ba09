"""Driving by hand.

- `devices`: terminal and gamepad as sources of bytes.
- `steering`: keys and sticks become targets; `operator`: reads the devices once per control step.
- `driving`: the loop without a planned end, held to the wall clock.
"""
