"""From written times to numbers: ISO 8601, German and other dates, clocks without a date, any `strptime`
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
NONE = np.iinfo(np.int64).min
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
    """Times (n,) in ns, `NONE` where a cell has none: since 1970, or of one day where `dated` is false.

    `utc`: the cells name their zone. `doubt`: what is not sure.
    """

    ns: Nanoseconds
    dated: bool
    utc: bool
    doubt: str | None = None


def moments_of(cells: Any, time_format: str | None) -> Moments | None:
    """The times in cells of text (n,), a pyarrow array; None where most are no times."""
    import pyarrow.compute as pc  # noqa: PLC0415 - slow to import, and the daemon reads no log

    cells = pc.utf8_trim_whitespace(cells)
    filled = len(cells) - cells.null_count
    if time_format is not None:
        return _by_format(cells.to_pylist(), time_format)
    for date in _DATES:
        for clock in (r"(?:[T ,;_]+|$)(?:" + _CLOCK + ")?", _COMPACT):
            found = pc.extract_regex(cells, date + clock + _ZONE)
            if filled and 2 * (filled - _unmatched(found, cells)) > filled:
                return _dated(found)
    found = pc.extract_regex(cells, _SLASHED + r"(?:[T ,;]+|$)(?:" + _CLOCK + ")?" + _ZONE)
    if filled and 2 * (filled - _unmatched(found, cells)) > filled:
        return _slashed(found)
    found = pc.extract_regex(cells, "^" + _CLOCK + _ZONE)
    if filled and 2 * (filled - _unmatched(found, cells)) > filled:
        return _of_one_day(found)
    return _as_written_elsewhere(cells.to_pylist()) if 0 < filled <= _MOST_FALLBACK else None


def _unmatched(found: Any, cells: Any) -> int:
    return int(found.null_count - cells.null_count)


def _field(found: Any, name: str, default: int = 0) -> Nanoseconds:
    """A field of digits (n,), the default where it is empty."""
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.compute as pc  # noqa: PLC0415

    if found.type.get_field_index(name) < 0:
        return np.full(len(found), default, np.int64)
    text = pc.fill_null(pc.struct_field(found, name), "")
    text = pc.if_else(pc.equal(text, ""), str(default), text)
    return np.asarray(pc.cast(text, pa.int64()).to_numpy(zero_copy_only=False))


def _texts(found: Any, name: str) -> list[str]:
    import pyarrow.compute as pc  # noqa: PLC0415

    if found.type.get_field_index(name) < 0:
        return []
    return [text or "" for text in pc.struct_field(found, name).to_pylist()]


def _there(found: Any) -> BoolArray:
    import pyarrow.compute as pc  # noqa: PLC0415

    return np.asarray(pc.is_valid(found).to_numpy(zero_copy_only=False))


def _clock_ns(found: Any) -> Nanoseconds:
    """Hours, minutes, seconds and their parts (n,) in ns."""
    import pyarrow.compute as pc  # noqa: PLC0415

    parts = np.zeros(len(found), np.int64)
    if found.type.get_field_index("f") >= 0:
        text = pc.utf8_rpad(pc.fill_null(pc.struct_field(found, "f"), ""), 9, "0")
        parts = np.asarray(pc.cast(text, "int64").to_numpy(zero_copy_only=False))
    hours = _field(found, "H")
    if any(halves := _texts(found, "p")):
        of_noon = np.array([half[:1].lower() for half in halves])
        hours = np.where(of_noon == "p", hours % 12 + 12, np.where(of_noon == "a", hours % 12, hours))
    return ((hours * 60 + _field(found, "M")) * 60 + _field(found, "S")) * 1_000_000_000 + parts


def _years(found: Any) -> Nanoseconds:
    years = _field(found, "y", 1970)
    return np.where(years < 100, 2000 + years, years)


def _days_ns(years: Nanoseconds, months: Nanoseconds, days: Nanoseconds) -> Nanoseconds:
    """Dates (n,) in ns since 1970, `NONE` for one that is in no calendar."""
    good = (months >= 1) & (months <= 12) & (years > 1700) & (years < 2250)
    month = (np.where(good, years, 1970) - 1970).astype("M8[Y]").astype("M8[M]") + (
        np.where(good, months, 1) - 1
    )
    day = month.astype("M8[D]") + (days - 1)
    good &= day.astype("M8[M]") == month
    return np.where(good, day.astype("M8[ns]").astype(np.int64), NONE)


def _zoned(found: Any, ns: Nanoseconds) -> tuple[Nanoseconds, bool]:
    """Moments (n,) as UTC where the cells name a zone, and whether they do."""
    zones = _texts(found, "z")
    if not any(zones):
        return ns, False
    offsets = {zone: offset_ns(zone) for zone in set(zones)}
    known = np.array([offsets[zone] is not None for zone in zones])
    shifted = ns - np.array([offsets[zone] or 0 for zone in zones], np.int64)
    return np.where(known, shifted, NONE), True


def _finished(found: Any, days: Nanoseconds) -> Moments:
    ns, utc = _zoned(found, days + _clock_ns(found))
    return Moments(np.where(_there(found) & (days != NONE), ns, NONE), dated=True, utc=utc)


def _dated(found: Any) -> Moments:
    months = _field(found, "m", 1)
    if names := _texts(found, "mon"):
        known = {name: _MONTHS.get(name.lower()[:3], 0) for name in set(names)}
        months = np.array([known[name] for name in names], np.int64)
    return _finished(found, _days_ns(_years(found), months, _field(found, "d", 1)))


def _slashed(found: Any) -> Moments:
    """Dates such as 11/25/2026, in which either number may be the month."""
    a, b, years = _field(found, "a", 1), _field(found, "b", 1), _years(found)
    day_first, month_first = _finished(found, _days_ns(years, b, a)), _finished(found, _days_ns(years, a, b))
    lost = [int((m.ns == NONE).sum()) for m in (day_first, month_first)]
    if lost[0] != lost[1]:
        return day_first if lost[0] < lost[1] else month_first
    spans = [
        float(np.ptp(m.ns[m.ns != NONE])) if (m.ns != NONE).any() else 0.0 for m in (day_first, month_first)
    ]
    if any(_texts(found, "p")) or spans[1] < spans[0]:
        return month_first
    if spans[0] < spans[1] or (a == b).all():
        return day_first
    return day_first._replace(
        doubt="dates such as 03/04/2026 were read with the day first; "
        'say [log] time_format = "%m/%d/%Y %H:%M:%S" if the month is'
    )


def _of_one_day(found: Any) -> Moments:
    """Clocks without a date: a jump back by more than half a day is midnight."""
    ns = np.where(_there(found), _clock_ns(found), NONE)
    there = ns != NONE
    steps = np.diff(ns[there], prepend=ns[there][:1])
    ns[there] += np.cumsum(steps < -43_200_000_000_000) * 86_400_000_000_000
    return Moments(ns, dated=False, utc=False)


def _as_written_elsewhere(cells: list[str | None]) -> Moments | None:
    """Times in other forms than those above, as `2. März 2026 8:00`; None where most cells are none."""
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
    ns = np.array([NONE if moment is None else ns_of(moment) for moment in moments], np.int64)
    return Moments(ns, dated=True, utc=utc, doubt=doubt)


def _by_format(cells: list[str | None], time_format: str) -> Moments | None:
    """Times by a format as of `strptime`."""
    ns, utc, dated = np.full(len(cells), NONE), False, bool(re.search("%[dcxDFsjU]", time_format))
    for i, cell in enumerate(cells):
        try:
            moment = datetime.datetime.strptime(cell or "", time_format)
        except ValueError:
            continue
        utc = moment.tzinfo is not None
        ns[i] = ns_of(moment if dated else moment.replace(year=1970))
    return Moments(ns, dated, utc) if 2 * (ns != NONE).sum() > len(cells) else None
