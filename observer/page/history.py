"""What has been recorded: which files there are, and the least and the most of each channel over a span."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.errors import LogError
from observer.page.rows import (
    COARSE_S,
    FINE_S,
    Digest,
    Digests,
    Values,
    blocks,
    channels_of,
    ends,
    extremes,
    header,
    offset,
)

_STAMPED = r"-\d{8}T\d{6}Z[^/]*\.csv"
"""How the recorder names a file after its machine and axis; what somebody has appended to it may stay."""
_MARGIN_S = 30.0
"""Rows stand in the order of their use, so their times may go back a little."""
_BINS = 2.0
"""A part that is shorter than so many bins is read from the file itself."""
_PATIENCE_S = 0.35
"""So long a request may read before it answers with what there is; to compare days two are asked for."""
MOST_POINTS = 2000
_LEAST_S, _MOST_S = 1e-3, 1e11  # of a span; of a time, which is the year 5138
_Extremes = tuple[NDArray[np.float64], Values, Values]


@dataclass(frozen=True, slots=True)
class Recorded:
    """A file of a recording: its name, and the times of its first and last row in s since 1970."""

    path: Path
    from_s: float
    to_s: float


def recordings(folder: Path, name: str) -> list[Recorded]:
    """The files of an axis in the order of their time; raises `LogError` where the folder is not readable."""
    own = re.compile(re.escape(name) + _STAMPED)
    try:
        paths = sorted(
            path for path in folder.glob(f"{name}*") if own.fullmatch(path.name) and path.is_file()
        )
    except OSError as error:
        raise LogError(f"{folder}: cannot be read ({error.strerror}); fix record.directory") from None
    found = []
    for path in paths:
        try:
            times_s = ends(path)
        except OSError:
            continue  # it has been removed meanwhile
        if times_s is not None:
            found.append(Recorded(path, *times_s))
    return sorted(found, key=lambda recorded: recorded.from_s)


def history(
    files: list[Recorded],
    from_s: float,
    to_s: float,
    points: int,
    digests: Digests | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> dict[str, Any]:
    """The least and the most of each channel in each of `points` equal parts of a span.

    `{"from_s", "to_s", "read", "time_s": [the middle of each part], "channels": {name: {"least", "most"}}}`;
    a part without a reading is None. Where the parts are long, they consist of bins that `digests` keeps, a
    bin belonging to the part in which its middle is; what cannot be read within 0.35 s is left to the next
    call, and `read` is the share that has been. Raises `ValueError` for a span that is none.
    """
    if not (-_MOST_S <= from_s <= to_s - _LEAST_S < to_s <= _MOST_S and 1 <= points <= MOST_POINTS):
        raise ValueError(
            f"no span: give from < to in seconds since 1970, up to {_MOST_S:g}, and 1 to {MOST_POINTS} points"
        )
    wanted = [f for f in files if f.to_s + _MARGIN_S >= from_s and f.from_s - _MARGIN_S <= to_s]
    parts, part_s, read = _Parts(points), (to_s - from_s) / points, 1.0
    if part_s < _BINS * FINE_S or digests is None:
        for file in wanted:
            with suppress(OSError):  # it has been removed meanwhile
                for names, found in _rows(file.path, from_s, to_s):
                    parts.take(names, found, from_s, part_s)
    else:
        bin_s = COARSE_S if part_s >= _BINS * COARSE_S else FINE_S
        grown, read = _grow(digests, wanted, bin_s, clock() + _PATIENCE_S, clock)
        for digest in grown:
            parts.take(digest.channels, digest.bins(bin_s).within(from_s, to_s), from_s, part_s)
        digests.tidy(file.path for file in wanted)
    middle_s = from_s + (np.arange(points) + 0.5) * part_s
    return {
        "from_s": from_s,
        "to_s": to_s,
        "read": read,
        "time_s": np.round(middle_s, 3).tolist(),
        "channels": parts.document(),
    }


class _Parts:
    """The least and the most of each channel in each part."""

    def __init__(self, points: int) -> None:
        self._points = points
        self._found: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}

    def take(self, names: list[str], found: _Extremes, from_s: float, part_s: float) -> None:
        """Take times (n), and the least and the most (n, channels) at each of them."""
        time_s, least, most = found
        part = np.floor((time_s - from_s) / part_s)
        here = (part >= 0) & (part < self._points)  # false for NaN
        if not here.any():
            return
        keys, least, most = extremes(part[here].astype(np.int64), least[here], most[here])
        for k, name in enumerate(names):
            if name not in self._found:
                self._found[name] = np.full(self._points, np.nan), np.full(self._points, np.nan)
            low, high = self._found[name]
            low[keys] = np.fmin(low[keys], least[:, k])
            high[keys] = np.fmax(high[keys], most[:, k])

    def document(self) -> dict[str, dict[str, list[float | None]]]:
        """By channel, for JSON; channels without any value are left out."""
        return {
            name: {"least": _known(least), "most": _known(most)}
            for name, (least, most) in self._found.items()
            if np.isfinite(least).any()
        }


def _known(values: NDArray[np.float64]) -> list[float | None]:
    # the bins of days are kept in half the bytes, which is some seven digits
    return [float(f"{x:.7g}") if math.isfinite(x) else None for x in values.tolist()]


def _grow(
    digests: Digests, files: list[Recorded], bin_s: float, until_s: float, clock: Callable[[], float]
) -> tuple[list[Digest], float]:
    """Read on, the newest file first, until all is read or the time is over; says which share has been."""
    grown, sizes, read = [], 0, 0
    for file in reversed(files):
        try:
            digest, size = digests.of(file.path), file.path.stat().st_size
            digest.bins(bin_s)
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


def _rows(path: Path, from_s: float, to_s: float) -> Iterator[tuple[list[str], _Extremes]]:
    """The channels' names, and the rows around a span, a block of the file at a time."""
    columns, begin = header(path)
    names = channels_of(columns)
    for block in blocks(path, columns, offset(path, begin, from_s - _MARGIN_S)):
        yield names, (block.time_s, block.values, block.values)
        if block.time_s[-1] > to_s + _MARGIN_S:
            return
