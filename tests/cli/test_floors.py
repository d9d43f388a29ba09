"""`--floors FILE`: a user's floors drive every plant, and a mistake in them is reported in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import pytest

from omnimj.cli.main import main
from omnimj.parameters import read_floors
from omnimj.parameters.floor import format_floor

GLASS = replace(read_floors()["natural_stone"], name="glass", description="wet", source="my own test")
RIG = ("run", "rig_lateral", "--set", "duration=0.3", "--set", "checks={}", "--json")


@pytest.fixture
def own(tmp_path):
    """A file with stone as slippery as glass, and with glass."""
    numbers = {**GLASS.numbers, "mu_c": 0.001, "mu_s": 0.001, "sigma_2": 0.01}
    slippery = replace(GLASS, numbers=numbers)
    path = tmp_path / "own.toml"
    path.write_text(
        format_floor(slippery) + format_floor(replace(slippery, name="natural_stone")), encoding="utf-8"
    )
    return path


def metrics(capsys, *argv: str) -> dict:
    assert main([*RIG, *argv]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("plant", ["twin", "planar"])
def test_a_user_s_floor_replaces_the_shipped_one_of_its_name(capsys, own, plant):
    shipped = metrics(capsys, "--plant", plant)
    mine = metrics(capsys, "--plant", plant, "--floors", str(own))
    other = metrics(capsys, "--plant", plant, "--floors", str(own), "--set", "floor=glass")
    speeds = [run["final_speed"] for run in (shipped, mine, other)]
    assert speeds[1] < 0.5 * speeds[0] and speeds[1] == speeds[2]


@pytest.mark.parametrize("plant", ["twin", "planar"])
def test_a_user_s_floor_of_another_law_drives_the_plants(capsys, tmp_path, plant):
    mat = replace(read_floors()["linoleum"], name="mat")
    softer = {**mat.numbers, "load_exponent": 1.5, "reference_load": 1000.0}
    path = tmp_path / "mats.toml"
    path.write_text(format_floor(mat) + format_floor(replace(mat, name="soft", numbers=softer)), "utf-8")
    speeds = [
        metrics(capsys, "--plant", plant, "--floors", str(path), "--set", f"floor={name}")["final_speed"]
        for name in ("linoleum", "mat", "soft")
    ]
    assert speeds[0] == speeds[1] > 1.2 * speeds[2] > 0.0


def test_a_floor_survives_its_text(tmp_path):
    path = tmp_path / "floors.toml"
    shipped = read_floors()
    path.write_text("\n".join(map(format_floor, shipped.values())), encoding="utf-8")
    assert read_floors(path) == shipped


@pytest.mark.parametrize(
    "argv",
    [
        ("run", "rig_lateral", "--plant", "planar"),
        ("run", "nylon_patch", "--plant", "planar"),
        ("record", "rig_currents", "--out", "data"),
        ("validate", "data", "--out", "out"),
        ("gap", "data", "--out", "out"),
    ],
    ids=lambda argv: " ".join(argv[:2]),
)
def test_a_mistake_in_a_floor_is_reported_by_every_command(refused: Callable[..., str], tmp_path, argv):
    path = tmp_path / "bad.toml"
    path.write_text(format_floor(GLASS).replace("mu_c = ", "mu_d = "), encoding="utf-8")
    assert "bad.toml: glass: unknown key 'mu_d'; did you mean" in refused(*argv, "--floors", str(path))
    missing = refused(*argv, "--floors", str(tmp_path / "none.toml"))
    assert "none.toml" in missing
