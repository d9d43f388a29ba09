"""A state diagram becomes a table of all its transitions."""

from __future__ import annotations

import re

import pytest

from omnimj.documentation.equations import format_state_diagram
from omnimj.documentation.staging import DOCS


def table(source: str) -> str:
    return format_state_diagram(source, "mermaid", "", {}, None)


def test_transitions_from_one_state_stand_in_one_row():
    found = table("stateDiagram-v2\n  [*] --> idle: power-up\n  idle --> on: a < b\n  idle --> off: stop\n")
    assert re.findall(r"<td>(.*?)</td>", found) == [
        "(start)",
        "<strong>idle</strong>: power-up",
        "idle",
        "<strong>on</strong>: a &lt; b<br><strong>off</strong>: stop",
    ]


def test_every_transition_of_the_documentation_is_in_its_table():
    text = "".join(page.read_text(encoding="utf-8") for page in DOCS.rglob("*.md"))
    diagrams = re.findall(r"^```mermaid\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    assert diagrams
    for source in diagrams:
        assert table(source).count("<strong>") == source.count("-->")


@pytest.mark.parametrize(
    "source", ["graph TD\n  a --> b: x", "stateDiagram-v2\n  a -> b", "stateDiagram-v2\n  a --> b"]
)
def test_another_diagram_is_refused(source):
    with pytest.raises(ValueError, match="not a transition"):
        table(source)
