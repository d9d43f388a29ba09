"""A headless Chromium that measures a report on a phone's screen and prints it, where there is one."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PHONE = (390, 844)
"""Width and height of a common phone's page [CSS pixels]."""
_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_LOOK = """
<!DOCTYPE html><meta charset='utf-8'><style>body { margin: 0; } iframe { border: 0; }</style>
<iframe id='phone' width='%d' height='%d'></iframe><pre id='found'></pre>
<script>
const scrolls = (e, view) => ['auto', 'scroll', 'hidden'].includes(view.getComputedStyle(e).overflowX);
function look(frame, width) {
  const page = frame.contentDocument, view = frame.contentWindow, found = [];
  if (page.documentElement.scrollWidth > width) found.push('the page itself, ' +
    page.documentElement.scrollWidth);
  let smallest = Infinity;
  for (const e of page.body.querySelectorAll('*')) {
    const box = e.getBoundingClientRect();
    if (e.tagName === 'text' && box.height > 0) {
      const size = parseFloat(view.getComputedStyle(e).fontSize);
      const m = e.getScreenCTM();
      smallest = Math.min(smallest, size * Math.hypot(m.c, m.d));
      const frame = e.ownerSVGElement.getBoundingClientRect();
      if (box.right > frame.right + 1.5 || box.left < frame.left - 1.5)
        found.push('cut off in a figure: ' + e.textContent);
    }
    let inner = false;
    for (let up = e.parentElement; up && up !== page.body; up = up.parentElement)
      inner = inner || scrolls(up, view);
    if (!inner && e.namespaceURI.endsWith('xhtml') && box.width > 0 && box.right > width + 0.5)
      found.push(e.tagName + '.' + e.className + ' ends at ' + box.right.toFixed(0) + ': '
        + e.textContent.slice(0, 40));
  }
  return {found, smallest: isFinite(smallest) ? smallest : null, height: page.documentElement.scrollHeight};
}
const frame = document.getElementById('phone');
frame.onload = async () => {
  const pause = milliseconds => new Promise(done => setTimeout(done, milliseconds));
  const documents = () => frame.contentWindow.Bokeh?.documents ?? [];
  const places = frame.contentDocument.querySelectorAll('[data-root-id]');
  while (places.length && (!documents().length || documents().some(one => !one.is_idle))) await pause(50);
  await pause(300);
  document.getElementById('found').textContent = JSON.stringify(look(frame, %d));
};
frame.srcdoc = %s;
</script>
"""

_HANDS = """
const pause = milliseconds => new Promise(done => setTimeout(done, milliseconds));
const parts = function* (root) {  // elements, also those inside of shadow trees
  for (const e of root.querySelectorAll('*')) { yield e; if (e.shadowRoot) yield* parts(e.shadowRoot); }
};
const find = (root, name) => [...parts(root)].filter(e => e.classList.contains(name));
const panels = name => find(document.getElementById(name), 'bk-Figure');
const models = type => Bokeh.documents.flatMap(doc => [...doc.all_models].filter(m => m.type === type));
const canvas = panel => find(panel.shadowRoot, 'bk-events')[0];
const pointer = (e, kind, x, y) => e.dispatchEvent(new PointerEvent('pointer' + kind, {clientX: x,
  clientY: y, bubbles: true, composed: true, cancelable: true, pointerId: 1, isPrimary: true, button: 0,
  buttons: kind === 'up' ? 0 : 1, pointerType: 'mouse', view: window}));
(async () => {
  try {
    const loading = () => document.querySelector(
      'details[open] > script, details[open] [data-root-id]:empty');
    while (Bokeh.documents.some(doc => !doc.is_idle) || !Bokeh.documents.length || loading()) await pause(50);
    const result = await (async () => { %s })();
    document.getElementById('result').textContent = JSON.stringify(result);
  } catch (problem) {
    document.getElementById('result').textContent = JSON.stringify({problem: String(problem.stack)});
  }
})();
"""


@dataclass(frozen=True)
class Seen:
    """What a page looks like on a phone."""

    found: list[str]
    """What is wider than the screen outside boxes that scroll, and words cut off in figures."""
    smallest: float | None
    """Height of the smallest letters in figures [CSS pixels]; None without figures."""
    height: int
    """Of the page [CSS pixels]."""


def chromium() -> str | None:
    """The command of a Chromium on this machine; None without one."""
    return next((path for path in map(shutil.which, _NAMES) if path), None)


def on_a_phone(browser: str, page: str, work: Path) -> Seen:
    """What of a page reaches over the edge of a phone's screen, and its smallest words in figures.

    Args:
      browser: Command of the Chromium.
      page: HTML.
      work: An empty folder to work in.

    Raises:
      RuntimeError: The browser did not come to it.
    """
    # "<" only as an escape, else the page's own </script> would end this one
    quoted = json.dumps(page).replace("<", "\\u003c")
    (work / "look.html").write_text(_LOOK % (*PHONE, PHONE[0], quoted), encoding="utf-8")
    dumped = run(browser, work, "--window-size=900,1000", "--dump-dom", (work / "look.html").as_uri())
    match = re.search(r"<pre id=\"found\">(.+?)</pre>", dumped, flags=re.DOTALL)
    if match is None:
        raise RuntimeError("the browser has not looked at the page")
    return Seen(**json.loads(html.unescape(match[1])))


def operate(browser: str, page: str, script: str, work: Path, width: int = 1200) -> Any:
    """Result of a script that uses a page as a person would.

    Args:
      browser: Command of the Chromium.
      page: HTML.
      script: Body of an asynchronous function that is called when all plots are drawn and returns the
        result; `_HANDS` has what it may call.
      work: An empty folder to work in.
      width: Of the page, at least 500 [CSS pixels].

    Raises:
      RuntimeError: The script did not come to its end.
    """
    called = f"<pre id='result'></pre><script>{_HANDS % script}</script></body>"
    (work / "used.html").write_text(page.replace("</body>", called), encoding="utf-8")
    dumped = run(browser, work, f"--window-size={width},1000", "--dump-dom", (work / "used.html").as_uri())
    result = re.search(r"<pre id=\"result\">(.+?)</pre>", dumped, flags=re.DOTALL)
    if result is None:
        raise RuntimeError("the script has not come to its end")
    found = json.loads(html.unescape(result[1]))
    if isinstance(found, dict) and "problem" in found:
        raise RuntimeError(found["problem"])
    return found


def run(browser: str, work: Path, *words: str) -> str:
    """Runs the browser without a window and returns what it prints."""
    flags = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars")
    profile = f"--user-data-dir={work / 'profile'}"
    command = [browser, *flags, profile, "--virtual-time-budget=8000", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
