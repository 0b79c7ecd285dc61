"""Time zones: their offset from UTC, and the hour that a clock shows twice in autumn."""

from __future__ import annotations

import datetime
import re
from zoneinfo import ZoneInfo, available_timezones

import numpy as np

from observer.frames import BoolArray, FloatArray

ABBREVIATIONS_H = {
    **{"Z": 0, "UTC": 0, "GMT": 0, "MEZ": 1, "CET": 1, "MESZ": 2, "CEST": 2, "EET": 2, "EEST": 3, "JST": 9},
    **{"EST": -5, "EDT": -4, "MST": -7, "MDT": -6, "PST": -8, "PDT": -7},
}
"""Hours ahead of UTC of zones whose abbreviation has one meaning; CST and IST have several."""
_HEADER_ZONE = re.compile(r"(?:UTC|GMT)\s*[+-]\s*\d{1,2}(?::?\d{2})?|[A-Z]{3,4}|[A-Z][a-z]+/[A-Z][A-Za-z_]+")


def offset_ns(zone: str) -> int | None:
    """Return how far a zone is ahead of UTC, in ns: `GMT-05:00`, `+0100`, `CEST`.

    Returns:
        The offset, 0 for an empty text; None if it is not understood, as an abbreviation with several
            meanings.
    """
    written = zone.replace(" ", "").upper()
    if written in ABBREVIATIONS_H or not written:
        return ABBREVIATIONS_H.get(written, 0) * 3_600_000_000_000
    match = re.fullmatch(r"(?:UTC|GMT)?([+-])(\d{1,2}):?(\d{2})?", written)
    if match is None:
        return None
    minutes = 60 * int(match[2]) + int(match[3] or 0)
    return (-minutes if match[1] == "-" else minutes) * 60_000_000_000


def zone_in(name: str) -> str:
    """Return the zone in a column's name, such as `GMT-05:00` or `Europe/Berlin`; empty for none."""
    for match in _HEADER_ZONE.finditer(name):
        if offset_ns(match[0]) is not None or ("/" in match[0] and match[0] in available_timezones()):
            return match[0]
    return ""


def localised(wall_s: FloatArray, zone: str) -> FloatArray:
    """Return wall-clock times converted from their zone to UTC.

    The repeated hour in autumn is taken as the first one until the clock goes back.

    Args:
        wall_s: Times (n,), in s since 1970 as if in UTC; NaN stays NaN.
        zone: An IANA name.
    """
    place, is_finite = ZoneInfo(zone), np.isfinite(wall_s)
    quarters = np.where(is_finite, np.floor(np.where(is_finite, wall_s, 0.0) / 900.0), 0).astype(np.int64)
    unique, back = np.unique(quarters, return_inverse=True)
    offsets = np.array([[_offset_s(int(q) * 900, place, fold) for fold in (0, 1)] for q in unique])[back]
    twice = offsets[:, 0] > offsets[:, 1]
    fold = np.zeros(len(wall_s), np.int64)
    if twice.any():
        went_back = np.concatenate([[False], np.diff(wall_s) < -1800.0])
        fold = np.where(twice & (np.cumsum(went_back & twice) > 0), 1, 0)
    return np.asarray(wall_s - offsets[np.arange(len(wall_s)), fold])


def in_repeated_hour(wall_s: FloatArray, zone: str) -> BoolArray:
    """Return which wall-clock times (n,) the zone's clock shows twice, when summer time ends.

    Args:
        wall_s: Finite times (n,), in s since 1970 as if in UTC.
        zone: An IANA name.
    """
    place, quarters = ZoneInfo(zone), np.floor(wall_s / 900.0).astype(np.int64)
    unique, back = np.unique(quarters, return_inverse=True)
    offsets = [[_offset_s(int(quarter) * 900, place, fold) for fold in (0, 1)] for quarter in unique]
    return np.asarray(np.array([first > second for first, second in offsets], bool)[back])


def _offset_s(wall_s: int, place: ZoneInfo, fold: int) -> float:
    """Return the zone's offset from UTC in s at a wall-clock time; `fold` selects the repeated hour."""
    moment = datetime.datetime(1970, 1, 1) + datetime.timedelta(seconds=wall_s)
    offset = moment.replace(tzinfo=place, fold=fold).utcoffset()
    return 0.0 if offset is None else offset.total_seconds()
