"""Whether the times of a log can be seconds: milliseconds are numbers like any other."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from observer.errors import LogError
from observer.frames import FloatArray

LATEST_S = 1e11
"""The year 5138; an epoch in milliseconds is beyond it from 1973 on."""
_UNITS = ((1e17, "nanoseconds", 1e9), (1e14, "microseconds", 1e6), (LATEST_S, "milliseconds", 1e3))
"""From which time on it is in such a unit since 1970, and how many of them a second has."""
MINUTE_S, HOUR_S, DAY_S = 60.0, 3600.0, 86_400.0


def refuse_other_units(path: Path, column: str, time_s: FloatArray, rows_apart_s: float) -> None:
    """Raise `LogError` where times (n,) are an epoch in another unit, or half of the rows are further apart
    than `rows_apart_s`, as those of a log in milliseconds are.
    """
    last_s = float(np.max(np.abs(time_s)))
    for least, unit, per_s in _UNITS:
        if last_s > least:
            raise LogError(
                f"{path}: {column} says {last_s:.6g}, which looks like {unit} since 1970 where seconds are "
                f"expected; divide the column by {per_s:.0e}".replace("e+0", "e")
            )
    apart_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    if apart_s > rows_apart_s:
        raise LogError(
            f"{path}: by {column} the rows are {_long(apart_s)} apart and the log lasts "
            f"{_long(float(time_s[-1] - time_s[0]))}, which looks like milliseconds where seconds are "
            f"expected; divide the column by 1000, or, if they really are so far apart, say [log] "
            f"rows_apart_s = {1.5 * apart_s:.2g} in the configuration"
        )


def _long(time_s: float) -> str:
    for unit_s, unit in ((DAY_S, "days"), (HOUR_S, "h"), (MINUTE_S, "min")):
        if time_s >= 2.0 * unit_s:
            return f"{time_s / unit_s:.3g} {unit}"
    return f"{time_s:.3g} s"
