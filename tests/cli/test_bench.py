"""`omnimj bench` reports what its schema asks for."""

import json
from pathlib import Path

import jsonschema
import pytest

from omnimj.cli import bench
from omnimj.cli.main import main

SCHEMA = json.loads((Path(__file__).parent.parent / "schema" / "bench.json").read_text())


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(bench, "_STEPS", 100)
    monkeypatch.setattr(bench, "_ROUNDS", 1)
    monkeypatch.setattr(bench, "_SAMPLES", 200)
    monkeypatch.setattr(bench, "_RUN_SECONDS", 1.0)


def test_json_keeps_to_the_schema_and_every_figure_is_positive(short, capsys):
    assert main(["bench", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    jsonschema.validate(found, SCHEMA)
    assert all(value > 0.0 for value in found.values())


def test_the_table_explains_every_figure(short, capsys):
    assert main(["bench"]) == 0
    told = capsys.readouterr().out
    for name in SCHEMA["required"]:
        assert name in told
