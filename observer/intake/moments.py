"""From written times to numbers: ISO 8601, German and other dates, times without a date, any `strptime`
format.
"""

from __future__ import annotations

import datetime
import re
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.frames import BoolArray
from observer.intake.dates import ns_of, parsed
from observer.intake.zones import offset_ns

Nanoseconds = NDArray[np.int64]
NO_TIME = np.iinfo(np.int64).min
"""Stands for a cell without a time, as NaT does."""
_CLOCK = r"(?P<H>\d{1,3}):(?P<M>\d{2})(?::(?P<S>\d{2})(?:[.,:](?P<f>\d{1,9}))?)?\s*(?P<p>[AaPp]\.?[Mm]\.?)?"
_ZONE = r"\s*(?P<z>Z|(?:UTC|GMT)?\s*[+-]\d{1,2}(?::?\d{2})?|UTC|GMT|[A-Z]{3,4})?$"
_DATES = (
    r"^(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})",
    r"^(?P<d>\d{1,2})\.(?P<m>\d{1,2})\.(?P<y>\d{4}|\d{2})",
    r"^(?P<d>\d{1,2})[-. ](?P<mon>[A-Za-zäÄ]{3,9})\.?[-. ](?P<y>\d{4}|\d{2})",
    r"^(?P<y>\d{4})(?P<m>\d{2})(?P<d>\d{2})",
)
_MOST_FALLBACK = 200_000
_SLASHED = r"^(?P<a>\d{1,2})[/-](?P<b>\d{1,2})[/-](?P<y>\d{4}|\d{2})"
_COMPACT = r"[T_ ]?(?P<H>\d{2})(?P<M>\d{2})(?P<S>\d{2})(?:[.,](?P<f>\d{1,9}))?"
_MONTHS = {
    name: number
    for number, names in enumerate(
        [
            *("jan", "feb", "mar mär mrz maerz", "apr", "may mai", "jun"),
            *("jul", "aug", "sep", "oct okt", "nov", "dec dez"),
        ],
        1,
    )
    for name in names.split()
}


class Moments(NamedTuple):
    """Times in cells of text.

    Attributes:
        ns: Times (n,) in ns, since 1970 or since midnight of the first day; `NO_TIME` for a cell without one.
        dated: Whether the cells have dates.
        utc: Whether the cells name their zone, so that `ns` is in UTC.
        doubt: A sentence about an ambiguous form, with the `[log]` key that settles it; None for none.
    """

    ns: Nanoseconds
    dated: bool
    utc: bool
    doubt: str | None = None


def moments_of(cells: Any, time_format: str | None) -> Moments | None:
    """Return the times in cells of text.

    Forms are tried in this order: dates that are not ambiguous, dates with slashes, times of day, and other
    forms by dateutil. Dates with slashes are read with the day first unless the cells show otherwise.

    Args:
        cells: A pyarrow array of strings (n,).
        time_format: A `strptime` format; None to find the form.

    Returns:
        The times; None if at most half of the filled cells are times.
    """
    import pyarrow.compute as pc  # noqa: PLC0415 - slow to import, and the daemon reads no log

    cells = pc.utf8_trim_whitespace(cells)
    filled = len(cells) - cells.null_count
    if time_format is not None:
        return _by_format(cells.to_pylist(), time_format)
    for date in _DATES:
        for clock in (r"(?:[T ,;_]+|$)(?:" + _CLOCK + ")?", _COMPACT):
            matches = pc.extract_regex(cells, date + clock + _ZONE)
            if filled and 2 * (filled - _unmatched(matches, cells)) > filled:
                return _dated(matches)
    matches = pc.extract_regex(cells, _SLASHED + r"(?:[T ,;]+|$)(?:" + _CLOCK + ")?" + _ZONE)
    if filled and 2 * (filled - _unmatched(matches, cells)) > filled:
        return _slashed(matches)
    matches = pc.extract_regex(cells, "^" + _CLOCK + _ZONE)
    if filled and 2 * (filled - _unmatched(matches, cells)) > filled:
        return _of_one_day(matches)
    return _in_other_forms(cells.to_pylist()) if 0 < filled <= _MOST_FALLBACK else None


def _unmatched(matches: Any, cells: Any) -> int:
    """Return how many filled cells do not match."""
    return int(matches.null_count - cells.null_count)


def _field(matches: Any, name: str, default: int = 0) -> Nanoseconds:
    """Return a field of digits (n,), the default where it is empty."""
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.compute as pc  # noqa: PLC0415

    if matches.type.get_field_index(name) < 0:
        return np.full(len(matches), default, np.int64)
    text = pc.fill_null(pc.struct_field(matches, name), "")
    text = pc.if_else(pc.equal(text, ""), str(default), text)
    return np.asarray(pc.cast(text, pa.int64()).to_numpy(zero_copy_only=False))


def _texts(matches: Any, name: str) -> list[str]:
    """Return a field of text (n,), empty strings where it is missing; an empty list without such a field."""
    import pyarrow.compute as pc  # noqa: PLC0415

    if matches.type.get_field_index(name) < 0:
        return []
    return [text or "" for text in pc.struct_field(matches, name).to_pylist()]


def _has_match(matches: Any) -> BoolArray:
    """Return which cells (n,) match."""
    import pyarrow.compute as pc  # noqa: PLC0415

    return np.asarray(pc.is_valid(matches).to_numpy(zero_copy_only=False))


def _clock_ns(matches: Any) -> Nanoseconds:
    """Return the time of day (n,) in ns."""
    import pyarrow.compute as pc  # noqa: PLC0415

    parts = np.zeros(len(matches), np.int64)
    if matches.type.get_field_index("f") >= 0:
        text = pc.utf8_rpad(pc.fill_null(pc.struct_field(matches, "f"), ""), 9, "0")
        parts = np.asarray(pc.cast(text, "int64").to_numpy(zero_copy_only=False))
    hours = _field(matches, "H")
    if any(halves := _texts(matches, "p")):
        of_noon = np.array([half[:1].lower() for half in halves])
        hours = np.where(of_noon == "p", hours % 12 + 12, np.where(of_noon == "a", hours % 12, hours))
    return ((hours * 60 + _field(matches, "M")) * 60 + _field(matches, "S")) * 1_000_000_000 + parts


def _years(matches: Any) -> Nanoseconds:
    """Return the years (n,), those of two digits in this century."""
    years = _field(matches, "y", 1970)
    return np.where(years < 100, 2000 + years, years)


def _days_ns(years: Nanoseconds, months: Nanoseconds, days: Nanoseconds) -> Nanoseconds:
    """Return dates (n,) in ns since 1970, `NO_TIME` for one that no calendar has."""
    good = (months >= 1) & (months <= 12) & (years > 1700) & (years < 2250)
    month = (np.where(good, years, 1970) - 1970).astype("M8[Y]").astype("M8[M]") + (
        np.where(good, months, 1) - 1
    )
    day = month.astype("M8[D]") + (days - 1)
    good &= day.astype("M8[M]") == month
    return np.where(good, day.astype("M8[ns]").astype(np.int64), NO_TIME)


def _in_utc(matches: Any, ns: Nanoseconds) -> tuple[Nanoseconds, bool]:
    """Return moments (n,) in UTC where the cells name a zone, and whether they do."""
    zones = _texts(matches, "z")
    if not any(zones):
        return ns, False
    offsets = {zone: offset_ns(zone) for zone in set(zones)}
    is_known = np.array([offsets[zone] is not None for zone in zones])
    shifted = ns - np.array([offsets[zone] or 0 for zone in zones], np.int64)
    return np.where(is_known, shifted, NO_TIME), True


def _moments(matches: Any, days: Nanoseconds) -> Moments:
    """Return dates (n,) in ns with the time of day of the cells."""
    ns, utc = _in_utc(matches, days + _clock_ns(matches))
    return Moments(np.where(_has_match(matches) & (days != NO_TIME), ns, NO_TIME), dated=True, utc=utc)


def _dated(matches: Any) -> Moments:
    """Return the times of cells with a date in a form that is not ambiguous."""
    months = _field(matches, "m", 1)
    if names := _texts(matches, "mon"):
        month_numbers = {name: _MONTHS.get(name.lower()[:3], 0) for name in set(names)}
        months = np.array([month_numbers[name] for name in names], np.int64)
    return _moments(matches, _days_ns(_years(matches), months, _field(matches, "d", 1)))


def _slashed(matches: Any) -> Moments:
    """Return the times of cells with dates such as 11/25/2026, in which either number may be the month."""
    a, b, years = _field(matches, "a", 1), _field(matches, "b", 1), _years(matches)
    day_first, month_first = (
        _moments(matches, _days_ns(years, b, a)),
        _moments(matches, _days_ns(years, a, b)),
    )
    unread_counts = [int((m.ns == NO_TIME).sum()) for m in (day_first, month_first)]
    if unread_counts[0] != unread_counts[1]:
        return day_first if unread_counts[0] < unread_counts[1] else month_first
    spans = [
        float(np.ptp(m.ns[m.ns != NO_TIME])) if (m.ns != NO_TIME).any() else 0.0
        for m in (day_first, month_first)
    ]
    if any(_texts(matches, "p")) or spans[1] < spans[0]:
        return month_first
    if spans[0] < spans[1] or (a == b).all():
        return day_first
    return day_first._replace(
        doubt="dates such as 03/04/2026 were read with the day first; "
        'say [log] time_format = "%m/%d/%Y %H:%M:%S" if the month is'
    )


def _of_one_day(matches: Any) -> Moments:
    """Return times without a date; a jump back by more than half a day is midnight."""
    ns = np.where(_has_match(matches), _clock_ns(matches), NO_TIME)
    has_time = ns != NO_TIME
    steps = np.diff(ns[has_time], prepend=ns[has_time][:1])
    ns[has_time] += np.cumsum(steps < -43_200_000_000_000) * 86_400_000_000_000
    return Moments(ns, dated=False, utc=False)


def _in_other_forms(cells: list[str | None]) -> Moments | None:
    """Return times in forms that dateutil reads, such as `2. März 2026 8:00`; None if most cells are not
    times.
    """
    first = next(cell for cell in cells if cell)
    if parsed(first, day_first=True) is None and parsed(first, day_first=False) is None:
        return None
    ways = [[parsed(cell, day_first=way) if cell else None for cell in cells] for way in (True, False)]
    counts = [sum(moment is not None for moment in moments) for moments in ways]
    if 2 * max(counts) <= sum(bool(cell) for cell in cells):
        return None
    doubt = None
    if counts[0] == counts[1] and ways[0] != ways[1]:
        doubt = (
            f'dates such as "{first}" were read with the day first; say [log] time_format, such as '
            '"%m/%d/%y %H:%M:%S", if it is not'
        )
    moments = ways[counts[1] > counts[0]]
    utc = any(moment is not None and moment.tzinfo is not None for moment in moments)
    ns = np.array([NO_TIME if moment is None else ns_of(moment) for moment in moments], np.int64)
    return Moments(ns, dated=True, utc=utc, doubt=doubt)


def _by_format(cells: list[str | None], time_format: str) -> Moments | None:
    """Return times by a `strptime` format; None if most cells do not match it."""
    ns, utc, dated = np.full(len(cells), NO_TIME), False, bool(re.search("%[dcxDFsjU]", time_format))
    for i, cell in enumerate(cells):
        try:
            moment = datetime.datetime.strptime(cell or "", time_format)
        except ValueError:
            continue
        utc = moment.tzinfo is not None
        ns[i] = ns_of(moment if dated else moment.replace(year=1970))
    return Moments(ns, dated, utc) if 2 * (ns != NO_TIME).sum() > len(cells) else None
