"""A page for people in one HTML file: no script, nothing from elsewhere; light, dark, and on paper."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


class Html(str):
    """Text that is HTML already and is not escaped again."""

    __slots__ = ()


def safe(text: str) -> Html:
    """Return text as HTML."""
    return text if isinstance(text, Html) else Html(escape(text))


def document(title: str, parts: Sequence[Html]) -> str:
    """Return a whole page."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(parts)
        + "\n</main>\n</body>\n</html>\n"
    )


def section(title: str, *parts: Html) -> Html:
    """Return a part of the page under a heading; empty parts are left out, as is a section without any."""
    kept = [part for part in parts if part]
    return Html("\n".join([f"<section><h2>{escape(title)}</h2>", *kept, "</section>"]) if kept else "")


def paragraph(text: str, kind: str = "") -> Html:
    """Return a paragraph."""
    return Html(f'<p class="{kind}">{safe(text)}</p>' if kind else f"<p>{safe(text)}</p>")


def figure(svg: str, caption: str) -> Html:
    """Return a drawing with its caption."""
    return Html(f'<figure><div class="wide">{svg}</div><figcaption>{safe(caption)}</figcaption></figure>')


def table(
    heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = (), *, stacked: bool = False
) -> Html:
    """Return a table; the columns `numbers` are set to the right. Empty without rows.

    A `stacked` one is a card for each row on a phone, headed by its first cell, the others with their heads.
    """
    if not rows:
        return Html("")

    def line(tag: str, cells: Sequence[str]) -> str:
        found = []
        for i, cell in enumerate(cells):
            kind = ' class="n"' if i in numbers else ""
            head = f' data-head="{escape(heads[i])}"' if stacked and i and tag == "td" else ""
            found.append(f"<{tag}{kind}{head}>{safe(cell)}</{tag}>")
        return "".join(found)

    body = "\n".join(f"<tr>{line('td', row)}</tr>" for row in rows)
    head = f"<thead><tr>{line('th', heads)}</tr></thead>"
    kind = ' class="stacked"' if stacked else ""
    return Html(f'<div class="wide"><table{kind}>{head}\n<tbody>\n{body}\n</tbody></table></div>')


def tiles(facts: Sequence[tuple[str, str]]) -> Html:
    """Return a few facts, each what and how much, side by side."""
    cells = "".join(f"<div><dt>{safe(what)}</dt><dd>{safe(value)}</dd></div>" for what, value in facts)
    return Html(f'<dl class="tiles">{cells}</dl>')


def code(text: str) -> Html:
    """Return a name as a configuration spells it."""
    return Html(f"<code>{escape(text)}</code>")


def share(part: float) -> Html:
    """Return a part of one as a bar with its percentage; none of it where negative."""
    width = 100 * min(max(part, 0.0), 1.0)
    text = f"{100 * part:.0f}".replace("-", "−")
    return Html(f'<span class="bar"><i style="width:{width:.0f}%"></i></span> {text}&nbsp;%')


STYLE = """
:root { color-scheme: light dark; --page: #ffffff; --ink: #1b1f24; --quiet: #5b6470; --faint: #e2e5e9;
  --line: #b6bcc5; --raised: #f5f6f8; --before: #c04f00; --after: #0072b2; }
@media screen and (prefers-color-scheme: dark) {
  :root { --page: #15181c; --ink: #e7eaee; --quiet: #a3acb8; --faint: #2b3037; --line: #59626e;
    --raised: #1e2228; --before: #f0a14a; --after: #62b8ee; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 16px/1.5 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 1000px; margin: 0 auto; padding: 28px 20px 48px; }
header { border-left: 6px solid var(--after); padding-left: 18px; margin-bottom: 24px; }
header.doubt { border-color: var(--before); }
h1 { font-size: 27px; line-height: 1.25; margin: 2px 0 8px; overflow-wrap: anywhere; }
h2 { font-size: 19px; margin: 36px 0 6px; break-after: avoid; }
p { margin: 6px 0 10px; max-width: 76ch; overflow-wrap: anywhere; }
.of, .note, figcaption { color: var(--quiet); }
.note, figcaption { font-size: 14px; }
.note { max-width: 88ch; break-after: avoid; }
code { font: 0.92em ui-monospace, "DejaVu Sans Mono", monospace; overflow-wrap: anywhere; }
figure { margin: 10px 0 14px; break-inside: avoid; }
figcaption { margin-top: 4px; max-width: 100ch; }
svg { display: block; width: 100%; min-width: 620px; height: auto; }
svg text { font-family: system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif !important; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; margin: 8px 0 10px; font-size: 15px; }
th { text-align: left; color: var(--quiet); font-weight: 600; border-bottom: 1px solid var(--line); }
th, td { padding: 5px 14px 5px 0; vertical-align: top; }
td { border-bottom: 1px solid var(--faint); overflow-wrap: break-word; }
td:last-child, td:has(.bar) { white-space: nowrap; }
.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
th.n { white-space: normal; }
.whole { white-space: nowrap; }
.doubtful { color: var(--quiet); }
tr { break-inside: avoid; }
.tiles { display: flex; flex-wrap: wrap; gap: 12px; margin: 14px 0 0; }
.tiles div { background: var(--raised); border-radius: 8px; padding: 10px 16px; flex: 1 1 150px; }
dt { color: var(--quiet); font-size: 14px; }
dd { margin: 0; font-size: 18px; font-weight: 600; overflow-wrap: anywhere; }
.bar { display: inline-block; width: 70px; height: 9px; background: var(--faint); border-radius: 4px;
  overflow: hidden; }
.bar i { display: block; height: 100%; background: var(--after); }
.stacked td:last-child { white-space: normal; }
@media screen and (max-width: 640px) {
  .stacked, .stacked tbody, .stacked tr, .stacked td { display: block; text-align: left; }
  .stacked thead { display: none; }
  .stacked tr { padding: 8px 0; border-bottom: 1px solid var(--line); }
  .stacked td { padding: 1px 0; border: 0; white-space: normal; overflow-wrap: anywhere; }
  .stacked td:first-child { font-weight: 600; }
  .stacked td .whole { white-space: normal; }
  .stacked td[data-head]::before { content: attr(data-head) ": "; color: var(--quiet); } }
@page { size: A4; margin: 15mm; }
@media print {
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  body { font-size: 10.5pt; }
  main { max-width: none; padding: 0; }
  h1 { font-size: 18pt; } h2 { font-size: 13pt; margin-top: 7mm; }
  table { font-size: 9.5pt; } .note, figcaption { font-size: 9pt; }
  .wide { overflow: visible; } svg { min-width: 0; max-height: 225mm; }
}
"""
