"""The tables of a first configuration as text: values with comments beside them, which teach the keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import tomlkit


class Note(NamedTuple):
    """A value with the comment beside it."""

    value: object
    comment: str


class FileTable(NamedTuple):
    """A table of the file: its header with a comment, and its keys."""

    header: str
    keys: Mapping[str, object]
    comment: str = ""


def as_text(part: FileTable) -> str:
    """Return a table as lines of the file."""
    lines = [_line(part.header, part.comment)]
    for key, entry in part.keys.items():
        value, comment = entry if isinstance(entry, Note) else (entry, "")
        lines.append(_line(f"{key} = {tomlkit.item(value).as_string()}", comment))
    return "\n".join(lines) + "\n"


def _line(text: str, comment: str) -> str:
    return f"{text:<32} # {comment}" if comment else text


def inline(entries: Mapping[str, object]) -> object:
    """Return a table to be written in one line."""
    table = tomlkit.inline_table()
    table.update(entries)
    return table
