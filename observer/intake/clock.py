"""The clock of a sheet: its columns of times, and their unit."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from observer.config.logs import TIME_UNITS, Logs
from observer.errors import LogError
from observer.frames import FloatArray
from observer.intake.cells import numbers_of
from observer.intake.moments import NO_TIME, Moments, moments_of
from observer.intake.sheets import RawColumn, Sheet, full_name
from observer.intake.units import factor, known_unit, split_name
from observer.intake.zones import in_repeated_hour, localised, offset_ns, zone_in
from observer.units import BY_NAME

_TIME_WORDS = frozenset(
    ("time", "times", "timestamp", "timestamps", "datetime", "date", "zeit", "datum", "elapsed", "clock",
     "uhr", "ts", "heure", "horodatage", "fecha", "hora", "tiempo", "ora", "tijd", "stamp", "epoch",
     "unixtime", "unix")
)  # fmt: skip
_COMPOUND = re.compile(r"(?:zeit|zeitpunkt|zeitstempel|time|timestamp)$|^zeit(?:punkt|stempel)")
_LABVIEW = re.compile(r"^x[_-]value(?: #\d+)?$", re.I)
_UNIT_ALONE = re.compile(
    r"^(?:min|minutes?|minuten?|sec|seconds?|sekunden?|hours?|stunden?|ms|msec|milliseconds?)$", re.I
)
"""Columns of times that are called as their unit."""
_DATE, _OF_DAY = re.compile(r"date|datum|tag|day", re.I), re.compile(r"time|zeit|uhr|clock", re.I)
_NOT = re.compile(
    r"date code|run ?time|laufzeit|time ?out|time ?zone|life ?time|cycle|zyklus|takt|constant|konstante|dead|"
    r"tot|rise|settling|duration|dauer|remaining|rest|delay|verz[oö]g|period|lag|process|runtime|print",
    re.I,
)
"""Durations, which have a time's name and are no clock."""
_PARTS = (
    ("year", "jahr", "annee", "année", "año", "anno", "yyyy", "yy"),
    ("month", "monat", "mois", "mes", "mese", "mo"),
    ("day", "tag", "jour", "dia", "día", "giorno", "dd"),
    ("hour", "stunde", "heure", "hora", "ora", "hh"),
    ("minute", "minuten", "minuto", "min", "mi"),
    ("second", "seconds", "sekunde", "sekunden", "seconde", "segundo", "secondo", "sec", "ss"),
    ("millisecond", "milliseconds", "millisekunde", "millisekunden", "milliseconde", "ms"),
)
"""The parts of a date that may each have a column."""
_FIRST_S, _LAST_S = 788_918_400.0, 2_840_140_800.0
"""1995 and 2060: a count of seconds since 1970 between them is taken for one."""
_EPOCHS = (*((name, BY_NAME[name].size, 0.0) for name in ("s", "ms", "us", "ns")),
           ("labview", 1.0, -2_082_844_800.0), ("filetime", 1e-7, -11_644_473_600.0))  # fmt: skip
"""What a large number may count: its name, seconds for one, and where its zero is in s since 1970."""
_ASKED_EPOCHS = {"labview": "seconds since 1904", "filetime": "tenths of a microsecond since 1601"}
_SERIALS = (36_000.0, 65_000.0)
"""Days since 1899-12-30 from 1998 to 2077."""
_SERIAL_1970 = 25_569
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True)
class SheetClock:
    """The times of a sheet's rows, and where they come from.

    Attributes:
        time_s: Times (n,) in s, NaN where a row has no time.
        since_1970: Whether the times count from 1970; if not, from the file's own beginning.
        on_wall: Whether they are wall-clock times without a zone.
        columns: Names of the columns that hold them; empty for a clock of the format itself.
        unit: Unit or epoch of a number, such as `ms` or `excel`; empty for dates.
        sure: Whether the file or `[log]` states that unit.
        doubts: Sentences about an ambiguous date, zone or change of the clock.
    """

    time_s: FloatArray
    since_1970: bool
    on_wall: bool
    columns: tuple[str, ...] = ()
    unit: str = ""
    sure: bool = True
    doubts: tuple[str, ...] = ()


def clock_of(sheet: Sheet, options: Logs) -> SheetClock | None:
    """Return the clock of a sheet, as `[log]` names it or as its columns show it.

    Wall-clock times are converted to UTC where `[log] timezone` or the column's name gives their zone.

    Args:
        sheet: A table of raw columns.
        options: The `[log]` table: `time`, `time_format`, `timezone` and `every_s` replace guesses.

    Returns:
        The clock; None if no column is a clock, or the one named by `[log]` does not parse.

    Raises:
        LogError: A large number may count from 1904 or 1601, or is no date from 1995 to 2060; `[log]
            time_format` decides.
    """
    if options.every_s is not None:
        return SheetClock(options.every_s * _row_numbers(sheet), since_1970=False, on_wall=False, unit="s")
    if sheet.time_s is not None and options.time is None:
        return _in_utc(
            SheetClock(sheet.time_s, sheet.since_1970, sheet.on_wall and sheet.since_1970), options
        )
    if options.time is not None:
        names = (options.time,) if isinstance(options.time, str) else options.time
        columns = [sheet.named(name) for name in names]
        clock = (
            _clock_of_columns([c for c in columns if c is not None], sheet, options) if all(columns) else None
        )
    else:
        clock = _clock_of_parts(sheet) or next(
            (c for c in (_clock_of_columns(columns, sheet, options) for columns in _candidates(sheet)) if c),
            None,
        )
    return None if clock is None else _in_utc(clock, options)


def _row_numbers(sheet: Sheet) -> FloatArray:
    """Return the number of each row (n,) from 0; rows that were left out are counted."""
    rows = np.arange(len(sheet.columns[0]), dtype=np.float64)
    if sheet.lines is None or not sheet.left_out:
        return rows
    return rows + np.searchsorted(np.array(sorted(sheet.left_out)), sheet.lines)


def is_called_time(name: str) -> bool:
    """Return whether a column's name is that of a clock: `Uhrzeit`, `t [ms]`, `Elapsed Time`.

    Names of durations, such as `cycle time` or `Laufzeit`, are not.
    """
    stem, unit = split_name(name)
    if _NOT.search(stem):
        return False
    if stem in ("t", "T", "Temps"):  # a capital is a temperature, unless its unit is a time
        return stem == "t" or known_unit(unit) in TIME_UNITS
    words = re.findall(r"[^\W\d_]+", re.sub(r"(?<=[a-zà-ÿ])(?=[A-Z])", " ", stem))
    return bool(_LABVIEW.match(stem)) or any(
        word.casefold() in _TIME_WORDS or _COMPOUND.search(word.casefold()) for word in words
    )


def _candidates(sheet: Sheet) -> Iterable[list[RawColumn]]:
    """Yield the columns that may hold the time, the likeliest first."""
    named = [c for c in sheet.columns if is_called_time(c.name)]
    dates = [
        c
        for c in named
        if _DATE.search(c.name) and not (_OF_DAY.search(c.name) and "ate" in c.name.lower()[4:])
    ]
    clocks = [c for c in named if _OF_DAY.search(c.name) and c not in dates]
    yield from ([date, clock] for date in dates for clock in clocks)
    yield from ([c] for c in named if c.is_moments or c.is_text)
    yield from ([c] for c in sheet.columns if c.is_moments)
    yield from ([c] for c in sheet.columns if c.is_text and c not in named and _is_written(c))
    yield from ([c] for c in named)
    yield from ([c] for c in sheet.columns if _UNIT_ALONE.match(c.name.strip()) and c not in named)
    yield from ([c] for c in sheet.columns[:1] if c not in named)


def _is_written(column: RawColumn) -> bool:
    """Whether a column's first cell is longer than a number and has several in it, as a date has."""
    first = next((cell for cell in column.values[:50].to_pylist() if cell), "")
    return len(re.findall(r"\d+", first)) >= 3 and not re.fullmatch(r"[+-]?[\d.,]+(?:[eE][+-]?\d+)?", first)


def _clock_of_parts(sheet: Sheet) -> SheetClock | None:
    """Return the clock in columns of year, month, day, hour, minute and second.

    None if these are neither a date with hours nor hours and minutes.
    """
    columns = [
        next((c for c in sheet.columns if _stem(c) in names and not c.is_moments), None) for names in _PARTS
    ]
    dated = all(columns[:4])
    if not dated and not all(columns[3:5]):
        return None
    parts = [None if c is None else numbers_of(c, sheet.decimal)[0] for c in columns]
    year, month, day, hour, minute, second, milli = (
        np.zeros(len(sheet.columns[0])) if part is None else part for part in parts
    )
    time_s = hour * 3600.0 + minute * 60.0 + second + milli / 1000.0
    names = tuple(full_name(c) for c in columns if c is not None)
    if dated:
        year = np.where(year < 100.0, year + 2000.0, year)
        good = np.isfinite(year + month + day) & (month >= 1.0) & (month <= 12.0)
        months = (np.where(good, year, 1970.0) - 1970.0) * 12.0 + np.where(good, month, 1.0) - 1.0
        days = months.astype("M8[M]").astype("M8[D]").astype(np.float64) + day - 1.0
        return SheetClock(np.where(good, days * 86_400.0, np.nan) + time_s, True, True, names)
    if any(is_called_time(c.name) and c not in columns for c in sheet.columns):
        return None
    midnights = np.cumsum(np.diff(time_s, prepend=time_s[:1]) < -43_200.0)
    return SheetClock(time_s + 86_400.0 * midnights, since_1970=False, on_wall=False, columns=names)


def _stem(column: RawColumn) -> str:
    """Return a column's name without its unit, in lower case."""
    return split_name(column.name)[0].strip().casefold()


def _clock_of_columns(columns: list[RawColumn], sheet: Sheet, options: Logs) -> SheetClock | None:
    """Return the clock in one column, or in a column of dates and one of times of day; None if it is not a
    clock.
    """
    if len(columns) == 2:
        return _clock_of_date_and_time(columns[0], columns[1], sheet, options)
    column = columns[0]
    names = (full_name(column),)
    if column.is_moments:
        ns = column.values.astype(np.int64)
        return _clock_of_moments(Moments(ns, dated=True, utc=column.utc), names)
    by_format = options.time_format is not None and options.time_format not in TIME_UNITS
    if column.is_text:
        moments = (
            None if options.time_format in TIME_UNITS else moments_of(column.values, options.time_format)
        )
        if moments is not None:
            return _clock_of_moments(moments, names)
    if by_format:
        return None
    values, words = numbers_of(column, sheet.decimal)
    if not np.isfinite(values).any() or words.cells > len(values) // 2:
        return None
    named = options.time is not None or is_called_time(column.name)
    return _clock_of_numbers(values, column, names, options.time_format, by_name=named)


def _clock_of_date_and_time(
    date: RawColumn, clock: RawColumn, sheet: Sheet, options: Logs
) -> SheetClock | None:
    """Return the clock of a column of dates and one of times of day; None if they are not."""
    import pyarrow.compute as pc  # noqa: PLC0415 - slow to import

    names = (full_name(date), full_name(clock))
    if date.is_text and clock.is_text:
        both = pc.binary_join_element_wise(date.values, clock.values, " ")
        moments = moments_of(both, options.time_format)
        of_day = moments_of(clock.values, None)
        dated = moments_of(date.values, None)
        if moments is None or of_day is None or of_day.dated or dated is None or not dated.dated:
            return None
        return _clock_of_moments(moments, names)
    day, since = _clock_of_one_column(date, sheet, options), _clock_of_one_column(clock, sheet, options)
    if day is None or since is None or not day.since_1970 or since.since_1970:
        return None
    midnight_s = np.floor(day.time_s / 86_400.0) * 86_400.0
    return replace(day, time_s=midnight_s + since.time_s % 86_400.0, columns=names)


def _clock_of_one_column(column: RawColumn, sheet: Sheet, options: Logs) -> SheetClock | None:
    """Return the clock in one column, independent of the other columns of the sheet."""
    if not column.is_text and not column.is_moments:
        values = column.values
        if np.nanmax(values, initial=0.0) <= 1.0 and np.nanmin(values, initial=0.0) >= 0.0:  # part of a day
            return SheetClock(
                values * 86_400.0, since_1970=False, on_wall=True, columns=(column.name,), unit="d"
            )
    return _clock_of_columns([column], sheet, options)


def _clock_of_moments(moments: Moments, names: tuple[str, ...]) -> SheetClock | None:
    """Return the clock of parsed times; None if no cell has a time."""
    has_time = moments.ns != NO_TIME
    if not has_time.any():
        return None
    time_s = np.where(has_time, (moments.ns // 1_000) / 1e6, np.nan)
    doubts = (moments.doubt,) if moments.doubt else ()
    return SheetClock(time_s, moments.dated, moments.dated and not moments.utc, names, doubts=doubts)


def _clock_of_numbers(
    values: FloatArray,
    column: RawColumn,
    names: tuple[str, ...],
    configured_unit: str | None,
    *,
    by_name: bool,
) -> SheetClock | None:
    """Return the clock of a column of numbers: in its stated unit, an epoch, or days of a spreadsheet.

    None if neither its name nor its unit nor its values show that it is a time. Raises `LogError` for a
    number that may be one of several epochs.
    """
    finite = values[np.isfinite(values)]
    rising = np.diff(finite)
    first, apart = float(finite[0]), float(np.median(rising)) if len(rising) else 0.0
    name_as_unit = column.name if _UNIT_ALONE.match(column.name.strip()) else ""
    written = column.unit or split_name(column.name)[1] or name_as_unit
    unit = configured_unit or known_unit(written)
    if unit and unit not in TIME_UNITS:
        return None
    increases = len(finite) > 2 and bool((rising > 0).all())
    if unit == "excel" or (
        not unit and increases and _is_serial(first, float(finite[-1]), apart, column.name)
    ):
        return SheetClock(np.round((values - _SERIAL_1970) * 86_400.0, 4), True, True, names, "excel")
    if configured_unit in _ASKED_EPOCHS:
        to_s, zero_s = next((to_s, zero_s) for name, to_s, zero_s in _EPOCHS if name == configured_unit)
        return SheetClock(values * to_s + zero_s, True, False, names, configured_unit)
    if not configured_unit and (by_name or increases) and (epoch := _epoch_of(first, unit)) is not None:
        name, to_s, zero_s = epoch
        if name in _ASKED_EPOCHS:
            raise LogError(_which_epoch(names[0], first, name, to_s * first + zero_s))
        return SheetClock(values * to_s, True, False, names, name)
    says_so = by_name or bool(name_as_unit) or (bool(unit) and increases and not _NOT.search(column.name))
    if not says_so:
        return None
    time_s = values * factor(unit, "s") if unit else values
    first_s = float(time_s[np.isfinite(time_s)][0])
    if not configured_unit and first_s > _LAST_S:
        raise LogError(
            f'"{names[0]}" begins with {first:.10g}, which is no time from 1995 to 2060; say what it counts '
            "in [log] time_format, one of " + ", ".join(TIME_UNITS)
        )
    return SheetClock(time_s, first_s > 1e9, False, names, unit or "s", sure=bool(unit))


def _epoch_of(first: float, unit: str) -> tuple[str, float, float] | None:
    """Return the epoch in which a first time is a date from 1995 to 2060: its name, s per count, and zero in
    s.

    None without such an epoch. `unit` restricts the choice.
    """
    for name, to_s, zero_s in _EPOCHS:
        if (not unit or (to_s == 1.0 and unit == "s")) and _FIRST_S < first * to_s + zero_s < _LAST_S:
            return name, to_s, zero_s
    return None


def _which_epoch(name: str, first: float, epoch: str, since_s: float) -> str:
    """Return the question which epoch a large number counts from, with the date that each answer gives."""
    day = f"{np.datetime64(int(since_s), 's').item():%Y-%m-%d}"
    other = ""
    if epoch == "labview":
        other = f', or "s" for seconds since 1970, the year {np.datetime64(int(first), "s").item():%Y}'
    return (
        f'"{name}" begins with {first:.13g}; say in [log] time_format what that is: "{epoch}" for '
        f"{_ASKED_EPOCHS[epoch]} ({day}){other}"
    )


def _is_serial(first: float, last: float, apart: float, name: str) -> bool:
    """Whether numbers are days of a spreadsheet: recent dates, and rows seconds apart."""
    if not _SERIALS[0] < first <= last < _SERIALS[1] or not 0.0 < apart < 1.0:
        return False
    return apart < 5e-4 or (apart < 0.01 and bool(_DATE.search(name)))


def _in_utc(clock: SheetClock, options: Logs) -> SheetClock:
    """Return the clock in UTC where its zone is known, with a doubt about an ambiguous change of summer
    time.
    """
    if not clock.on_wall:
        return clock
    named = next((zone for name in clock.columns if (zone := zone_in(name))), "")
    if named and clock.since_1970 and (ahead_ns := offset_ns(named)) is not None:
        return replace(clock, time_s=clock.time_s - ahead_ns / 1e9, on_wall=False)
    zone = named or options.timezone or ""
    if zone and clock.since_1970:
        doubts = (*clock.doubts, *_repeated_hour_doubts(clock.time_s, zone))
        return replace(clock, time_s=localised(clock.time_s, zone), on_wall=False, doubts=doubts)
    return replace(clock, doubts=(*clock.doubts, *_clock_change_doubts(clock.time_s)))


def _repeated_hour_doubts(wall_s: FloatArray, zone: str) -> list[str]:
    """Return a doubt if times pass once through an hour that the zone's clock shows twice."""
    finite_s = wall_s[np.isfinite(wall_s)]
    repeated = in_repeated_hour(finite_s, zone)
    if not repeated.any() or (np.diff(finite_s) < -HOUR_S / 2.0).any():
        return []
    first = np.datetime64(int(finite_s[np.flatnonzero(repeated)[0]]), "s").item()
    return [
        f"{first:%Y-%m-%d %H:%M} came twice in {zone}, and the times go through it once; it was taken for "
        'the first, in summer time; set [log] timezone to a fixed one, such as "Etc/GMT-1", if it was not'
    ]


def _clock_change_doubts(time_s: FloatArray) -> list[str]:
    """Return a doubt if a wall clock was put forward or back by an hour within a log."""
    finite_s = time_s[np.isfinite(time_s)]
    if len(finite_s) < 3:
        return []
    steps = np.diff(finite_s)
    usual = float(np.median(steps))
    for way, words in ((1.0, "forward"), (-1.0, "back")):
        at = np.flatnonzero(np.abs(steps - way * HOUR_S - usual) <= max(0.5 * usual, 1.0))
        of_day_h = (finite_s[at] % 86_400.0) / HOUR_S
        at = at[(of_day_h > 0.9) & (of_day_h < 3.1)]
        if len(at) == 1 and usual < HOUR_S / 4:
            return [
                f"the clock goes {words} by an hour, as at a change of daylight saving time; set "
                '[log] timezone, such as "Europe/Berlin"'
            ]
    return []
