"""The clock of a sheet: its columns of times, and their unit."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from observer.frames import FloatArray
from observer.intake.cells import numbers_of
from observer.intake.moments import NONE, Moments, localised, moments_of
from observer.intake.sheets import RawColumn, Sheet, full_name
from observer.intake.units import factor, known_unit, split_name
from observer.tables.logs import TIME_UNITS, Logs

_NAMED = re.compile(
    r"^(?:.*(?:time|zeit|timestamp|datum|date|elapsed|uhr|clock).*|t|x_value|x-value|sec|seconds|sekunden|ts)$",
    re.I,
)
_UNIT_ALONE = re.compile(r"^(?:min|minutes?|minuten|sec|seconds?|sekunden|hours?|stunden)$", re.I)
"""Columns of times that are called as their unit."""
_DATE, _OF_DAY = re.compile(r"date|datum|tag|day", re.I), re.compile(r"time|zeit|uhr|clock", re.I)
_NOT = re.compile(r"date code|runtime|time ?out|time ?zone|lifetime|cycle", re.I)
_EPOCHS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))
_SERIALS = (36_000.0, 65_000.0)
"""Days since 1899-12-30 from 1998 to 2077."""
_SERIAL_1970 = 25_569
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True)
class SheetClock:
    """The times of a sheet's rows, with what is known of them.

    `time_s` (n,), NaN where a row has none; `since_1970` whether they count from then, `on_wall` whether
    they are wall-clock times without a zone. `columns` are the names of their columns, `unit` that of a
    number, `sure` whether the file states it.
    """

    time_s: FloatArray
    since_1970: bool
    on_wall: bool
    columns: tuple[str, ...] = ()
    unit: str = ""
    sure: bool = True
    doubts: tuple[str, ...] = ()


def clock_of(sheet: Sheet, how: Logs) -> SheetClock | None:
    """The clock of a sheet, as given or found; None where it has none.

    Wall-clock times are converted to UTC where `[log] timezone` gives their zone.
    """
    if sheet.time_s is not None and how.time is None:
        return _zoned(SheetClock(sheet.time_s, sheet.since_1970, sheet.on_wall and sheet.since_1970), how)
    if how.time is not None:
        names = (how.time,) if isinstance(how.time, str) else how.time
        columns = [sheet.named(name) for name in names]
        found = _of_columns([c for c in columns if c is not None], sheet, how) if all(columns) else None
    else:
        found = next((c for c in (_of_columns(each, sheet, how) for each in _candidates(sheet)) if c), None)
    return None if found is None else _zoned(found, how)


def _candidates(sheet: Sheet) -> Iterable[list[RawColumn]]:
    """The columns that may hold the time, the likeliest first."""
    named = [c for c in sheet.columns if _NAMED.match(split_name(c.name)[0]) and not _NOT.search(c.name)]
    dates = [
        c
        for c in named
        if _DATE.search(c.name) and not (_OF_DAY.search(c.name) and "ate" in c.name.lower()[4:])
    ]
    clocks = [c for c in named if _OF_DAY.search(c.name) and c not in dates]
    yield from ([date, clock] for date in dates for clock in clocks)
    yield from ([c] for c in named if c.is_moments or c.is_text)
    yield from ([c] for c in sheet.columns if c.is_moments)
    yield from ([c] for c in named)
    yield from ([c] for c in sheet.columns if _UNIT_ALONE.match(c.name.strip()) and c not in named)
    yield from ([c] for c in sheet.columns[:1] if c not in named)


def _of_columns(columns: list[RawColumn], sheet: Sheet, how: Logs) -> SheetClock | None:
    """The clock in one column, or in one of dates and one of clocks."""
    if len(columns) == 2:
        return _of_two(columns[0], columns[1], sheet, how)
    column = columns[0]
    names = (full_name(column),)
    if column.is_moments:
        ns = column.values.astype(np.int64)
        return _of_moments(Moments(ns, dated=True, utc=column.utc), names)
    if column.is_text:
        found = None if how.time_format in TIME_UNITS else moments_of(column.values, how.time_format)
        if found is not None:
            return _of_moments(found, names)
    values, words = numbers_of(column, sheet.decimal)
    if not np.isfinite(values).any() or words.cells > len(values) // 2:
        return None
    return _of_numbers(
        values, column, names, how.time_format, by_name=bool(_NAMED.match(split_name(column.name)[0]))
    )


def _of_two(date: RawColumn, clock: RawColumn, sheet: Sheet, how: Logs) -> SheetClock | None:
    """The clock of a column of dates and one of the time of day."""
    import pyarrow.compute as pc  # noqa: PLC0415 - slow to import

    names = (full_name(date), full_name(clock))
    if date.is_text and clock.is_text:
        both = pc.binary_join_element_wise(date.values, clock.values, " ")
        found = moments_of(both, how.time_format)
        of_day = moments_of(clock.values, None)
        dated = moments_of(date.values, None)
        if found is None or of_day is None or of_day.dated or dated is None or not dated.dated:
            return None
        return _of_moments(found, names)
    day, since = _of_one(date, sheet, how), _of_one(clock, sheet, how)
    if day is None or since is None or not day.since_1970 or since.since_1970:
        return None
    midnight_s = np.floor(day.time_s / 86_400.0) * 86_400.0
    return replace(day, time_s=midnight_s + since.time_s % 86_400.0, columns=names)


def _of_one(column: RawColumn, sheet: Sheet, how: Logs) -> SheetClock | None:
    """The clock in one column, whatever else the sheet has."""
    if not column.is_text and not column.is_moments:
        values = column.values
        if np.nanmax(values, initial=0.0) <= 1.0 and np.nanmin(values, initial=0.0) >= 0.0:  # part of a day
            return SheetClock(
                values * 86_400.0, since_1970=False, on_wall=True, columns=(column.name,), unit="d"
            )
    return _of_columns([column], sheet, how)


def _of_moments(found: Moments, names: tuple[str, ...]) -> SheetClock | None:
    there = found.ns != NONE
    if not there.any():
        return None
    time_s = np.where(there, (found.ns // 1_000) / 1e6, np.nan)
    doubts = (found.doubt,) if found.doubt else ()
    return SheetClock(time_s, found.dated, found.dated and not found.utc, names, doubts=doubts)


def _of_numbers(
    values: FloatArray, column: RawColumn, names: tuple[str, ...], given: str | None, *, by_name: bool
) -> SheetClock | None:
    """The clock of a column of numbers: an epoch, days of a spreadsheet, or in its stated unit."""
    there = values[np.isfinite(values)]
    rising = np.diff(there)
    if given is None and not by_name and (len(there) < 3 or (rising <= 0).any() or there[0] < 0.0):
        return None
    first, apart = float(there[0]), float(np.median(rising)) if len(rising) else 0.0
    alone = column.name if _UNIT_ALONE.match(column.name.strip()) else ""
    written = column.unit or split_name(column.name)[1] or alone
    unit = given or known_unit(written)
    if unit == "excel" or (not unit and _is_serial(first, float(there[-1]), apart, column.name)):
        return SheetClock(np.round((values - _SERIAL_1970) * 86_400.0, 4), True, True, names, "excel")
    if unit not in TIME_UNITS:
        for least, to_s in _EPOCHS:
            if first > least:
                return SheetClock(
                    values * to_s, True, False, names, {1e-9: "ns", 1e-6: "us", 1e-3: "ms"}[to_s]
                )
        return SheetClock(values, first > 1e9, False, names, "s", sure=False)
    time_s = values if unit == "s" else values * factor(unit, "s")
    return SheetClock(time_s, bool(time_s[np.isfinite(time_s)][0] > 1e9), False, names, unit)


def _is_serial(first: float, last: float, apart: float, name: str) -> bool:
    """Whether numbers are days of a spreadsheet: recent dates, and rows seconds apart."""
    if not _SERIALS[0] < first <= last < _SERIALS[1] or not 0.0 < apart < 1.0:
        return False
    return apart < 5e-4 or (apart < 0.01 and bool(_DATE.search(name)))


def _zoned(clock: SheetClock, how: Logs) -> SheetClock:
    """The clock as UTC where its zone is given, with any ambiguity of a change to or from summer time."""
    if not clock.on_wall:
        return clock
    if how.timezone is not None and clock.since_1970:
        return replace(clock, time_s=localised(clock.time_s, how.timezone), on_wall=False)
    return replace(clock, doubts=(*clock.doubts, *_changed(clock.time_s)))


def _changed(time_s: FloatArray) -> list[str]:
    """Whether a wall clock was put forward or back by an hour within a log."""
    there = time_s[np.isfinite(time_s)]
    if len(there) < 3:
        return []
    steps = np.diff(there)
    usual = float(np.median(steps))
    for way, words in ((1.0, "forward"), (-1.0, "back")):
        at = np.flatnonzero(np.abs(steps - way * HOUR_S - usual) <= max(0.5 * usual, 1.0))
        of_day_h = (there[at] % 86_400.0) / HOUR_S
        at = at[(of_day_h > 0.9) & (of_day_h < 3.1)]
        if len(at) == 1 and usual < HOUR_S / 4:
            return [
                f"the clock goes {words} by an hour, as at a change of daylight saving time; set "
                '[log] timezone, such as "Europe/Berlin"'
            ]
    return []
