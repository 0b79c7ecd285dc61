"""Workbooks of spreadsheets: every sheet that holds a table."""

from __future__ import annotations

import datetime
import pickle
import resource
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from observer.config.logs import Logs
from observer.errors import LogError
from observer.files.log_checks import several
from observer.files.regular import one_line
from observer.intake.cells import without_units
from observer.intake.headers import above_the_table, another_header, headers_left_out, repeated_headers
from observer.intake.layout import SAMPLE_LINES, decimal_of, layout_of, names_of, numeric_columns
from observer.intake.sheets import RawColumn, Sheet

_LEAST_ROWS = 2
MEMORY_BYTES = 4 << 30
"""Of address space: a sheet of a million rows and ten columns takes half of it."""


def read_workbook(path: Path, options: Logs) -> list[Sheet]:
    """Read the tables of a workbook, in a process of its own with at most 4 GiB of memory.

    A single cell far from the others makes the reader of workbooks allocate the whole grid between them. This
    would end the process without an exception.

    Args:
        path: The workbook.
        options: The `[log]` table; `skip_rows` and `units_row` replace guesses.

    Returns:
        A sheet for each one that holds a table; the only one has no name.

    Raises:
        LogError: The workbook is damaged, exceeds the memory, or a sheet holds two tables.
        ModuleNotFoundError: python_calamine is not installed.
    """
    import python_calamine  # noqa: F401, PLC0415 - of an extra, whose absence is reported from here

    run = subprocess.run(
        [sys.executable, "-m", __name__],
        input=pickle.dumps((path, options)),
        capture_output=True,
        check=False,
    )
    if run.returncode != 0:
        raise LogError(
            f"{path}: cannot be read within {MEMORY_BYTES >> 30} GiB of memory; delete cells far outside the "
            "table, or save the table as CSV"
        )
    answer = pickle.loads(run.stdout)
    if isinstance(answer, str):
        raise LogError(answer)
    return list(answer)


def _answer(path: Path, options: Logs) -> list[Sheet] | str:
    """Return the tables of a workbook, or a sentence why it cannot be read."""
    from python_calamine import CalamineError, CalamineWorkbook  # noqa: PLC0415

    try:
        book = CalamineWorkbook.from_path(path)
        grids = {
            name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in book.sheet_names
        }
        sheets = {name: sheet for name, grid in grids.items() if (sheet := _sheet(path, name, grid, options))}
    except (CalamineError, OSError, ValueError) as error:
        return f"{path}: damaged or not a workbook ({one_line(str(error))}); save it again"
    except LogError as error:
        return str(error)
    if len(sheets) > 1:
        return list(sheets.values())
    return [replace(sheet, name="") for sheet in sheets.values()]


def _sheet(path: Path, name: str, grid: Sequence[Sequence[Any]], options: Logs) -> Sheet | None:
    """Return the table of a sheet; None if it holds no table. Raises `LogError` for a second table."""
    rows = [[shown(cell) for cell in row] for row in grid[:SAMPLE_LINES]]
    rows = [row[: max((i + 1 for i, cell in enumerate(row) if cell), default=0)] for row in rows]
    width = max(map(len, rows), default=0)
    padded = [row + [""] * (width - len(row)) if sum(map(bool, row)) > 1 else row for row in rows]
    layout = layout_of(padded, options.skip_rows, options.units_row)
    data = grid[layout.data :]
    if layout.width < 1 or len(data) < _LEAST_ROWS:
        return None
    filled_rows = [i for i, row in enumerate(data) if any(cell not in ("", None) for cell in row)]
    units = padded[layout.units] if layout.units >= 0 else []
    header = padded[layout.header] if layout.header >= 0 else []
    numeric = numeric_columns(padded[layout.data :], layout.width)
    texts = (
        (i, [shown(cell).strip() for cell in row])
        for i, row in enumerate(data)
        if all(k < len(row) and isinstance(row[k], str) and row[k] for k in numeric)
    )
    repeated, other = repeated_headers(texts, [header, units], numeric)
    if other:
        raise several(path, [f'"{name}", {another_header(layout.data + 1 + other[0])}'])
    doubts = headers_left_out([layout.data + 1 + i for i in repeated])
    doubts += above_the_table([i + 1 for i in layout.above])
    filled_rows = [i for i in filled_rows if i not in set(repeated)]
    names = names_of(header, units, layout.width)
    columns = []
    for i, (column, unit) in enumerate(names):
        cells = [data[k][i] if i < len(data[k]) else "" for k in filled_rows]
        if any(cell not in ("", None) for cell in cells):
            columns.append(without_units(RawColumn(column, cells_of(cells), unit)))
    decimal = options.decimal or decimal_of(padded[layout.data :])
    lines = np.array(filled_rows, np.int64) + layout.data + 1
    return Sheet(path, name, tuple(columns), decimal=decimal, lines=lines, doubts=tuple(doubts))


def shown(cell: Any) -> str:
    """Return a cell as text: dates in ISO 8601, whole numbers without a decimal point, empty for None."""
    if isinstance(cell, datetime.datetime):
        return cell.isoformat(" ")
    if isinstance(cell, float) and cell.is_integer():
        return str(int(cell))
    return "" if cell is None else str(cell)


def cells_of(cells: Sequence[Any]) -> Any:
    """Return the cells of a column as numbers, moments or text, whichever all of them are.

    Args:
        cells: Cells (n,) as the reader of workbooks gives them.

    Returns:
        float64 with NaN (durations in s), `datetime64[ns]` with NaT, or a pyarrow array of strings with
            nulls.
    """
    filled = [cell for cell in cells if cell not in ("", None)]
    if all(isinstance(cell, int | float) for cell in filled):
        return np.array([np.nan if cell in ("", None) else float(cell) for cell in cells])
    if all(isinstance(cell, datetime.timedelta) for cell in filled):
        return np.array([np.nan if cell in ("", None) else cell.total_seconds() for cell in cells])
    if all(isinstance(cell, datetime.date) for cell in filled):
        return np.array(
            [np.datetime64("NaT") if cell in ("", None) else cell for cell in cells], "datetime64[ns]"
        )
    import pyarrow as pa  # noqa: PLC0415 - slow to import

    return pa.array([shown(cell) or None for cell in cells], pa.string())


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    sys.stdout.buffer.write(pickle.dumps(_answer(*pickle.load(sys.stdin.buffer))))
