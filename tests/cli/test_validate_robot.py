"""`omnimj validate` on a robot's measured drives: table, files and recording; one line per error."""

from __future__ import annotations

import json

import pytest
from measured_logs import unpack
from rerun.chunk import RrdReader

from omnimj.cli.main import main
from omnimj.resources import models_folder

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Four runs on a table and one on a soft floor."""
    path = tmp_path_factory.mktemp("logs")
    logs = unpack("robotino", path)
    table, gray = (sorted((logs / kind).glob("*.csv")) for kind in ("table", "gray"))
    files = [str(file) for file in (*table[-4:], *gray)]
    mapping = str(logs / "robotino.mapping.toml")
    assert main(["import", *files, "--mapping", mapping, "--out", str(path / "set")]) == 0
    return path / "set"


@pytest.fixture(scope="module")
def model():
    files = models_folder() / "robotino"
    return ["--model", str(files / "identified.toml"), "--floors", str(files / "soft_floors.toml")]


@pytest.mark.slow
def test_real_runs_stand_beside_their_twin_by_floor_and_speed(folder, model, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["validate", str(folder), *model, "--plant", "twin", "--recording", "exp122"]
    assert main([*arguments, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "of the mean body velocity" in printed
    assert "gray: fewer than 4 runs" in printed and "table: marker turned" in printed
    content = json.loads((out / "validation.json").read_text(encoding="utf-8"))
    by_key = {(group["floor"], group["plant"]): group for group in content["table"]}
    assert by_key["table", "twin"]["velocity_error"] < 0.03
    assert by_key["gray", "twin"]["velocity_error"] < 0.1 < by_key["gray", "rolling"]["velocity_error"]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "gray, median: paths" in page and "http://" not in page and "https://" not in page
    entities = {chunk.entity_path for chunk in RrdReader(out / "recording.rrd").stream().to_chunks()}
    assert {
        "/world/measured/chassis",
        "/world/twin/chassis",
        "/plots/heading",
        "/plots/current_3",
    } <= entities


def test_bad_input_is_one_line(refused, folder, model):
    unknown = refused("validate", str(folder), *model, "--recording", "exp99", "--out", "out")
    assert "--recording: unknown run 'exp99'" in unknown and "exp122" in unknown
    assert "has 4 [[wheels]]" in refused("validate", str(folder), *model[2:], "--out", "out")
    assert "unknown floor 'table'" in refused("validate", str(folder), *model[:2], "--out", "out")
