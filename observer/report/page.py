"""A page for people in one HTML file: no script, nothing from elsewhere; light, dark, and on paper."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib import resources


class Html(str):
    """Text that is HTML already and is not escaped again.

    Every function here escapes plain text, so names from configurations and logs cannot inject markup.
    """

    __slots__ = ()


def safe(text: str) -> Html:
    """Return text as HTML: plain text with `&`, `<`, `>` and quotes escaped, HTML unchanged."""
    return text if isinstance(text, Html) else Html(escape(text))


def document(title: str, parts: Sequence[Html]) -> str:
    """Return a whole page with its style sheet inside.

    Args:
        title: Title of the window, plain text.
        parts: Header and sections.
    """
    style = resources.files(__package__).joinpath("page.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(parts)
        + "\n</main>\n</body>\n</html>\n"
    )


def section(title: str, *parts: Html) -> Html:
    """Return a part of the page under a heading; empty parts are left out, as is a section without any.

    Heading and first part stay together on paper.
    """
    shown = [part for part in parts if part]
    if not shown:
        return Html("")
    begin = f'<section><div class="kept"><h2>{escape(title)}</h2>\n{shown[0]}</div>'  # on paper on one page
    return Html("\n".join([begin, *shown[1:], "</section>"]))


def paragraph(text: str, kind: str = "") -> Html:
    """Return a paragraph; `kind` is a class of the style sheet, such as `note`."""
    return Html(f'<p class="{kind}">{safe(text)}</p>' if kind else f"<p>{safe(text)}</p>")


def figure(svg: str, caption: str, narrow: str = "") -> Html:
    """Return a drawing with its caption.

    Args:
        svg: The drawing.
        caption: Plain text or HTML.
        narrow: The same drawing for a phone; without it the wide one is scrolled there.
    """
    drawn = f'<div class="wide">{svg}</div>'
    if narrow:
        drawn = f'<div class="broad">{svg}</div><div class="narrow">{narrow}</div>'
    return Html(f"<figure>{drawn}<figcaption>{safe(caption)}</figcaption></figure>")


def table(
    heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = (), *, stacked: bool = False
) -> Html:
    """Return a table; empty without rows.

    Args:
        heads: Names of the columns.
        rows: Cells, plain text or HTML.
        numbers: Columns that are set to the right.
        stacked: On a phone each row is a card, headed by its first cell; the others have their heads.
    """
    if not rows:
        return Html("")

    def line(tag: str, cells: Sequence[str]) -> str:
        html = []
        for i, cell in enumerate(cells):
            kind = ' class="n"' if i in numbers else ""
            head = f' data-head="{escape(heads[i])}"' if stacked and i and heads[i] and tag == "td" else ""
            html.append(f"<{tag}{kind}{head}>{safe(cell)}</{tag}>")
        return "".join(html)

    body = "\n".join(f"<tr>{line('td', row)}</tr>" for row in rows)
    head = f"<thead><tr>{line('th', heads)}</tr></thead>"
    kind = ' class="stacked"' if stacked else ""
    return Html(f'<div class="wide"><table{kind}>{head}\n<tbody>\n{body}\n</tbody></table></div>')


def tiles(facts: Sequence[tuple[str, str]]) -> Html:
    """Return a few facts side by side, each a name with a value."""
    cells = "".join(f"<div><dt>{safe(name)}</dt><dd>{safe(value)}</dd></div>" for name, value in facts)
    return Html(f'<dl class="tiles">{cells}</dl>')


def code(text: str) -> Html:
    """Return a name in the type of a configuration, escaped."""
    return Html(f"<code>{escape(text)}</code>")


def command(text: str) -> Html:
    """Return a command on a line of its own, to be copied into a terminal."""
    return Html(f'<pre class="command">{escape(text)}</pre>')


def share(part: float) -> Html:
    """Return a part of one as a bar with its percentage; the bar ends at 0 and at 100 %."""
    width = 100 * min(max(part, 0.0), 1.0)
    text = f"{100 * part:.0f}".replace("-", "−")
    return Html(f'<span class="bar"><i style="width:{width:.0f}%"></i></span> {text}&nbsp;%')
