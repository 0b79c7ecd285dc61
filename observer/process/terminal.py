"""Text for people in a terminal, in which names from files cannot command it."""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

_COMMANDING = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""The categories of characters that command a terminal or the order of a text."""


def printable(text: str) -> str:
    """Return a text in which control characters, but line breaks and tabs, are written as escapes.

    A name in a file can hold a terminal's commands, or characters that reverse the order of the text after
    them.
    """
    return "".join(
        character.encode("unicode_escape", "surrogatepass").decode("ascii")
        if unicodedata.category(character) in _COMMANDING and character not in "\n\t"
        else character
        for character in text
    )


def readable_json(document: Any, **options: Any) -> str:
    """Return a document as JSON in which `µm` stays as it is; only control characters are escapes.

    `options` are those of `json.dumps`.
    """
    return "".join(
        json.dumps(character)[1:-1]
        if unicodedata.category(character) in _COMMANDING and character != "\n"
        else character
        for character in json.dumps(document, ensure_ascii=False, **options)
    )


def echo(text: str, *, err: bool = False) -> None:
    """Print a text for people; what cannot be printed appears as escapes."""
    typer.echo(printable(text), err=err)


def print_for_people(text: RenderableType) -> None:
    """Print a table or a text of rich, which names from files cannot style; control characters become
    escapes.
    """
    printable_console().print(text)


def printable_console() -> Console:
    """Return a console of rich that writes control characters of a text as escapes, and highlights
    nothing.
    """
    from rich.console import Console
    from rich.segment import Segment

    class PrintableConsole(Console):
        def render(self, *arguments: Any, **options: Any) -> Iterator[Segment]:
            for segment in super().render(*arguments, **options):
                yield segment._replace(text=printable(segment.text)) if not segment.control else segment

    return PrintableConsole(highlight=False)
