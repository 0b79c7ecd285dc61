"""From text to numbers: decimals, thousands, and recorders' words for a missing value."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from observer.files.log_checks import Words
from observer.frames import FloatArray
from observer.intake.sheets import RawColumn
from observer.intake.units import known_unit, split_name

_WITH_UNIT = r"^\s*(?P<n>[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?)\s*(?P<u>[^\d\s.,;:+-].{0,9})$"
_NUMBER = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"


def numbers_of(column: RawColumn, decimal: str) -> tuple[FloatArray, Words]:
    """Return the values (n,) of a column, NaN where a cell is not a number, and the words in such cells.

    Args:
        column: Numbers or text; infinite numbers count as words.
        decimal: Decimal separator of text, `.` or `,`; the other one may group thousands.

    Returns:
        The values in the column's own unit, and how many cells hold words, the most frequent first. Empty
            cells are NaN and not counted.
    """
    if not column.is_text:
        values = column.values.astype(np.float64)
        infinite_count = int(np.isinf(values).sum())
        return np.where(np.isfinite(values), values, np.nan), Words(
            column.name, infinite_count, ("inf",) * bool(infinite_count)
        )
    import pyarrow as pa  # noqa: PLC0415 - slow to import, and the daemon reads no log
    import pyarrow.compute as pc  # noqa: PLC0415

    texts = pc.utf8_trim_whitespace(column.values)
    cells = plain_numbers(texts, decimal)
    numeric = pc.fill_null(pc.match_substring_regex(cells, _NUMBER), fill_value=False)
    values = pc.cast(pc.if_else(numeric, cells, pa.scalar(None, pa.string())), pa.float64())
    values_of_cells = np.array(values.to_numpy(zero_copy_only=False), dtype=np.float64)
    others = pc.value_counts(texts.filter(pc.invert(numeric)))
    counts = {str(e["values"]): int(e["counts"]) for e in others.to_pylist() if e["values"]}
    for word in column.dropped:
        counts[word] = counts.get(word, 0) + 1
    if infinite := int(np.isinf(values_of_cells).sum()):
        counts["inf"] = infinite
    values_of_cells[np.isinf(values_of_cells)] = np.nan
    words = tuple(sorted(counts, key=lambda word: (-counts[word], word)))
    return values_of_cells, Words(column.name, sum(counts.values()), words)


def without_units(column: RawColumn) -> RawColumn:
    """Return the column with a unit that its cells repeat, such as `21.5 °C`, moved to the column's
    `unit`.

    More than half of the filled cells must have that unit. Cells in another unit stay unchanged, so that they
    are counted as words. A unit in the column's name or in a row of its own takes precedence.
    """
    if not column.is_text:
        return column
    import pyarrow.compute as pc  # noqa: PLC0415

    parts = pc.extract_regex(column.values, _WITH_UNIT)
    counts = pc.value_counts(pc.struct_field(parts, "u").filter(pc.is_valid(parts))).to_pylist()
    units = {entry["values"]: entry["counts"] for entry in counts if known_unit(entry["values"])}
    filled = len(column) - column.values.null_count
    best = max(units, key=lambda unit: units[unit], default="")
    if not best or 2 * units[best] <= filled:
        return column
    same = pc.fill_null(pc.equal(pc.struct_field(parts, "u"), best), False)
    numbers = pc.if_else(same, pc.struct_field(parts, "n"), column.values)
    written = column.unit or split_name(column.name)[1]
    return replace(column, values=numbers, unit=column.unit if written else best.strip())


def plain_numbers(cells: Any, decimal: str) -> Any:
    """Return cells whose numbers have a decimal point, without thousands separators, plus and percent
    signs.

    Args:
        cells: A pyarrow array of strings (n,); cells that are not numbers may change too.
        decimal: Decimal separator in the cells, `.` or `,`.
    """
    import pyarrow.compute as pc  # noqa: PLC0415

    cells = pc.replace_substring_regex(cells, r"^\+|\s*%$", "")
    cells = pc.replace_substring_regex(cells, r"[ '’\x{00A0}\x{202F}](\d{3})\b", r"\1")
    if decimal == ",":
        cells = pc.replace_substring_regex(cells, r"\.(\d{3})(?:\b)", r"\1")
        return pc.replace_substring(cells, ",", ".", max_replacements=1)
    return pc.replace_substring_regex(cells, r",(\d{3})\b", r"\1")
