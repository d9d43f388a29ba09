"""No page is wider than the screen of a phone; what is too wide scrolls within its own box."""

from __future__ import annotations

import html
import json
import re

import pytest
from browser import chromium, run

from omnimj.documentation.site import SiteBuild

_LOOK = """<body><pre id="found"></pre><script>
const pages = %s, width = %d, found = {};
const scrolls = (e, view) => ['auto', 'scroll', 'hidden'].includes(view.getComputedStyle(e).overflowX);
(async () => {
  for (const page of pages) {
    const frame = document.createElement('iframe');
    Object.assign(frame, {width, height: 900, src: page});
    document.body.appendChild(frame);
    await new Promise(done => { frame.onload = done; });
    const body = frame.contentDocument.body, wide = [];
    for (const e of body.querySelectorAll('main *')) {
      const box = e.getBoundingClientRect();
      let inner = false;
      for (let up = e.parentElement; up && up !== body; up = up.parentElement)
        inner = inner || scrolls(up, frame.contentWindow);
      if (!inner && box.width > 0 && box.right > width + 0.5) wide.push(e.textContent.slice(0, 40));
    }
    found[page] = {width: frame.contentDocument.documentElement.scrollWidth, wide};
    frame.remove();
  }
  document.getElementById('found').textContent = JSON.stringify(found);
})();
</script>"""


@pytest.mark.slow
@pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine")
@pytest.mark.parametrize("width", [390, 1200])
def test_pages_are_as_wide_as_the_screen(site: SiteBuild, width, tmp_path):
    pages = [path.as_uri() for path in sorted(site.folder.rglob("*.html")) if path.name != "404.html"]
    (tmp_path / "look.html").write_text(_LOOK % (json.dumps(pages), width), encoding="utf-8")
    flags = ("--allow-file-access-from-files", "--window-size=1400,1000", "--dump-dom")
    dumped = run(str(chromium()), tmp_path, *flags, (tmp_path / "look.html").as_uri())
    match = re.search(r"<pre id=\"found\">(.+?)</pre>", dumped, flags=re.DOTALL)
    assert match is not None, "the browser has not looked at all pages"
    found = json.loads(html.unescape(match[1]))
    assert set(found) == set(pages)
    assert {page: seen for page, seen in found.items() if seen["width"] > width or seen["wide"]} == {}
