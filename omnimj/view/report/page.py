"""An HTML page in one file that works offline, on a phone and on paper."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Sequence
from pathlib import Path

_KINDS = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".svg": "image/svg+xml"}
_MANY, _SENTENCE = 4, 40  # columns of a table, letters of a cell, from which rows are stacked on a phone
_WIDE = 5  # columns from which they are whatever the cells hold

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
.wide { overflow-x: auto; background:
  linear-gradient(to right, #fff 30%, #fff0) left / 36px 100% no-repeat local,
  linear-gradient(to left, #fff 30%, #fff0) right / 36px 100% no-repeat local,
  linear-gradient(to right, #1d273330, #1d273300) left / 12px 100% no-repeat scroll,
  linear-gradient(to left, #1d273330, #1d273300) right / 12px 100% no-repeat scroll; }
figure.broad svg { min-width: 780px; }
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
.plots { align-items: start; }
.plots figcaption { margin: 0 0 .35rem; }
.columns > section > h2 { margin-top: 1.2rem; }
code { font-family: ui-monospace, "DejaVu Sans Mono", Menlo, Consolas, monospace; font-size: .88em;
  overflow-wrap: anywhere; }
pre { background: var(--soft); border: 1px solid var(--line); border-radius: 6px; padding: .6rem .8rem;
  margin: .4rem 0;
  overflow-x: auto; white-space: pre-wrap; }
pre .option { white-space: nowrap; }
footer { margin-top: 2.4rem; padding-top: .8rem; border-top: 1px solid var(--line); color: var(--muted);
  font-size: .88rem; }
@media screen and (max-width: 520px) { main { padding: 18px 14px 36px; } h1 { font-size: 1.5rem; }
  td.number { white-space: normal; } td.state { padding-right: .6rem; }
  figure > svg { width: calc(100% + 28px); margin: 0 -14px; } }
table.told { margin-bottom: 1.1rem; }
@media screen and (max-width: 640px) { table.told thead { display: none; }
  table.told tr { display: block; border-bottom: 2px solid var(--line); padding: .35rem 0; }
  table.told td { display: flow-root; border: 0; padding: .08rem 0 .08rem 9.5rem; }
  table.told td.none, table.told td:empty { display: none; }
  table.told td::before { content: attr(data-head); color: var(--muted); font-size: .86rem;
    font-weight: 600; float: left; width: 9rem; margin-left: -9.5rem; } }
@media print { body { font-size: 10.5pt; } main { max-width: none; padding: 0; }
  * { -webkit-print-color-adjust: exact; print-color-adjust: exact; }
  .columns { grid-template-columns: 1fr 1fr; gap: 10px 20px; }
  .wide { overflow: visible; background: none; } .wide table { font-size: 9pt; }
  td, th { overflow-wrap: anywhere; padding-right: .6rem; } td.number { white-space: normal; }
  figure.broad svg { min-width: 0; }
  h1, h2, h3, figcaption { break-after: avoid; } tr, pre, figure { break-inside: avoid; }
  details::details-content { content-visibility: visible; height: auto; }
  p { orphans: 3; widows: 3; } thead { display: table-header-group; } }
"""


def text(words: object) -> str:
    """Words from anywhere, made safe for a page."""
    return html.escape(str(words), quote=True)


def table(rows: Sequence[Sequence[str]], head: Sequence[str] = ()) -> str:
    """A table of ready cells; the first cell of each row is its heading when the table has no head.

    On a narrow page it is moved under the finger; where cells hold sentences or are many each row is a list.

    Args:
      rows: Cells as HTML (see `cell`).
      head: Column headings as plain text.
    """
    top = "".join(f"<th scope='col'>{text(name)}</th>" for name in head)
    body = []
    for row in rows:
        if head:
            named = (_named(one, name) for one, name in zip(row, head, strict=False))
            body.append("<tr>" + "".join(named) + "</tr>")
        else:
            body.append(f"<tr><th scope='row'>{row[0]}</th>{row[1]}</tr>")
    front = f"<thead><tr>{top}</tr></thead>" if head else ""
    is_long = len(head) >= _WIDE or (len(head) >= _MANY and any(map(_has_sentence, rows)))
    kind = " class='told'" if is_long else ""
    return f"<div class='wide'><table{kind}>{front}<tbody>{''.join(body)}</tbody></table></div>"


def _named(one: str, heading: str) -> str:
    """A ready cell that carries its column's heading, to be shown where the head is not."""
    return one.replace("<td", f"<td data-head='{text(heading)}'", 1)


def _has_sentence(row: Sequence[str]) -> bool:
    return any(len(re.sub(r"<[^>]*>", "", one)) > _SENTENCE for one in row)


def command(words: object) -> str:
    """A command line to be copied, broken between its words but not inside `--option`."""
    ready = re.sub(r"(?<!\S)--?[\w-]+", r"<span class='option'>\g<0></span>", text(words))
    return f"<pre><code>{ready}</code></pre>"


def broad(content: str) -> str:
    """A drawing as wide as the page; on a narrower screen it is moved under the finger."""
    return f"<div class='wide'>{content}</div>"


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
