"""Checks of a robot behind a link before it drives, and of the codec.

- `communication`: telemetry rates, watchdog, and stop.
- `motions`: small motions of one motor after the other, and turns on the spot.
- `wiring`: sign, gain and connection of every channel and motor, from these motions.
- `fuzz`: corrupted frames and noise; every accepted frame must be one that was sent.
"""
