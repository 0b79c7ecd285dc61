"""From text to numbers: decimals, thousands, and recorders' words for a missing value."""

from __future__ import annotations

from typing import Any

import numpy as np

from observer.files.log_checks import Words
from observer.frames import FloatArray
from observer.intake.sheets import RawColumn

_NUMBER = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"


def numbers_of(column: RawColumn, decimal: str) -> tuple[FloatArray, Words]:
    """The values (n,) of a column, NaN where a cell is empty or says something else, and what those say."""
    if not column.is_text:
        values = column.values.astype(np.float64)
        lost = int(np.isinf(values).sum())
        return np.where(np.isfinite(values), values, np.nan), Words(column.name, lost, ("inf",) * bool(lost))
    import pyarrow as pa  # noqa: PLC0415 - slow to import, and the daemon reads no log
    import pyarrow.compute as pc  # noqa: PLC0415

    said = pc.utf8_trim_whitespace(column.values)
    cells = plain_numbers(said, decimal)
    numeric = pc.fill_null(pc.match_substring_regex(cells, _NUMBER), fill_value=False)
    values = pc.cast(pc.if_else(numeric, cells, pa.scalar(None, pa.string())), pa.float64())
    found = np.array(values.to_numpy(zero_copy_only=False), dtype=np.float64)
    others = pc.value_counts(said.filter(pc.invert(numeric)))
    counts = {str(e["values"]): int(e["counts"]) for e in others.to_pylist() if e["values"]}
    if infinite := int(np.isinf(found).sum()):
        counts["inf"] = infinite
    found[np.isinf(found)] = np.nan
    words = tuple(sorted(counts, key=lambda word: (-counts[word], word)))
    return found, Words(column.name, sum(counts.values()), words)


def plain_numbers(cells: Any, decimal: str) -> Any:
    """Cells whose numbers are written with a point, without thousands, plus and percent signs."""
    import pyarrow.compute as pc  # noqa: PLC0415

    cells = pc.replace_substring_regex(cells, r"^\+|\s*%$", "")
    cells = pc.replace_substring_regex(cells, r"[ '’\x{00A0}\x{202F}](\d{3})\b", r"\1")
    if decimal == ",":
        cells = pc.replace_substring_regex(cells, r"\.(\d{3})(?:\b)", r"\1")
        return pc.replace_substring(cells, ",", ".", max_replacements=1)
    return pc.replace_substring_regex(cells, r",(\d{3})\b", r"\1")
