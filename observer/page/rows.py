"""The rows of a recording's file, and digests of them for viewers who look at days.

The files are long: only the rows asked for are read, a block at a time, so memory depends neither on the size
of a file nor on that of a span. Reading a day takes longer than a viewer waits, so a `Digest` keeps the least
and the most of each channel in bins of seconds and of minutes. It grows for as long as there is time, and
continues when it is asked again, from the end of a file that has grown meanwhile too.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
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


FINE_S = 5.0
COARSE_S = 300.0
_MOST_BYTES = 24 << 20
"""Of all fine bins together: a week of a machine with a dozen channels. A year of coarse ones is less."""
_MERGED = 64


@dataclass(slots=True)
class ExtremeBins:
    """The least and the most of each channel (n, channels) in the bins `keys` (n) of `bin_s` seconds each."""

    bin_s: float
    _parts: list[tuple[NDArray[np.int64], Values, Values]] = field(default_factory=list)

    def take(self, block: RowBlock) -> None:
        """Take the rows of a block."""
        known = np.isfinite(block.time_s)
        keys = np.floor(block.time_s[known] / self.bin_s).astype(np.int64)
        if not keys.size:
            return
        keys, least, most = extremes(keys, block.values[known], block.values[known])
        self._parts.append((keys, least.astype(np.float32), most.astype(np.float32)))
        if len(self._parts) > _MERGED:
            self._merge()

    def _merge(self) -> None:
        keys, least, most = (np.concatenate(column) for column in zip(*self._parts, strict=True))
        keys, least, most = extremes(keys, least, most)
        self._parts = [(keys, least, most)]

    def within(
        self, from_s: float, to_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The middles (n) of the bins in a span, and the least and the most (n, channels) of each."""
        if len(self._parts) > 1:
            self._merge()
        if not self._parts:
            return np.empty(0), np.empty((0, 0)), np.empty((0, 0))
        keys, least, most = self._parts[0]
        middle_s = (keys.astype(np.float64) + 0.5) * self.bin_s
        here = slice(*np.searchsorted(middle_s, [from_s, to_s]))
        return middle_s[here], least[here].astype(np.float64), most[here].astype(np.float64)

    @property
    def size(self) -> int:
        """Bytes."""
        return sum(array.nbytes for part in self._parts for array in part)


class Digest:
    """The bins of one file, as far as it has been read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._columns, self._begin = header(path)
        self.inode = path.stat().st_ino
        self.channels = channels_of(self._columns)
        self.end = self._begin
        self._fine: ExtremeBins | None = ExtremeBins(FINE_S)
        self._coarse = ExtremeBins(COARSE_S)

    def bins(self, bin_s: float) -> ExtremeBins:
        """Those of a width; the fine ones begin again where they have been dropped."""
        if bin_s == COARSE_S:
            return self._coarse
        if self._fine is None:
            self._fine, self._coarse, self.end = ExtremeBins(FINE_S), ExtremeBins(COARSE_S), self._begin
        return self._fine

    def grow(self) -> Iterable[None]:
        """Take what has not been read yet, a block at each step."""
        for block in blocks(self._path, self._columns, self.end):
            for bins in (self._fine, self._coarse):
                if bins is not None:
                    bins.take(block)
            self.end = block.end
            yield

    def drop(self) -> int:
        """Give up the fine bins; returns how many bytes that were."""
        size = self.fine_bytes
        self._fine = None
        return size

    @property
    def fine_bytes(self) -> int:
        """How much the fine bins take."""
        return 0 if self._fine is None else self._fine.size


class Digests:
    """The digests of the files that were looked at; of the fine bins those that were wanted last."""

    def __init__(self, most_bytes: int = _MOST_BYTES) -> None:
        self._digests: dict[Path, Digest] = {}
        self._most_bytes = most_bytes

    def of(self, path: Path) -> Digest:
        """The digest of a file, new where it is another file than before. Raises `OSError`."""
        about, digest = path.stat(), self._digests.pop(path, None)
        if digest is None or digest.inode != about.st_ino or digest.end > about.st_size:
            digest = Digest(path)
        self._digests[path] = digest  # the last in the order
        return digest

    def tidy(self, wanted: Iterable[Path]) -> None:
        """Drop what is too much, never of those that are wanted, and what is of files that are gone."""
        wanted = set(wanted)
        for path in [path for path in self._digests if not os.path.lexists(path)]:
            del self._digests[path]
        in_all = sum(digest.fine_bytes for digest in self._digests.values())
        for path, digest in self._digests.items():
            if in_all > self._most_bytes and path not in wanted:
                in_all -= digest.drop()
