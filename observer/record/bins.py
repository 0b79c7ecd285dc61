"""Minimum, mean and maximum of each channel in equal parts of a span, for the page."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.errors import LogError
from observer.record.step_files import StepFile, read_columns
from observer.record.step_store import Past

_BIN_S = 60.0
_MOST_HOURS = 1500
_PATIENCE_S = 0.35
"""Reading time of a request before it answers with what there is; comparing two spans takes two requests."""
MOST_POINTS = 2000
_LEAST_S, _MOST_S = 1e-3, 1e11  # of a span; of a time, which is the year 5138
Values = NDArray[np.float64]


class ChannelBins(NamedTuple):
    """Minimum, maximum, sum and number of each channel's values in n bins.

    Attributes:
        channels: Names of the c columns.
        time_s: Time of each bin, (n,).
        least: Smallest values (n, c), NaN where a bin has none.
        most: Largest values (n, c), NaN where a bin has none.
        total: Sums (n, c).
        number: Counts of values (n, c).
    """

    channels: tuple[str, ...]
    time_s: Values
    least: Values
    most: Values
    total: Values
    number: Values

    @classmethod
    def of(cls, file: StepFile, from_s: float = -math.inf, to_s: float = math.inf) -> ChannelBins:
        """Return each step of a file as a bin of its own; a missing value has the number 0.

        Args:
            file: Its channels are the columns.
            from_s: First time.
            to_s: End, itself excluded.

        Raises:
            LogError: The file is damaged.
            FileNotFoundError: The file is gone.
        """
        channels, (time_s, *columns) = read_columns(file, from_s, to_s)
        values = np.column_stack(columns) if columns else np.empty((len(time_s), 0))
        has_value = np.isfinite(values)
        total = np.where(has_value, values, 0.0)
        return cls(channels, time_s, values, values, total, has_value.astype(float))

    def merged(self, keys: NDArray[np.int64], time_s: NDArray[Any] | None = None) -> ChannelBins:
        """Return one bin for all of each key.

        Args:
            keys: A key for each bin, ascending, (n,).
            time_s: Times of the new bins; None for the first time of each.
        """
        first = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
        ways = (np.fmin, np.fmax, np.add, np.add)
        merged = [way.reduceat(column, first) for way, column in zip(ways, self[2:], strict=True)]
        return ChannelBins(self.channels, self.time_s[first] if time_s is None else time_s, *merged)


def history(
    past: Past | None, from_s: float, to_s: float, points: int, clock: Callable[[], float] = time.monotonic
) -> dict[str, Any]:
    """Return minimum, mean and maximum of each channel in each of `points` equal parts of a span.

    Long parts consist of bins of a minute, which stay in memory. The call ends after 0.35 s, and the next one
    continues.

    Args:
        past: The published steps; None for a service without recordings.
        from_s: First time, s since 1970.
        to_s: End.
        points: Number of parts, up to 2000.
        clock: Measures the time spent, in s.

    Returns:
        `from_s`, `to_s`, `read`, `notes`, `time_s` and `channels`. `read` is the share of the files read so
            far. `notes` are sentences about damaged files, `time_s` is the middle of each part. `channels`
            has, by name, `least`, `mean` and `most`, with None for a part without a value.

    Raises:
        ValueError: The span or the number of points is invalid.
        LogError: The folder cannot be read.
    """
    if not (-_MOST_S <= from_s <= to_s - _LEAST_S < to_s <= _MOST_S and 1 <= points <= MOST_POINTS):
        raise ValueError(
            f"no span: give from < to in seconds since 1970, up to {_MOST_S:g}, and 1 to {MOST_POINTS} points"
        )
    files = [file for file in (past.files() if past else ()) if file.from_s < to_s and file.to_s > from_s]
    parts, part_s, end_s, files_read, notes = (
        _Parts(points),
        (to_s - from_s) / points,
        clock() + _PATIENCE_S,
        0,
        set(),
    )
    for file in reversed(files):
        try:
            is_long = part_s >= 2 * _BIN_S and file.is_packed
            parts.take(_minutes(file) if is_long else ChannelBins.of(file, from_s, to_s), from_s, part_s)
        except FileNotFoundError:
            pass  # packed or removed meanwhile
        except LogError as error:
            notes.add(f"{error}; it is left out")
        files_read += 1
        if clock() >= end_s:
            break
    middle_s = from_s + (np.arange(points) + 0.5) * part_s
    return {
        "from_s": from_s,
        "to_s": to_s,
        "read": files_read / len(files) if files else 1.0,
        "notes": sorted(notes),
        "time_s": np.round(middle_s, 3).tolist(),
        "channels": parts.document(),
    }


@lru_cache(maxsize=_MOST_HOURS)
def _minutes(file: StepFile) -> ChannelBins:
    """Return the bins of a minute of a packed file, which does not change; the time is the middle of each."""
    steps = ChannelBins.of(file)
    keys = np.floor(steps.time_s / _BIN_S).astype(np.int64)
    return steps.merged(keys, (np.unique(keys) + 0.5) * _BIN_S) if len(keys) else steps


class _Parts:
    """Minimum, maximum, sum and count of each channel in each part of a span."""

    def __init__(self, points: int) -> None:
        self._points = points
        self._totals: dict[str, Values] = {}

    def take(self, bins: ChannelBins, from_s: float, part_s: float) -> None:
        """Add bins, each to the part that has its time."""
        part = np.floor((bins.time_s - from_s) / part_s)
        in_span = (part >= 0) & (part < self._points)
        if not in_span.any():
            return
        keys = part[in_span].astype(np.int64)
        chosen = ChannelBins(bins.channels, *(column[in_span] for column in bins[1:])).merged(keys)
        keys = np.unique(keys)
        empty = np.array([[np.nan], [np.nan], [0.0], [0.0]])
        for k, name in enumerate(bins.channels):
            if name not in self._totals:
                self._totals[name] = np.repeat(empty, self._points, axis=1)
            low, high, total, count = self._totals[name]
            low[keys] = np.fmin(low[keys], chosen.least[:, k])
            high[keys] = np.fmax(high[keys], chosen.most[:, k])
            total[keys] += chosen.total[:, k]
            count[keys] += chosen.number[:, k]

    def document(self) -> dict[str, dict[str, list[float | None]]]:
        """Return the parts by channel, for JSON; channels without any value are left out."""
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


def _json_values(values: Values) -> list[float | None]:
    return [float(f"{x:.7g}") if math.isfinite(x) else None for x in values.tolist()]
