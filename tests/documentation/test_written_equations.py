"""Equations become MathML, each of them, and nothing of LaTeX is left."""

from __future__ import annotations

import re
import xml.etree.ElementTree

import pytest

from omnimj.documentation.equations import format_equation
from omnimj.documentation.staging import DOCS

BLOCKS = [
    code
    for page in sorted(DOCS.rglob("*.md"))
    for code in re.findall(r"```math\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
]


@pytest.mark.parametrize("code", BLOCKS)
def test_an_equation_becomes_mathml_without_a_rest_of_latex(code):
    root = xml.etree.ElementTree.fromstring(format_equation(code, "math", "math", {}, None))
    assert [child.tag.rpartition("}")[2] for child in root] == ["math"]
    assert "\\" not in "".join(root.itertext())


def test_a_fraction_has_two_parts():
    assert "<mfrac><mrow><mi>a</mi></mrow><mrow><mi>b</mi></mrow></mfrac>" in format_equation(
        "\\frac{a}{b}", "", "", {}, None
    )


def test_the_page_of_equations_has_those_of_contact_diagnosis_and_gap():
    assert len(BLOCKS) >= 10
