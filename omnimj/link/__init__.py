"""Link between the controller's computer (host) and a robot's amplifiers (device).

`PROTOCOL.md` describes the protocol; `firmware/` contains it as a C header, with an example firmware.

- `codec`: encoding of messages: layout, frames, byte stuffing, key.
- `transport`: addresses, serial port, and UDP.
- `device`: the rules of the device as a state machine, its limits, an emulated device and its server.
- `host`: the rules of the host as a state machine, the link on a transport, the robot behind it as a plant, a
  log of all frames, and its conversion to a dataset.
- `check`: the checks of `omnimj link`: communication, wiring, and the codec under fuzzing.
- `calibration`: raw readings to SI units and commands to the device's currents, for both sides.
- `quality`: clock offset, lost frames and deadlines of a link.

Imports go check > host > calibration > device.config > device.limits > codec; transports handle packets only.
"""
