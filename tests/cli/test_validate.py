"""`omnimj validate` on the command line: the table, files, exit codes, one line per error."""

from __future__ import annotations

import json

import pytest
from rig_runs import twin_run

from omnimj.cli.main import main
from omnimj.parameters import read_floors, read_rig
from omnimj.recording.write_dataset import DatasetWriter
from omnimj.resources import models_folder

pytestmark = pytest.mark.usefixtures("undrawn")

EFFECT = """
[effects.rail_viscous]
coefficient = { value = 3.0, unit = "N.s/m", source = "identified" }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two straight runs and one sideways."""
    rig, floors = read_rig(), read_floors()
    path = tmp_path_factory.mktemp("data") / "runs"
    writer = DatasetWriter(path, "quarter_rig", {"mass": rig.rig.masses[0]})
    writer.add(twin_run(rig, floors["natural_stone"], 0.6, 1, name="stone_060"))
    writer.add(twin_run(rig, floors["pvc"], 1.2, 2, name="pvc_120"))
    writer.add(twin_run(rig, floors["natural_stone"], 0.9, 3, lateral_speed=0.35, duration=0.8, name="aside"))
    return path


def test_the_table_stands_beside_the_published_one(folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["validate", str(folder), "--plant", "twin", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "0.016" in printed and "0.054 → 0.013" in printed and "mean over 3 conditions" in printed
    content = json.loads((out / "validation.json").read_text(encoding="utf-8"))
    assert content["mean"]["twin"] < 0.005
    assert [cell["published"] for cell in content["table"]] == [
        {"table_4_2": 0.016},
        {"table_4_2": 0.009},
        {"table_4_3": 0.054, "table_4_4": 0.013},
    ]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("class='plot'") == 3 and ".054 → .013" in page
    assert "http://" not in page and "https://" not in page


def test_both_plants_are_the_default_and_json_is_what_is_written(folder, tmp_path, capsys):
    assert main(["validate", str(folder), "--out", str(tmp_path / "out"), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["plants"] == ["twin", "planar"]
    assert content == json.loads((tmp_path / "out" / "validation.json").read_text())


def test_a_model_with_effects_is_taken_and_differs(folder, tmp_path, capsys):
    model = tmp_path / "model.toml"
    shipped = (models_folder() / "quarter_rig" / "rig.toml").read_text(encoding="utf-8")
    model.write_text(shipped + EFFECT, encoding="utf-8")
    arguments = ["validate", str(folder), "--plant", "planar", "--model", str(model)]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 0
    assert "effects of the model: rail_viscous" in capsys.readouterr().out
    content = json.loads((tmp_path / "out" / "validation.json").read_text())
    assert content["effects"] == ["rail_viscous"] and content["mean"]["planar"] > 0.03


def test_identified_floors_replace_the_shipped_ones(folder, tmp_path):
    slippery = tmp_path / "floors.toml"
    text = (models_folder() / "floors.toml").read_text(encoding="utf-8")
    slippery.write_text(text.replace("sigma_2 = 2.8084", "sigma_2 = 0.4"), encoding="utf-8")
    means = []
    for k, more in enumerate(([], ["--floors", str(slippery)])):
        out = tmp_path / f"out{k}"
        assert main(["validate", str(folder), "--plant", "planar", *more, "--out", str(out)]) == 0
        content = json.loads((out / "validation.json").read_text())
        means.append({cell["floor"]: cell["carriage_speed_rms"]["planar"] for cell in content["table"]})
    assert means[1]["pvc"] > 1.5 * means[0]["pvc"]
    assert means[1]["natural_stone"] == means[0]["natural_stone"]


def test_ctrl_c_keeps_what_was_finished(folder, tmp_path, monkeypatch, capsys):
    from omnimj.estimate.identification import validation as validate

    whole = validate.replay_run

    def stopping(rig, floors, run, plant):
        if run.name != "aside":  # the first by name
            raise KeyboardInterrupt
        return whole(rig, floors, run, plant)

    monkeypatch.setattr(validate, "replay_run", stopping)
    out = tmp_path / "out"
    assert main(["validate", str(folder), "--plant", "planar", "--out", str(out)]) == 130
    content = json.loads((out / "validation.json").read_text())
    assert content["interrupted"] and len(content["runs"]) == 1
    assert "interrupted" in capsys.readouterr().out


def test_bad_input_is_one_line(refused, folder):
    assert "unknown plant 'moon'" in refused("validate", str(folder), "--plant", "moon", "--out", "out")
    assert "no such folder" in refused("validate", "nowhere", "--out", "out")
    assert "no such file" in refused("validate", str(folder), "--floors", "none.toml", "--out", "out")
    assert "required: --out" in refused("validate", str(folder))
