"""SHDR of MTConnect adapters: a time, then names and values in turn, separated by bars."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa

from observer.intake.sheets import RawColumn, Sheet

_LINE = re.compile(r"^\d{4}-\d{2}-\d{2}T[\d:.]+Z?(?:@[\d.]+)?\|[^|]+\|")
_LEVELS = frozenset({"NORMAL", "WARNING", "FAULT", "UNAVAILABLE"})
_CONDITION_CELLS = 6


def recognises(text: str) -> bool:
    """Return whether a text is the output of an adapter; lines that begin with `*` are commands.

    The first 20 lines decide.
    """
    lines = [line for line in text[:20_000].split("\n") if line and not line.startswith("*")][:20]
    return bool(lines) and all(_LINE.match(line) for line in lines[:-1] or lines)


def read(path: Path, text: str) -> list[Sheet]:
    """Read the output of an adapter as one sheet with one value in a row: `time`, `name`, `value`.

    Conditions, and lines that are not SHDR, are left out, which is a doubt. A name's device before `:` is
    dropped.
    """
    times, names, values, lines = list[str](), list[str](), list[str](), list[int]()
    conditions, unread_lines = 0, list[int]()
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip() or line.startswith("*"):
            continue
        time, *cells = line.strip().split("|")
        if not _LINE.match(line):
            unread_lines.append(number)
        elif is_condition(cells):
            conditions += 1
        else:
            for name, value in _pairs(cells):
                times.append(time.partition("@")[0])
                names.append(name.rpartition(":")[2])
                values.append(value)
                lines.append(number)
    doubts = [f"{conditions} conditions were left out"] if conditions else []
    if unread_lines:
        doubts.append(
            f"{len(unread_lines)} lines are not SHDR and were left out, the first is line {unread_lines[0]}"
        )
    columns = (
        RawColumn("time", pa.array(times, pa.string())),
        RawColumn("name", pa.array(names, pa.string())),
        RawColumn("value", pa.array(values, pa.string())),
    )
    return [Sheet(path, "", columns, lines=np.array(lines, np.int64), doubts=tuple(doubts))]


def is_condition(cells: list[str]) -> bool:
    """Return whether the cells after a time are those of one condition: name, level, and four more."""
    return (
        len(cells) == _CONDITION_CELLS
        and cells[1].upper() in _LEVELS
        and (cells[2:] == [""] * 4 or not _is_number(cells[3]))
    )


def _is_number(cell: str) -> bool:
    return bool(re.fullmatch(r"[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?", cell.strip()))


def _pairs(cells: list[str]) -> Iterator[tuple[str, str]]:
    """Yield names and values of a line; a last cell without a partner is left out."""
    return ((name, value) for name, value in zip(cells[::2], cells[1::2], strict=False) if name)
