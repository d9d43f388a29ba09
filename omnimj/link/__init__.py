"""Link between the controller's computer (host) and a robot's amplifiers (device).

`PROTOCOL.md` describes the protocol, `firmware/` holds it as a C header with an example of a firmware.

- `codec`: messages as bytes: layout, frames, byte stuffing, key.
- `transport`: addresses, serial port, UDP, and a simulated wire with disturbances.
- `device`: the device's rules as a state machine, its limits, an emulated device and its server.
- `host`: the host's rules as a state machine, the link on a transport, the robot behind it as a plant, log of
  all frames, and its reading as a dataset.
- `check`: what `omnimj link` checks: communication, wiring, and the codec under fuzzing.
- `calibration`: raw readings to SI units and commands to the device's currents, for both sides.
- `quality`: clock offset, lost frames and deadlines of a link.

Imports go check > host > calibration > device.config > device.limits > codec; transports know packets only.
"""
