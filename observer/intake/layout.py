"""Finds a table in a file: preamble, header, row of units, data; and its separator."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from observer.files.log_checks import MISSING
from observer.intake.units import known_unit, says_no_unit, split_name

SAMPLE_LINES = 400
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?%?$")
_GROUPED = re.compile(r"[+-]?\d{1,3}(?:[ '’.,]\d{3})+(?:[.,]\d+)?$")
_TIME = re.compile(
    r"(?:\d{1,4}[-./]\d{1,2}[-./]\d{2,4}|\d{1,4}[-. ][A-Za-zä]{3,9}\.?[-. ]\d{2,4}|\d{8}T?|)"
    r"[T ,]*(?:\d{1,3}:\d{2}(?::\d{2})?(?:[.,:]\d+)?|\d{6}(?:[.,]\d+)?)?\s*"
    r"(?:[AP]M)?\s*(?:Z|UTC|GMT|[+-]\d{2}:?\d{2})?$",
    re.I,
)
WITH_UNIT = re.compile(
    r"(?P<number>[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?)\s*(?P<unit>[^\d\s.,;:+-].{0,9})$"
)
"""A number with its unit in one cell."""
_UNIT = r"(?:%|\s*[^\d\s.,;:+-]\S{0,9})?"
_COMMA = re.compile(rf"[+-]?(?:\d{{1,3}}(?:\.\d{{3}})+|\d*),\d+(?:[eE][+-]?\d+)?{_UNIT}$")
_POINT = re.compile(rf"[+-]?(?:\d{{1,3}}(?:,\d{{3}})+|\d*)\.\d+(?:[eE][+-]?\d+)?{_UNIT}$")
_SEPARATORS = (";", "\t", ",", "|", " ")
_FORMAT = re.compile(r"[ymdhsfn/:.\- ]{4,}$", re.I)


def is_value(cell: str) -> bool:
    """Return whether a cell is a number, a time, or a number with a known unit."""
    cell = cell.strip()
    if not cell or not any(c.isdigit() for c in cell):
        return False
    if _NUMBER.match(cell) or _GROUPED.match(cell) or _TIME.match(cell):
        return True
    with_unit = WITH_UNIT.match(cell)
    return with_unit is not None and bool(known_unit(with_unit["unit"]))


@dataclass(frozen=True, slots=True)
class TableLayout:
    """Rows of a table, by number from 0.

    Attributes:
        header: Its header, −1 for none.
        units: Its row of units, −1 for none.
        data: The first row of its data.
        width: Number of columns.
        above: Rows above the header that look like data.
    """

    header: int
    units: int
    data: int
    width: int
    above: tuple[int, ...] = ()


def split_lines(lines: Sequence[str], separator: str) -> list[list[str]]:
    """Return the cells of lines; a separator of one blank matches any number of blanks and tabs."""
    if separator == " ":
        return [line.split() for line in lines]
    return list(csv.reader(lines, delimiter=separator)) if lines else []


def separator_of(lines: Sequence[str]) -> str:
    """Return the separator with which most cells in most lines are values: `;`, tab, `,`, `|` or a blank."""
    return max(_SEPARATORS, key=lambda mark: (_score(split_lines(lines, mark)), -_SEPARATORS.index(mark)))


def _score(rows: Sequence[Sequence[str]]) -> float:
    """Return how well rows form a table of values: larger for more rows and a larger fraction of values."""
    begin, end, width = data_block(rows)
    if width < 2:
        return 0.0
    cells = [cell for row in rows[begin:end] for cell in row if cell.strip()]
    good = sum(map(is_value, cells)) / max(len(cells), 1)
    named = any(len(row) == width and is_header(row) for row in rows[max(begin - 3, 0) : begin])
    return (2.0 if named else 1.0) * good**4 * (end - begin) + 1e-3 * good


def data_block(rows: Sequence[Sequence[str]]) -> tuple[int, int, int]:
    """Return the longest run of rows of one width with values in them.

    Text of the same width ends a run. Blank rows and rows of another width between two runs do not. Runs of
    one column count only if no other run is wider.

    Returns:
        Its first row, the row after its last, and its width; zeros if no row has a value.
    """
    filled = [(i, row) for i, row in enumerate(rows) if any(cell.strip() for cell in row)]
    runs: list[tuple[int, int, int]] = []  # begin, end, width
    last: dict[int, int] = {}  # the last run of a width, -1 after text of that width
    for (width, valued), run in groupby(
        filled, key=lambda numbered: (len(numbered[1]), _has_values(numbered[1]))
    ):
        numbers = [i for i, _ in run]
        if not valued:
            last[width] = -1
        elif (before := last.get(width, -1)) >= 0:
            runs[before] = (runs[before][0], numbers[-1] + 1, width)
        else:
            last[width] = len(runs)
            runs.append((numbers[0], numbers[-1] + 1, width))
    wide_runs = [run for run in runs if run[2] > 1] or runs
    return max(wide_runs, key=lambda run: run[1] - run[0], default=(0, 0, 0))


def _has_values(row: Sequence[str]) -> bool:
    """Whether a row is one of data: its first cell or half of them are values."""
    filled = [cell for cell in row if cell.strip()]
    values = sum(map(is_value, filled))
    return values > 0 and (is_value(filled[0]) or 2 * values >= len(filled))


def _start_of_data(rows: Sequence[Sequence[str]]) -> tuple[int, int]:
    """Return the first row of a table's data and the width of the table.

    The data begin above the longest run of values if only these interrupt them: repeated headers, words for
    missing values, and rows of another width.
    """
    begin, end, width = data_block(rows)
    numeric = numeric_columns(rows[begin:end], width)
    if not numeric:
        return begin, width
    for i in range(begin - 1, -1, -1):
        row = rows[i]
        if len(row) != width or not any(cell.strip() for cell in row):
            continue
        if has_value_in(row, numeric) or all(is_missing(row[k]) for k in numeric):
            begin = i
        elif not any(list(row) == list(rows[k]) for k in range(i)) and is_header(row):
            break
    return begin, width


def numeric_columns(rows: Sequence[Sequence[str]], width: int) -> list[int]:
    """Return the indices of the columns in which most cells of some rows are values.

    Only rows of exactly `width` cells count.
    """
    rows = [row for row in rows if len(row) == width]
    return [i for i in range(width) if 2 * sum(is_value(row[i]) for row in rows) > len(rows)]


def has_value_in(row: Sequence[str], columns: Sequence[int]) -> bool:
    """Return whether a row has a value in one of some columns, and only words for missing values in the
    others.
    """
    return any(is_value(row[k]) for k in columns) and all(
        is_value(row[k]) or is_missing(row[k]) for k in columns
    )


def is_missing(cell: str) -> bool:
    """Return whether a cell is empty or a recorder's word for a missing value, such as `n/a`."""
    return not cell.strip() or cell.strip().casefold() in MISSING


def is_header(row: Sequence[str]) -> bool:
    """Return whether a row may name columns: most of its cells are filled with different words."""
    filled = [cell.strip() for cell in row if cell.strip()]
    return 2 * len(filled) > len(row) and not any(map(is_value, filled)) and len(set(filled)) > len(row) // 2


def layout_of(
    rows: Sequence[Sequence[str]], skip_rows: int | None = None, units_row: bool | None = None
) -> TableLayout:
    """Return the layout of the first rows of a table.

    Args:
        rows: Cells of the first lines of a file, 400 at most.
        skip_rows: Number of lines above the header; None to find the header.
        units_row: Whether a row of units follows the header; None to find out.
    """
    begin, width = _start_of_data(rows)
    if skip_rows is not None:
        header = skip_rows
        below = rows[header + 1] if header + 1 < len(rows) else []
        units = header + 1 if (_is_units(below) if units_row is None else units_row) else -1
        return TableLayout(
            header, units, max(header, units) + 1, max(width, len(rows[header]) if header < len(rows) else 0)
        )
    texts = [i for i in range(begin - 1, max(begin - 6, -1), -1) if any(cell.strip() for cell in rows[i])]
    if not texts or len(rows[texts[0]]) < 2 <= width:
        return TableLayout(-1, -1, begin, width)
    names = [i for i in texts if len(rows[i]) >= 2]
    header, units = names[0], -1
    if units_row:
        header, units = (names[1], names[0]) if len(names) > 1 else (names[0], -1)
    elif units_row is None:
        units = next((i for i in names[:3] if _is_units(rows[i])), -1)
        header = next((i for i in names if i < units), names[0]) if units >= 0 else names[0]
        units = units if header < units else -1
    numeric = numeric_columns(rows[begin:], width)
    above = (i for i in range(header) if len(rows[i]) == width > 1)
    numeric_rows = tuple(i for i in above if numeric and all(is_value(rows[i][k]) for k in numeric))
    return TableLayout(header, units, begin, width, numeric_rows)


def _is_units(row: Sequence[str]) -> bool:
    """Whether most cells of a row are units or formats of a time."""
    cells = [cell.strip().strip("[]()") for cell in row if cell.strip()]
    unit_count = sum(1 for cell in cells if known_unit(cell) or _FORMAT.match(cell) or cell in "-")
    return bool(cells) and 2 * unit_count > len(cells) - 1 and any(known_unit(cell) for cell in cells)


def names_of(header: Sequence[str], units: Sequence[str], width: int) -> list[tuple[str, str]]:
    """Return a name and a unit for each column.

    Args:
        header: Cells of the header; may be shorter than the table.
        units: Cells of the row of units; empty for none.
        width: Number of columns.

    Returns:
        `width` pairs of a unique name and the unit as written. The unit is empty if the name has one or the
            file has none. Unnamed and repeated columns are numbered.
    """
    names: list[tuple[str, str]] = []
    for i in range(width):
        name = header[i].strip() if i < len(header) else ""
        unit = units[i].strip().strip("[]()") if i < len(units) else ""
        unit = "" if says_no_unit(unit) else unit
        name = name or f"column {i + 1}"
        if any(name == other for other, _ in names):
            name = f"{name} ({i + 1})"
        names.append((name, unit if not split_name(name)[1] else ""))
    return names


def decimal_of(rows: Sequence[Sequence[str]]) -> str:
    """Return the decimal separator of the numbers in some rows: `,` if more cells have a decimal comma,
    else `.`.
    """
    cells = [cell.strip() for row in rows for cell in row]
    commas, points = (sum(bool(pattern.match(cell)) for cell in cells) for pattern in (_COMMA, _POINT))
    return "," if commas > points else "."
