"""`omnimj bench` reports what its schema asks for."""

import json
import math
from pathlib import Path

import jsonschema
import pytest

from omnimj.cli import bench
from omnimj.cli.main import main

SCHEMA = json.loads((Path(__file__).parent.parent / "schema" / "bench.json").read_text())


@pytest.fixture
def short(monkeypatch):
    effort = bench.Effort(
        steps=100, rounds=1, run=1.0, missions=1, mission=3.0, hours=1e-3, frames=50, trips=300
    )
    monkeypatch.setattr(bench, "EFFORT", effort)


def test_json_keeps_to_the_schema_and_every_figure_is_positive(short, capsys):
    assert main(["bench", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    jsonschema.validate(found, SCHEMA)
    grown = [found.pop(name) for name in tuple(found) if name.endswith("kb_per_hour")]
    assert found["udp_round_trip_ratio"] > 1.0 and "codec_decode_us" in found
    assert all(value > 0.0 for value in found.values()) and grown and all(map(math.isfinite, grown))


def test_the_table_explains_every_figure(short, capsys):
    assert main(["bench"]) == 0
    told = capsys.readouterr().out
    for name in (*SCHEMA["required"], "control_growth_kb_per_hour"):
        assert name in told
