"""Encoding and decoding of the messages of the link, independent of clock and wire.

- `messages`: one frozen record per message, and the enumerations they use.
- `layout`: the table of all fields on the wire, from which the codec, the schema and the tables of
  `PROTOCOL.md` are generated, and the reasons for which a packet is dropped.
- `frames`: `encode` and `decode` of a whole frame with header, authentication tag and checksum.
- `stream`: packets in the byte stream of a serial line (COBS).
- `key`: the secret key of a link and its file.
"""
