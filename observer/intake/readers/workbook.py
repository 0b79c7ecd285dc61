"""Workbooks of spreadsheets: every sheet that holds a table."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from observer.errors import LogError
from observer.files.regular import one_line
from observer.intake.layout import SAMPLE_LINES, decimal_of, layout_of, names_of
from observer.intake.sheets import RawColumn, Sheet
from observer.tables.logs import Logs

_LEAST_ROWS = 2


def read_workbook(path: Path, how: Logs) -> list[Sheet]:
    """Read the tables of a workbook. Raises `LogError`."""
    from python_calamine import CalamineError, CalamineWorkbook  # noqa: PLC0415 - of an extra

    try:
        book = CalamineWorkbook.from_path(path)
        grids = {
            name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in book.sheet_names
        }
    except CalamineError as error:
        raise LogError(f"{path}: damaged or not a workbook ({one_line(str(error))}); save it again") from None
    found = {name: sheet for name, grid in grids.items() if (sheet := _sheet(path, name, grid, how))}
    if len(found) > 1:
        return list(found.values())
    return [Sheet(s.path, "", s.columns, decimal=s.decimal, lines=s.lines) for s in found.values()]


def _sheet(path: Path, name: str, grid: Sequence[Sequence[Any]], how: Logs) -> Sheet | None:
    """The table of a sheet, None where it holds none."""
    rows = [[shown(cell) for cell in row] for row in grid[:SAMPLE_LINES]]
    rows = [row[: max((i + 1 for i, cell in enumerate(row) if cell), default=0)] for row in rows]
    width = max(map(len, rows), default=0)
    padded = [row + [""] * (width - len(row)) if sum(map(bool, row)) > 1 else row for row in rows]
    layout = layout_of(padded, how.skip_rows, how.units_row)
    data = grid[layout.data :]
    if layout.width < 1 or len(data) < _LEAST_ROWS:
        return None
    kept = [i for i, row in enumerate(data) if any(cell not in ("", None) for cell in row)]
    units = padded[layout.units] if layout.units >= 0 else []
    names = names_of(padded[layout.header] if layout.header >= 0 else [], units, layout.width)
    columns = []
    for i, (column, unit) in enumerate(names):
        cells = [data[k][i] if i < len(data[k]) else "" for k in kept]
        if any(cell not in ("", None) for cell in cells):
            columns.append(RawColumn(column, cells_of(cells), unit))
    decimal = how.decimal or decimal_of(padded[layout.data :])
    lines = np.array(kept, np.int64) + layout.data + 1
    return Sheet(path, name, tuple(columns), decimal=decimal, lines=lines)


def shown(cell: Any) -> str:
    """A cell as text."""
    if isinstance(cell, datetime.datetime):
        return cell.isoformat(" ")
    if isinstance(cell, float) and cell.is_integer():
        return str(int(cell))
    return "" if cell is None else str(cell)


def cells_of(cells: Sequence[Any]) -> Any:
    """Cells of a column as numbers, moments or text, whichever all of them are."""
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
