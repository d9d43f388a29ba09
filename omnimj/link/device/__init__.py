"""Device side of the link: the rules of a firmware, and an emulated device for tests and simulation.

- `limits`: limits on commands and arming as pure functions, to be ported to C.
- `config`: configuration of a device, its identifying hashes, and its comparison with the expected one.
- `state_machine`: sessions, arming, commands, faults and telemetry, without clock and wire.
- `emulated`: a simulated plant behind these rules, with optional defects of the wiring.
- `server`: an emulated device on a wire.
- `analog`: an analog data-acquisition box behind the same rules.
"""
