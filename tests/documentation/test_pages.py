"""Code blocks of every page are what their mark says, and every command has its place."""

from __future__ import annotations

import json
import re
import tomllib

import pytest

from omnimj.documentation.staging import DOCS, pages_elsewhere

PAGES = [*sorted(DOCS.rglob("*.md")), *pages_elsewhere().values()]
BLOCKS = [
    pytest.param(language, code, id=f"{page.stem}-{k}-{language}")
    for page in PAGES
    for k, (language, code) in enumerate(
        re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    )
]
KNOWN = {"python", "sh", "bash", "toml", "text", "math", "mermaid", "json", "xml", "c", "bibtex", "csv"}


@pytest.mark.parametrize("language, code", BLOCKS)
def test_a_block_is_what_its_mark_says(language, code):
    assert language in KNOWN, "a block without a mark is not coloured, and nobody knows what it is"
    if language == "python":
        compile(code, "page", "exec")
    elif language == "toml":
        tomllib.loads(code)
    elif language == "json":
        json.loads(code)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_fences_come_in_pairs_and_a_page_begins_with_its_title(page):
    text = page.read_text(encoding="utf-8")
    assert len(re.findall(r"^```", text, flags=re.MULTILINE)) % 2 == 0
    assert re.match(r"(?:---\n.*?\n---\n+)?# \S", text, flags=re.DOTALL)
