"""Transports of the link: they carry packets, never wait for an answer, and never raise once open.

- `interface`: transport (one far end) and listener (any sender).
- `address`: `serial:DEVICE?baud=N` and `udp:HOST:PORT`.
- `serial_port`, `udp`: the real ones.
"""
