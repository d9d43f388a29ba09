"""A floor is read whole or refused in one line that names place, value, rule and choices."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import omnimj
from omnimj.errors import InputError
from omnimj.parameters import read_floors
from omnimj.parameters.floor import (
    CREEP_RATIO,
    LAWS,
    OPTIONAL,
    TractionParameters,
    format_floor,
    number_rules,
)

PAGE = (Path(omnimj.__file__).parent / "docs" / "models.md").read_text(encoding="utf-8")
MAT = """
[mat]
description = "a mat"
law = "creep_ratio"
source = "chosen"
mu = 0.5
creep_stiffness = 10.0
relaxation_length = 0.02
damping_time = 0.005
"""


@pytest.fixture
def refused(tmp_path):
    def message(text):
        path = tmp_path / "own.toml"
        path.write_text(text)
        with pytest.raises(InputError) as caught:
            read_floors(path)
        found = str(caught.value)
        assert found.startswith(str(path)) and "\n" not in found
        return found.removeprefix(f"{path}: ")

    return message


@pytest.mark.parametrize(
    ("line", "wrong", "expected"),
    [
        ('law = "creep_ratio"', 'law = "creep"', "mat.law: unknown traction law 'creep'"),
        (
            'law = "creep_ratio"',
            "",
            "mat.law: is missing; a floor has a traction law; choices: creep_ratio, lu",
        ),
        ("mu = 0.5", "mu = 0", "mat.mu: found 0; must be above 0"),
        ("mu = 0.5", "", "mat: 'mu' is missing"),
        (
            "mu = 0.5",
            "mu_c = 0.5",
            "mat: unknown key 'mu_c'; did you mean 'mu_cap'?; choices: creep_stiffness, ",
        ),
        ("creep_stiffness = 10.0", "creep_stiffness = -1", "mat.creep_stiffness: found -1; must be above 0"),
        (
            "creep_stiffness = 10.0",
            "creep_stiffness = 'much'",
            "mat.creep_stiffness: found 'much'; a number is",
        ),
        ("relaxation_length = 0.02", "relaxation_length = nan", "mat.relaxation_length: found nan; must be"),
        ("damping_time = 0.005", "damping_time = -0.1", "mat.damping_time: found -0.1; must be at least 0"),
    ],
)
def test_a_mistake_in_the_law_is_refused_in_one_line(refused, line, wrong, expected):
    assert refused(MAT.replace(line, wrong)).startswith(expected)


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ("mu_cap = 0", "mat.mu_cap: found 0; must be above 0"),
        (
            "load_exponent = 0.7",
            "mat: 'reference_load' is missing; load_exponent and reference_load go together",
        ),
        (
            "reference_load = 40",
            "mat: 'load_exponent' is missing; load_exponent and reference_load go together",
        ),
        (
            "load_exponent = 0\nreference_load = 40",
            "mat.load_exponent: found 0; must be above 0 and at most 2",
        ),
        (
            "load_exponent = 2.5\nreference_load = 40",
            "mat.load_exponent: found 2.5; must be above 0 and at most 2",
        ),
        ("load_exponent = 1\nreference_load = 0", "mat.reference_load: found 0; must be above 0"),
        ("rolling_resistance = -0.01", "mat.rolling_resistance: found -0.01; must be at least 0"),
        ("roller_resistance = -1", "mat.roller_resistance: found -1; must be at least 0"),
        ("roller_dry = nan", "mat.roller_dry: found nan; must be at least 0"),
        ("sigma_0 = 1.0", "mat: unknown key 'sigma_0'; choices: creep_stiffness, "),
    ],
)
def test_a_mistake_in_what_every_law_may_have_is_refused_in_one_line(refused, more, expected):
    assert refused(MAT + more).startswith(expected)


def test_an_unknown_law_names_the_laws(refused):
    assert refused(MAT.replace("creep_ratio", "lugre_capped")).endswith(
        "choices: creep_ratio, lugre, magic_formula"
    )


def test_what_is_not_given_changes_nothing(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(MAT)
    plain = TractionParameters(
        CREEP_RATIO, mu=0.5, creep_stiffness=10.0, relaxation_length=0.02, damping_time=0.005
    )
    assert read_floors(path)["mat"].traction == plain
    path.write_text(MAT + "mu_cap = 0.3\nload_exponent = 0.8\nreference_load = 40\n")
    limited = plain._replace(mu_cap=0.3, load_exponent=0.8, reference_load=40.0)
    assert read_floors(path)["mat"].traction == limited


@pytest.mark.parametrize("name", ["rolling_resistance", "roller_resistance", "roller_dry"])
@pytest.mark.parametrize("resistance", [0.0, 0.035])
def test_a_floor_with_rolling_resistance_is_written_and_read_again(tmp_path, name, resistance):
    path = tmp_path / "own.toml"
    path.write_text(f"{MAT}{name} = {resistance}\n")
    mat = read_floors(path)["mat"]
    assert getattr(mat.traction, name) == mat.row[TractionParameters._fields.index(name)] == resistance
    path.write_text(format_floor(mat))
    assert read_floors(path)["mat"] == mat


def test_the_floor_in_the_documentation_is_one(tmp_path):
    (text,) = [code for code in re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL) if "law = " in code]
    (tmp_path / "mats.toml").write_text(text, encoding="utf-8")
    (mat,) = read_floors(tmp_path / "mats.toml").values()
    assert set(OPTIONAL) < set(mat.numbers)


def test_every_law_and_every_field_is_documented():
    fields = {field for law in LAWS for field in number_rules(law)}
    assert [name for name in {*LAWS, *fields} if f"`{name}`" not in PAGE] == []


def test_every_law_has_a_shipped_floor():
    assert {floor.law for floor in read_floors().values()} == set(LAWS)
