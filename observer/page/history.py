"""Recordings: the list of files, and minimum, mean and maximum of each channel over a span.

The files are long. Only the requested rows are read, a block at a time, so memory depends neither on the size
of a file nor on that of a span. Reading a day takes longer than a viewer waits, so a `Digest` keeps minimum,
maximum, sum and count of each channel in bins of seconds or minutes. It grows until a time limit, and
continues at the next request, also from the end of a file that has grown meanwhile.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.files.logs import TIME
from observer.kernels import read_rows
from observer.record.spans import Recorded, channels_of, header, offset

_MARGIN_S = 30.0
"""Rows stand in the order of their use, so their times may go back a little."""
_BINS = 2.0
"""A part shorter than this many bins is read from the file itself."""
_PATIENCE_S = 0.35
"""Reading time of a request before it answers with what there is; comparing days takes two requests."""
MOST_POINTS = 2000
_LEAST_S, _MOST_S = 1e-3, 1e11  # of a span; of a time, which is the year 5138
_BLOCK_BYTES = 1 << 19
FINE_S, COARSE_S = 5.0, 300.0
_MOST_BYTES = 24 << 20
"""Of all bins together: fine ones of a week of a machine with a dozen channels, coarse ones of a year."""
_MERGED = 64
Values = NDArray[np.floating[Any]]


class ChannelBins(NamedTuple):
    """Least, most, sum and number of the values of each channel in each of n bins, (n, channels) each."""

    least: Values
    most: Values
    total: Values
    number: Values

    @classmethod
    def of(cls, values: Values) -> ChannelBins:
        """Make each row (n, channels) a bin of its own; a NaN counts as missing."""
        has_value = np.isfinite(values)
        return cls(values, values, np.where(has_value, values, 0.0), has_value.astype(np.float32))

    def at(self, rows: slice | NDArray[Any]) -> ChannelBins:
        """Some of the bins."""
        return ChannelBins(*(column[rows] for column in self))

    def as_type(self, kind: type[np.floating[Any]]) -> ChannelBins:
        """The same in other floats."""
        return ChannelBins(*(column.astype(kind) for column in self))


_Timed = tuple[NDArray[np.float64], ChannelBins]


def history(
    files: list[Recorded],
    from_s: float,
    to_s: float,
    points: int,
    digests: Digests | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> dict[str, Any]:
    """Minimum, mean and maximum of each channel in each of `points` equal parts of a span.

    Returns `{"from_s", "to_s", "read", "notes", "time_s", "channels"}`. `notes` are sentences about damaged
    files, `time_s` is the middle of each part. `channels` has, by name, `least`, `mean` and `most`, with None
    for a part without a reading. Long parts consist of the bins of `digests`. A bin belongs to the part that
    has its middle. The call ends after 0.35 s, and the next one continues. `read` is the share read so far.
    Raises `ValueError` for an invalid span.
    """
    if not (-_MOST_S <= from_s <= to_s - _LEAST_S < to_s <= _MOST_S and 1 <= points <= MOST_POINTS):
        raise ValueError(
            f"no span: give from < to in seconds since 1970, up to {_MOST_S:g}, and 1 to {MOST_POINTS} points"
        )
    overlapping = [f for f in files if f.to_s + _MARGIN_S >= from_s and f.from_s - _MARGIN_S <= to_s]
    parts, part_s, read = _Parts(points), (to_s - from_s) / points, 1.0
    notes = set[str]()
    if part_s < _BINS * FINE_S or digests is None:
        for file in overlapping:
            with suppress(OSError):  # it has been removed meanwhile
                for names, rows in _rows(file.path, from_s, to_s, notes):
                    parts.take(names, rows, from_s, part_s)
    else:
        bin_s = COARSE_S if part_s >= _BINS * COARSE_S else FINE_S
        grown, read = _grow(digests, overlapping, bin_s, clock() + _PATIENCE_S, clock)
        for digest in grown:
            notes |= digest.notes
            parts.take(digest.channels, digest.bins_between(from_s, to_s), from_s, part_s)
        digests.tidy((file.path, bin_s) for file in overlapping)
    middle_s = from_s + (np.arange(points) + 0.5) * part_s
    return {
        "from_s": from_s,
        "to_s": to_s,
        "read": read,
        "notes": sorted(notes),
        "time_s": np.round(middle_s, 3).tolist(),
        "channels": parts.document(),
    }


class _Parts:
    """Minimum, mean and maximum of each channel in each part."""

    def __init__(self, points: int) -> None:
        self._points = points
        self._totals: dict[str, NDArray[np.float64]] = {}

    def take(self, names: list[str], rows: _Timed, from_s: float, part_s: float) -> None:
        """Take times (n), and the bins at each of them."""
        time_s, bins = rows
        part = np.floor((time_s - from_s) / part_s)
        in_span = (part >= 0) & (part < self._points)  # false for NaN
        if not in_span.any():
            return
        keys, bins = merged(part[in_span].astype(np.int64), bins.at(in_span))
        empty = np.array([[np.nan], [np.nan], [0.0], [0.0]])
        for k, name in enumerate(names):
            if name not in self._totals:
                self._totals[name] = np.repeat(empty, self._points, axis=1)
            low, high, total, count = self._totals[name]
            low[keys] = np.fmin(low[keys], bins.least[:, k])
            high[keys] = np.fmax(high[keys], bins.most[:, k])
            total[keys] += bins.total[:, k]
            count[keys] += bins.number[:, k]

    def document(self) -> dict[str, dict[str, list[float | None]]]:
        """By channel, for JSON; channels without any value are left out."""
        ranges = {}
        for name, (least, most, total, count) in self._totals.items():
            if count.any():
                mean = np.divide(total, count, out=np.full(self._points, np.nan), where=count > 0)
                ranges[name] = {
                    "least": _json_values(least),
                    "mean": _json_values(mean),
                    "most": _json_values(most),
                }
        return ranges


def _json_values(values: NDArray[np.float64]) -> list[float | None]:
    # the bins of days are kept in half the bytes, which is some seven digits
    return [float(f"{x:.7g}") if math.isfinite(x) else None for x in values.tolist()]


def _grow(
    digests: Digests, files: list[Recorded], bin_s: float, until_s: float, clock: Callable[[], float]
) -> tuple[list[Digest], float]:
    """Continue reading, newest file first, until all is read or the time is over; returns the share read."""
    grown, sizes, read = [], 0, 0
    for file in reversed(files):
        try:
            digest, size = digests.of(file.path, bin_s), file.path.stat().st_size
            if clock() < until_s and digest.end < size:
                for _ in digest.grow():
                    if clock() >= until_s:
                        break
                else:
                    size = digest.end  # what is left is a row that is being written
            sizes, read = sizes + size, read + min(digest.end, size)
            grown.append(digest)
        except OSError:
            continue  # it has been removed meanwhile
    return grown, read / sizes if sizes else 1.0


def _too_long(path: Path) -> str:
    return (
        f"{path.name} has a line of more than {_BLOCK_BYTES >> 10} kB, which is left out; the file is damaged"
    )


def _rows(path: Path, from_s: float, to_s: float, notes: set[str]) -> Iterator[tuple[list[str], _Timed]]:
    """The channels' names, and the rows around a span, a block of the file at a time."""
    columns, begin = header(path)
    names = channels_of(columns)
    for block in blocks(path, columns, offset(path, begin, from_s - _MARGIN_S)):
        if block.is_too_long:
            notes.add(_too_long(path))
        yield names, (block.time_s, ChannelBins.of(block.values))
        if len(block.time_s) and block.time_s[-1] > to_s + _MARGIN_S:
            return


@dataclass(frozen=True, slots=True)
class RowBlock:
    """Some rows: their times (n), a column for each channel (n, channels), and where the next row begins.

    There may be none; `is_too_long` says that a line goes on there which is too long to be a row.
    """

    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    end: int
    is_too_long: bool


def blocks(path: Path, columns: list[str], begin: int) -> Iterator[RowBlock]:
    """The rows from a place in the file on; damaged ones are left out. Raises `OSError`."""
    read_columns = [TIME, *channels_of(columns)]
    place = np.array([read_columns.index(name) if name in read_columns else -1 for name in columns], np.intp)
    with path.open("rb") as file:
        file.seek(begin - 1)
        is_within_line = file.read(1) != b"\n"  # of a line that is too long: here the last reader stopped
        end, rest = begin, b""
        while data := file.read(_BLOCK_BYTES):
            if is_within_line:
                tail, newline, data = data.partition(b"\n")
                end += len(tail) + len(newline)
                is_within_line = not newline
            rows, newline, rest = (rest + data).rpartition(b"\n")
            end += len(rows) + len(newline)
            if len(rest) >= _BLOCK_BYTES:
                end, rest, is_within_line = end + len(rest), b"", True
            table = np.empty((rows.count(b"\n") + 1, len(read_columns)))
            count = read_rows(rows + newline, place, table) if newline else 0
            yield RowBlock(table[:count, 0], table[:count, 1:], end, is_within_line)


def merged(keys: NDArray[np.int64], bins: ChannelBins) -> tuple[NDArray[np.int64], ChannelBins]:
    """The bins with the same key as one; NaN where none has a value."""
    if np.any(keys[1:] < keys[:-1]):
        order = np.argsort(keys, kind="stable")
        keys, bins = keys[order], bins.at(order)
    first = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
    ways = (np.fmin, np.fmax, np.add, np.add)
    return keys[first], ChannelBins(*(way.reduceat(c, first) for way, c in zip(ways, bins, strict=True)))


class Digest:
    """Each channel of a file in bins, as far as it has been read."""

    def __init__(self, path: Path, bin_s: float) -> None:
        self._path, self._bin_s = path, bin_s
        self._columns, self.end = header(path)
        self.inode = path.stat().st_ino
        self.channels = channels_of(self._columns)
        self._parts: list[tuple[NDArray[np.int64], ChannelBins]] = []
        self.notes = set[str]()

    def grow(self) -> Iterable[None]:
        """Take what has not been read yet, a block at each step."""
        for block in blocks(self._path, self._columns, self.end):
            is_timed = np.isfinite(block.time_s)
            keys = np.floor(block.time_s[is_timed] / self._bin_s).astype(np.int64)
            if keys.size:
                keys, bins = merged(keys, ChannelBins.of(block.values[is_timed]))
                self._parts.append((keys, bins.as_type(np.float32)))
            if len(self._parts) > _MERGED:
                self._merge()
            if block.is_too_long:
                self.notes.add(_too_long(self._path))
            self.end = block.end
            yield

    def _merge(self) -> None:
        keys = np.concatenate([keys for keys, _ in self._parts])
        columns = zip(*(bins for _, bins in self._parts), strict=True)
        self._parts = [merged(keys, ChannelBins(*(np.concatenate(column) for column in columns)))]

    def bins_between(self, from_s: float, to_s: float) -> _Timed:
        """Centres (n) of the bins in a span, and the bins."""
        if not self._parts:
            return np.empty(0), ChannelBins(*[np.empty((0, 0))] * 4)
        if len(self._parts) > 1:
            self._merge()
        keys, bins = self._parts[0]
        middle_s = (keys.astype(np.float64) + 0.5) * self._bin_s
        in_span = slice(*np.searchsorted(middle_s, [from_s, to_s]))
        return middle_s[in_span], bins.at(in_span).as_type(np.float64)

    @property
    def size(self) -> int:
        """Bytes."""
        return sum(keys.nbytes + sum(column.nbytes for column in bins) for keys, bins in self._parts)


class Digests:
    """The digests of the files viewed last."""

    def __init__(self, most_bytes: int = _MOST_BYTES) -> None:
        self._digests: dict[tuple[Path, float], Digest] = {}
        self._most_bytes = most_bytes

    def of(self, path: Path, bin_s: float) -> Digest:
        """The digest of a file, new where it is another file than before. Raises `OSError`."""
        status, digest = path.stat(), self._digests.pop((path, bin_s), None)
        if digest is None or digest.inode != status.st_ino or digest.end > status.st_size:
            digest = Digest(path, bin_s)
        self._digests[path, bin_s] = digest  # the last in the order
        return digest

    def tidy(self, in_use: Iterable[tuple[Path, float]]) -> None:
        """Drop digests beyond the limit, oldest first and none in use, and those of removed files."""
        keep, in_all = set(in_use), sum(digest.size for digest in self._digests.values())
        for key, digest in list(self._digests.items()):
            if not os.path.lexists(key[0]) or (in_all > self._most_bytes and key not in keep):
                in_all -= digest.size
                del self._digests[key]
