"""Headers that are repeated within a table, as where a recorder was started again."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from observer.files.log_checks import MOST_LISTED
from observer.intake.layout import is_header, is_missing, is_value

_BEGINS_AS_VALUE = r"^\s*[\"']?[+-]?[.,]?\d"
_MOST_CHECKED = 10_000


def repeated_headers(
    candidates: Iterable[tuple[int, list[str]]], headers: Sequence[Sequence[str]], numeric: Sequence[int]
) -> tuple[list[int], list[int]]:
    """Return the rows that repeat a table's header or units, and the rows that are another header.

    Args:
        candidates: Number and cells of the rows without a number in any of the columns `numeric`. At most
            10,000 are looked at.
        headers: The rows above the table.
        numeric: Indices of the columns that hold numbers.

    Returns:
        Row numbers to leave out, and row numbers at which a second table begins.
    """
    known_headers = [[cell.strip() for cell in row] for row in headers if row]
    repeated, other = list[int](), list[int]()
    for row, cells in itertools.islice(candidates, _MOST_CHECKED if numeric and known_headers else 0):
        if any(cells[: len(header)] == header[: len(cells)] for header in known_headers):
            repeated.append(row)
        elif is_header(cells) and all(_is_name(cells[k]) for k in numeric):
            other.append(row)
    return repeated, other


def rows_of_text(columns: Sequence[Any], numeric: Sequence[int]) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows of Arrow columns in which no cell of the columns `numeric` begins as a number does.

    Args:
        columns: Columns of strings, all of one length.
        numeric: Indices of the columns that hold numbers.

    Yields:
        The row's number from 0, and its cells without blanks around them.
    """
    import pyarrow.compute as pc  # noqa: PLC0415 - slow to import, and the daemon reads no log

    texts = np.ones(len(columns[0]), bool)
    for k in numeric:
        valued = pc.fill_null(pc.match_substring_regex(columns[k], _BEGINS_AS_VALUE), fill_value=False)
        texts &= ~np.asarray(valued.to_numpy(zero_copy_only=False))
    for row in np.flatnonzero(texts).tolist():
        yield row, [(column[row].as_py() or "").strip() for column in columns]


def _is_name(cell: str) -> bool:
    return not is_value(cell) and not is_missing(cell)


def headers_left_out(lines: Sequence[int]) -> list[str]:
    """Return the doubt about lines that repeat the header, as a list of at most one sentence."""
    if not lines:
        return []
    shown = ", ".join(map(str, lines[:MOST_LISTED])) + (", …" if len(lines) > MOST_LISTED else "")
    noun, verb = ("line", "was") if len(lines) == 1 else ("lines", "were")
    return [f"the header is repeated in {noun} {shown}, which {verb} left out"]


def another_header(line: int) -> str:
    """Return the error about a second table below the first one, which begins in `line`."""
    return f"line {line} names other columns than the header; split the file there and give each part alone"


def above_the_table(lines: Sequence[int]) -> list[str]:
    """Return the doubt about lines of values above the header, as a list of at most one sentence."""
    if not lines:
        return []
    return [
        f"{len(lines)} rows of values above the header, the first in line {lines[0]}, were left out; "
        "set [log] skip_rows if they belong to the table"
    ]
