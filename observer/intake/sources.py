"""The sheets of files with their clocks, in order: the input of the mapping to channels."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from observer.config.logs import Logs, LongForm
from observer.errors import LogError
from observer.frames import BoolArray
from observer.intake.cells import numbers_of
from observer.intake.clock import HOUR_S, SheetClock, clock_of, is_called_time
from observer.intake.readers import read_sheets
from observer.intake.sheets import RawColumn, Sheet

_NAME = re.compile(
    r"^(?:data ?item ?id|data ?item|name|signal|channel|kanal|tag|tagname|variable|metric|sensor|item|id|"
    r"messstelle|point|parameter|entityid|entity|series|serie|field|topic|objekt|object)$",
    re.I,
)
_VALUE = re.compile(
    r"^(?:value|wert|messwert|result|reading|val|data|y|vvalue|numericvalue|state|payload)$", re.I
)
_UNITS = ("unit", "units", "einheit")
_MOST_SIGNALS = 500
_TWICE = (
    "rows have the time of the row before, as where a stamp has whole seconds only, and were spread evenly"
)


@dataclass(frozen=True, slots=True, eq=False)
class TimedSheet:
    """A sheet whose rows have increasing times.

    Attributes:
        sheet: The sheet, without rows that lack a time.
        clock: Its clock, with a time (n,) for each row.
        is_held: Whether it is one signal of a file in long form, whose values hold until the next.
    """

    sheet: Sheet
    clock: SheetClock
    is_held: bool = False


@dataclass(frozen=True, slots=True)
class Sources:
    """All sheets of some files.

    Attributes:
        timed: The sheets with a clock.
        problems: Errors; with several files, sentences that begin with a file's name.
        doubts: Sentences about rows left out and clocks.
        without: The sheets without a clock.
        long: The columns of name and value of files in long form; None without one.
    """

    timed: tuple[TimedSheet, ...]
    problems: tuple[str, ...]
    doubts: tuple[str, ...]
    without: tuple[Sheet, ...] = ()
    long: LongForm | None = None


def sources_of(paths: Sequence[Path], options: Logs, *, accept_truncated: bool = False) -> Sources:
    """Read files and find the clock of each of their sheets.

    A sheet in long form, with a column of names and one of values, becomes a sheet for each signal.

    Args:
        paths: Files of one run.
        options: The `[log]` table.
        accept_truncated: Drop a last row that was cut off, instead of refusing the file.

    Raises:
        LogError: The only file cannot be read. Of several files, such an error is one of the `problems`.
        ModuleNotFoundError: The package for a file's format is not installed.
    """
    timed, problems, doubts, without, long = list[TimedSheet](), list[str](), list[str](), list[Sheet](), None
    for path in paths:
        before = f"{path.name}: " if len(paths) > 1 else ""
        try:
            sheets = read_sheets(path, options, accept_truncated)
        except LogError as error:
            if len(paths) == 1:
                raise
            problems.append(str(error))
            continue
        doubts += [before + sentence for sheet in sheets for sentence in sheet.doubts]
        for sheet in itertools.chain.from_iterable(by_clock(whole, options) for whole in sheets):
            try:
                clock = clock_of(sheet, options)
            except LogError as error:
                problems.append(before + str(error))
                continue
            if clock is None:
                without.append(sheet)
                continue
            form = options.long or _long_form_of(sheet)
            parts = _widened(sheet, form) if form else []
            long = form if parts else long
            if not parts:
                timed.append(_with_times(sheet, clock, problems, doubts, before))
                continue
            doubts += [before + sentence for sentence in clock.doubts]
            for part, rows in parts:
                timed.append(_in_order(part, replace(clock, time_s=clock.time_s[rows]), doubts))
    return Sources(tuple(timed), tuple(problems), tuple(doubts), tuple(without), long)


def _long_form_of(sheet: Sheet) -> LongForm | None:
    """Return the columns of name and value of a sheet in long form; None for any other."""
    names = [c for c in sheet.columns if c.is_text and _NAME.match(c.name.strip().replace("_", ""))]
    values = [c for c in sheet.columns if _VALUE.match(c.name.strip().replace("_", ""))]
    for column in names:
        different = len(column.values.unique())
        if values and different <= min(_MOST_SIGNALS, max(len(column) // 2, 1)):
            return LongForm(name=column.name, value=values[0].name)
    return None


def _widened(sheet: Sheet, form: LongForm) -> list[tuple[Sheet, NDArray[np.int64]]]:
    """Return a sheet of one column for each signal, with the rows (k,) of the file that belong to it."""
    name, value = sheet.named(form.name), sheet.named(form.value)
    if name is None or value is None or not name.is_text:
        return []
    encoded = name.values.dictionary_encode()
    codes = np.asarray(encoded.indices.fill_null(-1).to_numpy(zero_copy_only=False))
    unit = next((c for c in sheet.columns if c.is_text and c.name.strip().lower() in _UNITS), None)
    parts = []
    for code, signal in enumerate(encoded.dictionary.to_pylist()):
        rows = np.flatnonzero(codes == code)
        unit_text = "" if unit is None else str(unit.values[int(rows[0])].as_py() or "")
        cells = value.values.take(rows) if value.is_text else value.values[rows]
        lines = sheet.lines[rows] if sheet.lines is not None else (sheet.first_line or 1) + rows
        column = RawColumn(str(signal).strip(), cells, unit_text)
        parts.append((replace(sheet, columns=(column,), lines=lines), rows))
    return parts


def _in_order(sheet: Sheet, clock: SheetClock, doubts: list[str]) -> TimedSheet:
    """Return one signal of a file in long form, sorted by time, and append the doubts about it.

    The last of several values at one time is kept. Rows before the first value are removed.
    """
    column = sheet.columns[0]
    values, _ = numbers_of(column, sheet.decimal)
    order = np.argsort(clock.time_s, kind="stable")
    time_s = clock.time_s[order]
    timeless = ~np.isfinite(time_s)
    last = ~timeless & np.append(np.diff(time_s) != 0.0, True)
    begun = np.cumsum(np.isfinite(values[order])) > 0
    sorted_rows = order[last & (begun | ~np.isfinite(values).any())]
    lost_values = order[~last & ~timeless & np.isfinite(values[order])]
    for rows, reason in ((order[timeless], "no time"), (lost_values, "the time of another of their signal")):
        if len(rows):
            shown = sheet.place(int(rows.min()))
            doubts.append(
                f"{column.name}: {len(rows)} rows with {reason} were left out, the first in {shown}"
            )
    words = []
    if column.is_text:
        left_out = np.setdiff1d(np.arange(len(column)), sorted_rows)
        words = [
            cell for cell in column.values.take(left_out[~np.isfinite(values[left_out])]).to_pylist() if cell
        ]
    part = _rows(sheet, sorted_rows)
    part = replace(part, columns=(replace(part.columns[0], dropped=tuple(words)),))
    return TimedSheet(part, replace(clock, time_s=clock.time_s[sorted_rows]), is_held=True)


def by_clock(sheet: Sheet, options: Logs) -> list[Sheet]:
    """Return the parts of a sheet in which each group of columns has its own clock; usually the whole
    sheet.

    A group begins with a column of times, as in exports with a time for each signal. Groups whose times agree
    within 1 µs stay together.
    """
    if options.time is not None or options.every_s is not None or sheet.time_s is not None:
        return [sheet]
    at = [i for i, c in enumerate(sheet.columns) if is_called_time(c.name)]
    if len(at) < 2 or at[0] != 0 or any(b - a < 2 for a, b in itertools.pairwise([*at, len(sheet.columns)])):
        return [sheet]
    groups = [sheet.columns[a:b] for a, b in itertools.pairwise([*at, len(sheet.columns)])]
    parts = [replace(sheet, columns=group) for group in groups]
    try:
        clocks = [clock_of(replace(part, columns=part.columns[:1]), options) for part in parts]
    except LogError:
        return [sheet]
    if any(clock is None for clock in clocks):
        return [sheet]
    times = [clock.time_s for clock in clocks if clock is not None]
    if all(np.allclose(times[0] - times[0][0], t - t[0], rtol=0.0, atol=1e-6, equal_nan=True) for t in times):
        return [sheet]
    filled = [np.flatnonzero(np.isfinite(time_s)) for time_s in times]
    return [_rows(part, rows) for part, rows in zip(parts, filled, strict=True)]


def _with_times(
    sheet: Sheet, clock: SheetClock, problems: list[str], doubts: list[str], before: str
) -> TimedSheet:
    """Return a sheet without the rows that lack a time; times that go back are appended to `problems`."""
    doubts += [before + sentence for sentence in clock.doubts]
    has_time = np.isfinite(clock.time_s)
    if not has_time.all():
        first, missing_count = sheet.place(int(np.flatnonzero(~has_time)[0])), int((~has_time).sum())
        subject = (
            f"{missing_count} rows, the first in {first}, have"
            if missing_count > 1
            else f"the row in {first} has"
        )
        doubts.append(f"{before}{subject} no time and {'were' if missing_count > 1 else 'was'} left out")
        sheet, clock = _rows(sheet, np.flatnonzero(has_time)), replace(clock, time_s=clock.time_s[has_time])
    steps = np.diff(clock.time_s)
    if len(steps) and (steps == 0.0).any() and not (steps < 0.0).any():
        doubts.append(f"{before}{int((steps == 0.0).sum())} {_TWICE}")
        clock = replace(clock, time_s=_spread(clock))
    problems += [before + text for text in _going_back(sheet, clock)]
    return TimedSheet(sheet, clock)


def _going_back(sheet: Sheet, clock: SheetClock) -> Iterator[str]:
    """Yield a sentence for each row whose time is earlier than that of the row above it."""
    steps = np.diff(clock.time_s)
    for row in np.flatnonzero(steps < 0.0):
        if clock.on_wall and abs(steps[row] + HOUR_S) < 0.2 * HOUR_S:
            hint = 'looks like the end of daylight saving time; set [log] timezone, such as "Europe/Berlin"'
        else:
            hint = "sort the rows, or split the log there"
        yield f"{sheet.place(int(row) + 1)}: the time goes back by {-steps[row]:.6g} s; {hint}"


def _spread(clock: SheetClock) -> np.ndarray:
    """Return times (n,) in which equal ones are spread evenly until the next one."""
    time_s = clock.time_s
    unique, first, counts = np.unique(time_s, return_index=True, return_counts=True)
    gaps_s = np.diff(unique, append=unique[-1] + (np.median(np.diff(unique)) if len(unique) > 1 else 1.0))
    usual_s = float(np.median(gaps_s))
    group = np.repeat(np.arange(len(unique)), counts)
    part = (np.arange(len(time_s)) - first[group]) / counts[group]
    return np.asarray(time_s + part * np.minimum(gaps_s, usual_s)[group])


def _rows(sheet: Sheet, rows: np.ndarray | BoolArray) -> Sheet:
    """Return a sheet with these rows only."""
    columns = tuple(
        replace(c, values=c.values.take(rows) if c.is_text else c.values[rows]) for c in sheet.columns
    )
    lines = sheet.lines[rows] if sheet.lines is not None else (sheet.first_line or 1) + np.asarray(rows)
    return replace(sheet, columns=columns, lines=lines, time_s=None)
