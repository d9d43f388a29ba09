"""An HTML page in one file that works offline, on a phone and on paper."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from pathlib import Path

_KINDS = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".svg": "image/svg+xml"}

_STYLE = """
:root { --ink: #1d2733; --muted: #5a6572; --line: #dde2e8; --soft: #f5f7f9; --good: #1d6b4a;
  --bad: #a32a13; }
* { box-sizing: border-box; }
body { margin: 0; color: var(--ink); background: #fff; line-height: 1.5; -webkit-text-size-adjust: 100%;
  font-family: "Segoe UI", "Helvetica Neue", Helvetica, Arial, "Liberation Sans", sans-serif;
  font-size: 16px; }
main { max-width: 1160px; margin: 0 auto; padding: 28px 20px 48px; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .7rem; padding-bottom: .25rem;
  border-bottom: 1px solid var(--line); }
p { margin: .4rem 0; max-width: 75ch; }
.lead { font-size: 1.08rem; color: var(--muted); }
.verdict { display: inline-block; margin: .7rem 0 .2rem; padding: .35rem .9rem; border-radius: 6px;
  font-weight: 600;
  border: 2px solid currentColor; }
h1 + .lead + .verdict { margin-bottom: 1.1rem; }
.good { color: var(--good); } .bad { color: var(--bad); } .plain { color: var(--muted); }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 440px), 1fr));
  gap: 18px 34px; }
.columns > * { min-width: 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: .95rem; }
th, td { text-align: left; padding: .38rem .9rem .38rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; }
th { font-weight: 600; color: var(--muted); font-size: .86rem; }
tbody th { width: 36%; padding-right: 1.2rem; }
td.number { font-variant-numeric: tabular-nums; white-space: nowrap; }
td.state { white-space: nowrap; font-weight: 600; }
figure { margin: 0; break-inside: avoid; }
figure svg, figure img { width: 100%; height: auto; display: block; }
figure.picture img { border-radius: 8px; border: 1px solid var(--line); }
figcaption { font-size: .92rem; color: var(--muted); margin: .15rem 0 .5rem; }
figcaption b { color: var(--ink); display: block; font-size: 1rem; }
.plots { align-items: end; }
.plots figcaption { margin: 0 0 .35rem; }
.columns > section > h2 { margin-top: 1.2rem; }
code { font-family: ui-monospace, "DejaVu Sans Mono", Menlo, Consolas, monospace; font-size: .88em;
  overflow-wrap: anywhere; }
pre { background: var(--soft); border: 1px solid var(--line); border-radius: 6px; padding: .6rem .8rem;
  margin: .4rem 0;
  overflow-x: auto; white-space: pre-wrap; }
footer { margin-top: 2.4rem; padding-top: .8rem; border-top: 1px solid var(--line); color: var(--muted);
  font-size: .88rem; }
@media (max-width: 520px) { main { padding: 18px 14px 36px; } h1 { font-size: 1.5rem; }
  td.number { white-space: normal; } }
@media print { body { font-size: 10.5pt; } main { max-width: none; padding: 0; }
  .columns { grid-template-columns: 1fr 1fr; gap: 10px 20px; } h2 { break-after: avoid;
  } tr { break-inside: avoid; } }
"""


def text(words: object) -> str:
    """Words from anywhere, made safe for a page."""
    return html.escape(str(words), quote=True)


def table(rows: Sequence[Sequence[str]], head: Sequence[str] = ()) -> str:
    """A table of ready cells; the first cell of each row is its heading when the table has no head.

    Args:
      rows: Cells as HTML (see `cell`).
      head: Column headings as plain text.
    """
    top = "".join(f"<th scope='col'>{text(name)}</th>" for name in head)
    body = []
    for row in rows:
        if head:
            body.append("<tr>" + "".join(row) + "</tr>")
        else:
            body.append(f"<tr><th scope='row'>{row[0]}</th>{row[1]}</tr>")
    front = f"<thead><tr>{top}</tr></thead>" if head else ""
    return f"<div class='wide'><table>{front}<tbody>{''.join(body)}</tbody></table></div>"


def cell(words: object, kind: str = "") -> str:
    """One cell of a table."""
    return f"<td class='{kind}'>{text(words)}</td>" if kind else f"<td>{text(words)}</td>"


def state(ok: bool, judged: bool = True) -> str:
    """A cell that says whether something holds: a sign and a word, not colour alone."""
    if not judged:
        return "<td class='state'>– not judged</td>"
    return f"<td class='state {'good' if ok else 'bad'}'>{'✓ ok' if ok else '✗ failed'}</td>"


def figure(content: str, heading: str, caption: str, kind: str = "") -> str:
    """A figure with its heading and caption; `content` is ready HTML."""
    name = f" class='{kind}'" if kind else ""
    words = f"<figcaption><b>{text(heading)}</b>{text(caption)}</figcaption>"
    return (
        f"<figure{name}>{content}{words}</figure>"
        if kind == "picture"
        else f"<figure{name}>{words}{content}</figure>"
    )


def image(file: Path, words: str) -> str:
    """A picture carried inside the page."""
    kind = _KINDS[file.suffix.lower()]
    content = base64.b64encode(file.read_bytes()).decode("ascii")
    return f"<img src='data:{kind};base64,{content}' alt='{text(words)}'>"


def section(heading: str, content: str) -> str:
    """A part of the page under a heading; `content` is ready HTML."""
    return f"<section><h2>{text(heading)}</h2>{content}</section>"


def document(heading: str, content: str, style: str = "") -> str:
    """The whole page; `content` is ready HTML, `style` what a kind of page adds to the common style."""
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        "<meta name='color-scheme' content='light'>"
        f"<title>{text(heading)}</title><style>{_STYLE}{style}</style></head>\n"
        f"<body><main>\n{content}\n</main></body></html>\n"
    )
