"""The sheets of files with their clocks, in order: what can be mapped to channels."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from observer.errors import LogError
from observer.frames import BoolArray
from observer.intake.cells import numbers_of
from observer.intake.clock import HOUR_S, SheetClock, clock_of, is_called_time
from observer.intake.readers import read_sheets
from observer.intake.sheets import RawColumn, Sheet
from observer.tables.logs import Logs, LongForm

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
    """A sheet whose rows have increasing times; `held`: it is one signal of a file in long form."""

    sheet: Sheet
    clock: SheetClock
    held: bool = False


@dataclass(frozen=True, slots=True)
class Sources:
    """All sheets of some files; `problems` are sentences that begin with a file's name where there are
    several.

    `without` are sheets that have no clock, `long` the columns of name and value of files that are in long
    form.
    """

    timed: tuple[TimedSheet, ...]
    problems: tuple[str, ...]
    doubts: tuple[str, ...]
    without: tuple[Sheet, ...] = ()
    long: LongForm | None = None


def sources_of(paths: Sequence[Path], how: Logs, *, accept_truncated: bool = False) -> Sources:
    """Reads files and finds the clock of each of their sheets. Raises `LogError` where one cannot be read."""
    timed, problems, doubts, without, long = list[TimedSheet](), list[str](), list[str](), list[Sheet](), None
    for path in paths:
        before = f"{path.name}: " if len(paths) > 1 else ""
        try:
            sheets = read_sheets(path, how, accept_truncated)
        except LogError as error:
            if len(paths) == 1:
                raise
            problems.append(str(error))
            continue
        doubts += [before + sentence for sheet in sheets for sentence in sheet.doubts]
        for sheet in itertools.chain.from_iterable(by_clock(whole, how) for whole in sheets):
            try:
                clock = clock_of(sheet, how)
            except LogError as error:
                problems.append(before + str(error))
                continue
            if clock is None:
                without.append(sheet)
                continue
            form = how.long or _long_form_of(sheet)
            parts = _widened(sheet, form) if form else []
            long = form if parts else long
            if not parts:
                timed.append(_sound(sheet, clock, problems, doubts, before))
                continue
            doubts += [before + sentence for sentence in clock.doubts]
            for part, rows in parts:
                timed.append(_in_order(part, replace(clock, time_s=clock.time_s[rows]), doubts))
    return Sources(tuple(timed), tuple(problems), tuple(doubts), tuple(without), long)


def _long_form_of(sheet: Sheet) -> LongForm | None:
    """The columns of name and value of a sheet in long form; None for any other."""
    names = [c for c in sheet.columns if c.is_text and _NAME.match(c.name.strip().replace("_", ""))]
    values = [c for c in sheet.columns if _VALUE.match(c.name.strip().replace("_", ""))]
    for column in names:
        different = len(column.values.unique())
        if values and different <= min(_MOST_SIGNALS, max(len(column) // 2, 1)):
            return LongForm(name=column.name, value=values[0].name)
    return None


def _widened(sheet: Sheet, form: LongForm) -> list[tuple[Sheet, NDArray[np.int64]]]:
    """A sheet of one column for each signal, and the rows (k,) of the file's that are its own."""
    name, value = sheet.named(form.name), sheet.named(form.value)
    if name is None or value is None or not name.is_text:
        return []
    encoded = name.values.dictionary_encode()
    codes = np.asarray(encoded.indices.fill_null(-1).to_numpy(zero_copy_only=False))
    unit = next((c for c in sheet.columns if c.is_text and c.name.strip().lower() in _UNITS), None)
    found = []
    for code, signal in enumerate(encoded.dictionary.to_pylist()):
        rows = np.flatnonzero(codes == code)
        said = "" if unit is None else str(unit.values[int(rows[0])].as_py() or "")
        cells = value.values.take(rows) if value.is_text else value.values[rows]
        lines = sheet.lines[rows] if sheet.lines is not None else (sheet.first_line or 1) + rows
        column = RawColumn(str(signal).strip(), cells, said)
        found.append((replace(sheet, columns=(column,), lines=lines), rows))
    return found


def _in_order(sheet: Sheet, clock: SheetClock, doubts: list[str]) -> TimedSheet:
    """One signal of a file in long form: by time, of several values at once the last, without rows before its
    first value.
    """
    column = sheet.columns[0]
    values, _ = numbers_of(column, sheet.decimal)
    order = np.argsort(clock.time_s, kind="stable")
    time_s = clock.time_s[order]
    timeless = ~np.isfinite(time_s)
    last = ~timeless & np.append(np.diff(time_s) != 0.0, True)
    begun = np.cumsum(np.isfinite(values[order])) > 0
    kept = order[last & (begun | ~np.isfinite(values).any())]
    lost_values = order[~last & ~timeless & np.isfinite(values[order])]
    for rows, reason in ((order[timeless], "no time"), (lost_values, "the time of another of their signal")):
        if len(rows):
            shown = sheet.place(int(rows.min()))
            doubts.append(
                f"{column.name}: {len(rows)} rows with {reason} were left out, the first in {shown}"
            )
    words = []
    if column.is_text:
        left_out = np.setdiff1d(np.arange(len(column)), kept)
        words = [
            cell for cell in column.values.take(left_out[~np.isfinite(values[left_out])]).to_pylist() if cell
        ]
    part = _rows(sheet, kept)
    part = replace(part, columns=(replace(part.columns[0], dropped=tuple(words)),))
    return TimedSheet(part, replace(clock, time_s=clock.time_s[kept]), held=True)


def by_clock(sheet: Sheet, how: Logs) -> list[Sheet]:
    """The parts of a sheet in which each group of columns follows a clock of its own; usually the sheet."""
    if how.time is not None or how.every_s is not None or sheet.time_s is not None:
        return [sheet]
    at = [i for i, c in enumerate(sheet.columns) if is_called_time(c.name)]
    if len(at) < 2 or at[0] != 0 or any(b - a < 2 for a, b in itertools.pairwise([*at, len(sheet.columns)])):
        return [sheet]
    groups = [sheet.columns[a:b] for a, b in itertools.pairwise([*at, len(sheet.columns)])]
    parts = [replace(sheet, columns=group) for group in groups]
    try:
        clocks = [clock_of(replace(part, columns=part.columns[:1]), how) for part in parts]
    except LogError:
        return [sheet]
    if any(clock is None for clock in clocks):
        return [sheet]
    times = [clock.time_s for clock in clocks if clock is not None]
    if all(np.allclose(times[0] - times[0][0], t - t[0], rtol=0.0, atol=1e-6, equal_nan=True) for t in times):
        return [sheet]
    filled = [np.flatnonzero(np.isfinite(time_s)) for time_s in times]
    return [_rows(part, rows) for part, rows in zip(parts, filled, strict=True)]


def _sound(
    sheet: Sheet, clock: SheetClock, problems: list[str], doubts: list[str], before: str
) -> TimedSheet:
    """A sheet without the rows that lack a time; reports those that go back."""
    doubts += [before + sentence for sentence in clock.doubts]
    there = np.isfinite(clock.time_s)
    if not there.all():
        first, lost = sheet.place(int(np.flatnonzero(~there)[0])), int((~there).sum())
        which = f"{lost} rows, the first in {first}, have" if lost > 1 else f"the row in {first} has"
        doubts.append(f"{before}{which} no time and {'were' if lost > 1 else 'was'} left out")
        sheet, clock = _rows(sheet, np.flatnonzero(there)), replace(clock, time_s=clock.time_s[there])
    steps = np.diff(clock.time_s)
    if len(steps) and (steps == 0.0).any() and not (steps < 0.0).any():
        doubts.append(f"{before}{int((steps == 0.0).sum())} {_TWICE}")
        clock = replace(clock, time_s=_spread(clock))
    problems += [before + text for text in _going_back(sheet, clock)]
    return TimedSheet(sheet, clock)


def _going_back(sheet: Sheet, clock: SheetClock) -> Iterator[str]:
    """A sentence for each row whose time lies before that of the row above it."""
    steps = np.diff(clock.time_s)
    for row in np.flatnonzero(steps < 0.0):
        if clock.on_wall and abs(steps[row] + HOUR_S) < 0.2 * HOUR_S:
            hint = 'looks like the end of daylight saving time; set [log] timezone, such as "Europe/Berlin"'
        else:
            hint = "sort the rows, or split the log there"
        yield f"{sheet.place(int(row) + 1)}: the time goes back by {-steps[row]:.6g} s; {hint}"


def _spread(clock: SheetClock) -> np.ndarray:
    """Times of which several are equal, spread evenly until the next one."""
    time_s = clock.time_s
    unique, first, counts = np.unique(time_s, return_index=True, return_counts=True)
    gaps_s = np.diff(unique, append=unique[-1] + (np.median(np.diff(unique)) if len(unique) > 1 else 1.0))
    usual_s = float(np.median(gaps_s))
    which = np.repeat(np.arange(len(unique)), counts)
    part = (np.arange(len(time_s)) - first[which]) / counts[which]
    return np.asarray(time_s + part * np.minimum(gaps_s, usual_s)[which])


def _rows(sheet: Sheet, rows: np.ndarray | BoolArray) -> Sheet:
    """Some rows of a sheet."""
    columns = tuple(
        replace(c, values=c.values.take(rows) if c.is_text else c.values[rows]) for c in sheet.columns
    )
    lines = sheet.lines[rows] if sheet.lines is not None else (sheet.first_line or 1) + np.asarray(rows)
    return replace(sheet, columns=columns, lines=lines, time_s=None)
