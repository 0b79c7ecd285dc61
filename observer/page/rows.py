"""The rows of a recording's file: where a time begins in it, and its channels in blocks.

The files are long; only the rows that are asked for are read, a block at a time, so that neither the size of
a file nor a span's decides how much memory is used.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.files.logs import FLAGS, LATE, STEP, TIME
from observer.kernels import read_rows

_BLOCK_BYTES = 1 << 19
_LINE_BYTES = 1 << 16
Values = NDArray[np.floating[Any]]
_OWN = {TIME, STEP, LATE, FLAGS}


@dataclass(frozen=True, slots=True)
class RowBlock:
    """Some rows: their times (n), a column for each channel (n, channels), and where the next row begins."""

    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    end: int


def header(path: Path) -> tuple[list[str], int]:
    """The names of a file's columns, and where its first row begins. Raises `OSError`."""
    with path.open("rb") as file:
        line = file.readline(_LINE_BYTES)
        return next(csv.reader([line.decode("utf-8", "replace")]), []), file.tell()


def channels_of(columns: list[str]) -> list[str]:
    """Those columns that are channels."""
    return [name for name in columns if name not in _OWN]


def blocks(path: Path, columns: list[str], begin: int) -> Iterator[RowBlock]:
    """The rows from a place in the file on; damaged ones are left out. Raises `OSError`."""
    wanted = [TIME, *channels_of(columns)]
    place = np.array([wanted.index(name) if name in wanted else -1 for name in columns], np.intp)
    with path.open("rb") as file:
        file.seek(begin)
        end, rest = begin, b""
        while data := file.read(_BLOCK_BYTES):
            rows, newline, rest = (rest + data).rpartition(b"\n")
            end += len(rows) + len(newline)
            table = np.empty((rows.count(b"\n") + 1, len(wanted)))
            count = read_rows(rows + newline, place, table)
            if count:
                yield RowBlock(table[:count, 0], table[:count, 1:], end)


def offset(path: Path, begin: int, time_s: float) -> int:
    """Where a row begins before which all are older than a time, by halving the file. Raises `OSError`."""
    with path.open("rb") as file:
        low, high = begin, path.stat().st_size
        while high - low > _LINE_BYTES:
            middle = (low + high) // 2
            file.seek(middle)
            file.readline(_LINE_BYTES)
            start = file.tell()
            found_s = _time(file.readline(_LINE_BYTES))
            if found_s is None or found_s >= time_s:
                high = middle
            else:
                low = start
    return max(begin, low)


def ends(path: Path) -> tuple[float, float] | None:
    """The times of the first and of the last whole row, None where there are none. Raises `OSError`."""
    with path.open("rb") as file:
        file.readline(_LINE_BYTES)
        first_s = _time(file.readline(_LINE_BYTES))
        file.seek(max(0, path.stat().st_size - _LINE_BYTES))
        for line in reversed(file.read(_LINE_BYTES).split(b"\n")[:-1]):
            if first_s is not None and (last_s := _time(line)) is not None:
                return first_s, max(first_s, last_s)
    return None


def extremes(
    keys: NDArray[np.int64], least: Values, most: Values
) -> tuple[NDArray[np.int64], Values, Values]:
    """The least and the most (keys, channels) of the rows with the same key; NaN where none has a value."""
    if np.any(keys[1:] < keys[:-1]):
        order = np.argsort(keys, kind="stable")
        keys, least, most = keys[order], least[order], most[order]
    first = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
    return keys[first], np.fmin.reduceat(least, first), np.fmax.reduceat(most, first)


def _time(line: bytes) -> float | None:
    """The time at the beginning of a row, None where there is none."""
    try:
        return float(line.split(b",", 1)[0])
    except ValueError:
        return None
