"""LabVIEW measurements (.lvm): segments, each with a header of its own."""

from __future__ import annotations

import datetime
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from observer.errors import LogError
from observer.frames import FloatArray
from observer.intake.sheets import RawColumn, Sheet

S_1904 = 2_082_844_800.0
"""Seconds from 1904, where LabVIEW counts from, to 1970."""
_END = "***End_of_Header***"


def read_lvm(path: Path, text: str) -> list[Sheet]:
    """Read the segments of a LabVIEW measurement, those of the same channels as one sheet.

    Times count from 1970 if the file has a date. They are wall-clock times unless the file has absolute ones.

    Args:
        path: The file, named in errors.
        text: Its text.

    Raises:
        LogError: The end of the header is missing.
    """
    lines = text.splitlines()
    mark = "," if "Separator\tComma" in text or "Separator,Comma" in text else "\t"
    cells = [line.split(mark) for line in lines]
    ends = [i for i, row in enumerate(cells) if row[0].strip() == _END]
    if not ends:
        raise LogError(f"{path}: has no {_END}, which a LabVIEW measurement has; export it again")
    head = {row[0].strip(): row[1].strip() for row in cells[: ends[0]] if len(row) > 1}
    decimal = _decimal(head)
    starts = ends[1:] or ends[:1]
    sheets: dict[tuple[str, ...], list[tuple[FloatArray, list[list[str]]]]] = {}
    units: dict[tuple[str, ...], Sequence[str]] = {}
    for k, end in enumerate(starts):
        above = cells[(ends[k] if len(ends) > 1 else 0) + 1 : end]
        segment = {row[0].strip(): row[1:] for row in above if row[0].strip()} if len(ends) > 1 else {}
        names = [name.strip() for name in cells[end + 1]]
        last = starts[k + 1] if k + 1 < len(starts) else len(cells)
        rows = [row for row in cells[end + 2 : last] if _is_row(row)]
        labels = segment.get("Y_Unit_Label", [])
        for begin, stop in _clocked(head, names):
            clock_rows = [row[begin:stop] for row in rows if any(cell.strip() for cell in row[begin:stop])]
            if not clock_rows:
                continue
            time_s, first = _clock(head, segment, names[begin:stop], clock_rows, decimal)
            at = [i for i in range(first, stop - begin) if names[begin + i] not in ("", "Comment", "X_Value")]
            columns = tuple(names[begin + i] for i in at)
            sheets.setdefault(columns, []).append(
                (time_s, [[row[i] if i < len(row) else "" for i in at] for row in clock_rows])
            )
            units[columns] = [labels[begin + i - 1] if 0 < begin + i <= len(labels) else "" for i in at]
    return [
        _sheet(path, i, head, names, parts, units[names]) for i, (names, parts) in enumerate(sheets.items())
    ]


def _decimal(head: Mapping[str, str]) -> str:
    return head.get("Decimal_Separator") or ("," if head.get("Separator") == "," else ".")


def _sheet(
    path: Path,
    number: int,
    head: Mapping[str, str],
    names: tuple[str, ...],
    parts: list[tuple[FloatArray, list[list[str]]]],
    units: Sequence[str],
) -> Sheet:
    """Return the segments of the same channels as one sheet; `head` is the header of the file."""
    absolute = head.get("Time_Pref") == "Absolute"
    rows = [row for _, part in parts for row in part]
    columns = tuple(
        RawColumn(
            name,
            pa.array([row[i].strip() or None for row in rows], pa.string()),
            units[i].strip() if i < len(units) else "",
        )
        for i, name in enumerate(names)
    )
    time_s = np.concatenate([time_s for time_s, _ in parts])
    return Sheet(
        path,
        f"segment {number + 1}" if number else "",
        columns,
        time_s,
        "Date" in head or absolute,
        on_wall=not absolute,
        decimal=_decimal(head),
    )


def _clocked(head: Mapping[str, str], names: Sequence[str]) -> list[tuple[int, int]]:
    """Return the first and last column of each clock: `X_Columns Multi` gives each signal its own times."""
    at = [i for i, name in enumerate(names) if name == "X_Value"]
    if head.get("X_Columns") != "Multi" or len(at) < 2:
        return [(0, len(names))]
    return list(itertools.pairwise([*at, len(names)]))


def _is_row(row: Sequence[str]) -> bool:
    return (
        any(cell.strip() for cell in row)
        and all("_" not in cell for cell in row[:1])
        and row[0].strip() != _END
        and (row[0].strip() == "" or row[0].strip()[0] in "0123456789+-.,")
    )


def _clock(
    head: Mapping[str, str],
    segment: Mapping[str, Sequence[str]],
    names: Sequence[str],
    rows: Sequence[Sequence[str]],
    decimal: str,
) -> tuple[FloatArray, int]:
    """Return the times (n,) of a segment in s, and its first column of values.

    The times count from 1970 if the segment has a date.
    """

    def number(cell: str) -> float:
        return float(cell.strip().replace(decimal, "."))

    columns = head.get("X_Columns", "One")
    first = 1 if names and names[0] == "X_Value" else 0
    if first and columns != "No" and rows[0][0].strip():
        time_s = np.array([number(row[0]) if row[0].strip() else np.nan for row in rows])
    else:
        step, begin = segment.get("Delta_X", ["1"])[0], segment.get("X0", ["0"])[0]
        time_s = number(begin) + number(step) * np.arange(len(rows))
    if head.get("Time_Pref") == "Absolute" and np.nanmin(time_s) > S_1904:
        return time_s - S_1904, first
    if "Date" not in head:
        return time_s, first
    date = (segment.get("Date") or [head["Date"]])[0].strip() or head["Date"]
    clock = (segment.get("Time") or [head.get("Time", "0:0:0")])[0].strip() or head.get("Time", "0:0:0")
    day = datetime.datetime.strptime(date, "%Y/%m/%d").replace(tzinfo=datetime.UTC).timestamp()
    hours, minutes, seconds = clock.replace(",", ".").split(":")
    return day + 3600.0 * float(hours) + 60.0 * float(minutes) + float(seconds) + time_s, first
