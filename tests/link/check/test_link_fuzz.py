"""A short run of the fuzz; `omnimj link fuzz` runs it for as long as one likes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from omnimj.link.check import fuzz as fuzzing
from omnimj.link.check.fuzz import fuzz
from omnimj.link.codec.layout import DropReason


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_what_is_accepted_is_what_was_sent_and_all_that_was_whole_is_accepted(seed, measured):
    report = fuzz(frames=12_000, noise=3_000_000, seed=seed)
    assert report.wrong == 0
    assert report.accepted == report.whole > 12_000
    assert report.passed and report.frames == 12_000 and report.noise >= 3_000_000
    measured("fuzz: memory growth [kB]", report.peak_growth, 8192.0)
    assert report.peak_growth < 8192.0
    met = {drop for drop in DropReason if report.drops[drop]}
    # frames of another schema, protocol or with bad values need a checksum that is right: noise has none
    assert met >= {
        DropReason.TOO_SHORT,
        DropReason.TOO_LONG,
        DropReason.STUFFING,
        DropReason.CHECKSUM,
        DropReason.TAG,
    }


@pytest.mark.parametrize(
    "broken", ["drops the last bit", "believes any checksum", "takes the key from anybody"]
)
def test_a_broken_decoder_is_detected(monkeypatch, broken):
    right = fuzzing.decode

    def wrong(packet, key=None):
        if broken == "believes any checksum":
            import zlib

            packet = packet[:-4] + zlib.crc32(packet[:-4]).to_bytes(4, "little")
        found = right(packet, None if broken == "takes the key from anybody" else key)
        if broken == "drops the last bit" and not isinstance(found, DropReason):
            found = replace(found, session=found.session & ~1)
        return found

    monkeypatch.setattr(fuzzing, "decode", wrong)
    assert not fuzz(frames=3000, noise=0, seed=1).passed
