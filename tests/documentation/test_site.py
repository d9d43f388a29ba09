"""The site is complete, its links lead somewhere, and its pages load nothing from elsewhere."""

from __future__ import annotations

import argparse
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

import omnimj
from omnimj.documentation import navigation
from omnimj.documentation import site as publishing
from omnimj.documentation.reference import reference_pages
from omnimj.documentation.site import SiteBuild, publish
from omnimj.documentation.staging import DOCS, pages_elsewhere
from omnimj.effects.catalogue import EFFECTS
from omnimj.errors import OmnimjError

_LOADED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src", "object": "data"}
_LINKS_LOADED = {"stylesheet", "icon", "preload", "modulepreload", "manifest", "preconnect", "dns-prefetch"}


class Page(HTMLParser):
    """What a page loads, where it leads, and its anchors."""

    def __init__(self, text: str):
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = {""}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.anchors.add(found.get("id", ""))
        self.anchors.add(found.get("name", ""))
        if tag in _LOADED and _LOADED[tag] in found:
            self.loads.append(found[_LOADED[tag]])
        if tag == "link" and set(found.get("rel", "").split()) & _LINKS_LOADED:
            self.loads.append(found["href"])
        if tag == "a" and "href" in found:
            self.links.append(found["href"])


@pytest.fixture(scope="module")
def pages(site: SiteBuild) -> dict[Path, Page]:
    return {path: Page(path.read_text(encoding="utf-8")) for path in site.folder.rglob("*.html")}


def test_the_generator_has_nothing_to_warn_of(site: SiteBuild):
    assert site.warnings == ()


def test_every_page_of_the_documentation_is_in_the_site(site: SiteBuild, pages):
    sources = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")} | set(pages_elsewhere())
    assert sources < set(site.pages)
    built = {path.relative_to(site.folder).as_posix() for path in pages}
    assert {page.replace(".md", ".html") for page in site.pages} == built - {"404.html"}


def test_every_page_is_once_in_the_navigation():
    sources = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    assert sorted(navigation.pages()) == sorted(sources | set(pages_elsewhere()) | set(reference_pages()))


@pytest.mark.slow
def test_a_page_outside_the_navigation_is_a_warning_which_ends_the_build(tmp_path, monkeypatch):
    def stage(sources, *_):
        named = (*navigation.pages(), "a_page_of_tomorrow.md")
        for page in named:
            (sources / page).parent.mkdir(parents=True, exist_ok=True)
            (sources / page).write_text("# Title\n", encoding="utf-8")
        return named

    monkeypatch.setattr(publishing, "stage", stage)
    with pytest.raises(OmnimjError, match=r"(?s)not included in .*a_page_of_tomorrow.md"):
        publish(tmp_path / "site", False, argparse.ArgumentParser(), False, lambda *_: None)


def test_pages_load_nothing_from_another_host(pages):
    found = {
        (path.name, url) for path, page in pages.items() for url in page.loads if "//" in url.split("?")[0]
    }
    assert found == set()


def test_scripts_and_styles_name_other_hosts_only_where_they_are_never_asked(site: SiteBuild):
    styles = "".join(path.read_text(encoding="utf-8") for path in site.folder.rglob("*.css"))
    assert re.findall(r"(?:url\(|@import\s*)[\"']?(?:https?:)?//[^\"')]+", styles) == []
    bundle = "".join(path.read_text(encoding="utf-8") for path in site.folder.rglob("bundle*.js"))
    # of the theme: diagrams, figures of a repository, and what browsers before 2020 lack
    rare = ("unpkg.com/mermaid", "api.github.com", "unpkg.com/iframe-worker", "unpkg.com/resize-observer")
    asked = re.findall(r"https://((?:unpkg|cdn|api|fonts|cdnjs)\.[\w./-]*)", bundle)
    assert [url for url in asked if not url.startswith(rare)] == []
    for path in site.folder.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert 'class="mermaid"' not in text and 'data-md-component="source"' not in text


def test_links_and_anchors_within_the_site_lead_somewhere(site: SiteBuild, pages):
    broken = []
    for path, page in pages.items():
        if path.name == "404.html":
            continue
        for link in page.links:
            target, anchor = urldefrag(link)
            if re.match(r"[a-z]+:", target):
                continue
            goal = (path.parent / unquote(target)).resolve() if target else path
            if not goal.exists() or (goal in pages and unquote(anchor) not in pages[goal].anchors):
                broken.append(f"{path.name}: {link}")
    assert broken == []


def test_a_page_has_both_colour_schemes_and_search(site: SiteBuild):
    home = (site.folder / "index.html").read_text(encoding="utf-8")
    assert 'data-md-color-scheme="slate"' in home and 'data-md-color-scheme="default"' in home
    assert (site.folder / "search" / "search_index.js").stat().st_size > 100_000
    assert "assets/iframe-worker.js" in home


def test_every_effect_and_every_public_name_is_in_the_reference(site: SiteBuild, pages):
    effects = (site.folder / "effects.html").read_text(encoding="utf-8")
    assert [name for name in EFFECTS if f"<code>{name}</code>" not in effects] == []
    anchors = pages[site.folder / "api.html"].anchors
    assert [
        name for name in omnimj.__all__ if not name.startswith("_") and f"omnimj.{name}" not in anchors
    ] == []
