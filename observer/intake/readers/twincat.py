"""Exports of TwinCAT Scope as text: each signal has a column of times of its own, in ms."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from observer.files.log_checks import several
from observer.intake.cells import numbers_of
from observer.intake.dates import moment_of
from observer.intake.layout import decimal_of
from observer.intake.sheets import RawColumn, Sheet

_S_1601 = 11_644_473_600.0
"""Seconds from 1601, where FILETIME begins, to 1970."""
_FIRST_LINES = 20
_NAME, _UNIT, _DATA_TYPE = "Name", "Unit", "Data-Type"


def recognises(text: str) -> bool:
    """Return whether a text is such an export: it has a start time and the type of each signal."""
    head = text[:20_000]
    return "Starttime" in head and "SampleTime[ms]" in head


def read(path: Path, text: str) -> list[Sheet]:
    """Read each signal as a sheet with its own times.

    Times count from 1970 if the start is understood. A start in words is a wall clock's.

    Raises:
        LogError: The file has no rows below the names of its signals.
    """
    mark = next((m for m in ("\t", ";", ",") if f"{m}" in text.split("\n", 1)[0]), "\t")
    rows = [line.split(mark) for line in text.split("\n")]
    type_row = next((i for i, row in enumerate(rows) if row[0] == _DATA_TYPE), None)
    first = next((i for i in range(type_row or 0, len(rows)) if _is_time(rows[i][0])), None)
    if type_row is None or first is None:
        raise several(path, ["has no rows of values below the names of its signals; export it again"])
    names = max((rows[i] for i in range(first) if rows[i][0] == _NAME), key=len)
    units = next((rows[i] for i in range(type_row, first) if rows[i][0] == _UNIT), [])
    data = [(i, rows[i]) for i in range(first, len(rows)) if any(cell.strip() for cell in rows[i])]
    decimal = decimal_of([row for _, row in data])
    start_s, on_wall, doubts = _start({row[0]: row[1:] for row in rows[:_FIRST_LINES] if row[0]})
    sheets = []
    for k in range(1, len(names), 2):
        samples = [(i, row) for i, row in data if len(row) > k and _is_time(row[k - 1])]
        times, cells = (
            [row[k - 1].strip() for _, row in samples],
            [row[k].strip() or None for _, row in samples],
        )
        since_ms, _ = numbers_of(RawColumn("time", pa.array(times, pa.string())), decimal)
        unit = units[k].strip() if k < len(units) and "None" not in units[k] else ""
        name = names[k].strip()
        sheets.append(
            Sheet(
                path,
                name,
                (RawColumn(name, pa.array(cells, pa.string()), unit),),
                (start_s or 0.0) + since_ms / 1000.0,
                since_1970=start_s is not None,
                on_wall=on_wall,
                decimal=decimal,
                lines=np.array([i + 1 for i, _ in samples], np.int64),
                doubts=doubts if k == 1 else (),
            )
        )
    return sheets


def _is_time(cell: str) -> bool:
    return bool(re.fullmatch(r"[+-]?\d+(?:[.,]\d+)?", cell.strip()))


def _start(header: Mapping[str, Sequence[str]]) -> tuple[float | None, bool, tuple[str, ...]]:
    """Return when the times begin, in s since 1970, None if unknown; whether on a wall clock; doubts.

    The date in words is a wall clock's. The number beside it is used if the words are not understood.
    """
    cells = next((cells for key, cells in header.items() if key.startswith("Starttime")), [])
    if len(cells) > 2 and (moment := moment_of(f"{cells[1]} {cells[2]}")) is not None:
        return moment, True, ()
    try:
        return float(cells[0]) * 1e-7 - _S_1601, False, ()
    except (IndexError, ValueError):
        return None, False, ("the export does not say when it started; its times count from its beginning",)
