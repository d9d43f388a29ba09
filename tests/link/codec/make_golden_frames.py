"""Writes `golden_frames.json` anew: only where the protocol has been changed on purpose.

Run as `PYTHONPATH=tests/link python tests/link/codec/make_golden_frames.py`, then look at what differs.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from sample_frames import GOLDEN, KEY, SECRET, describe

from omnimj.link.codec.frames import encode
from omnimj.link.codec.layout import SCHEMA, SCHEMA_TEXT
from omnimj.link.codec.stream import stuff

PATH = Path(__file__).with_name("golden_frames.json")


def golden() -> dict:
    """Every golden frame with and without a key, as bytes, stuffed, and as text."""
    rows = []
    for name, frame in GOLDEN.items():
        for key in (None, KEY):
            packet = encode(frame, key)
            rows.append(
                {
                    "name": name,
                    "keyed": key is not None,
                    "packet": packet.hex(),
                    "stuffed": stuff(packet).hex(),
                    "told": describe(replace(frame, authentic=key is not None)),
                }
            )
    return {
        "key": SECRET.hex(),
        "schema": f"{SCHEMA:08x}",
        "schema_text": SCHEMA_TEXT.splitlines(),
        "frames": rows,
    }


if __name__ == "__main__":
    PATH.write_text(json.dumps(golden(), indent=1) + "\n", encoding="utf-8")
