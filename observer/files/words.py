"""Words in cells of a log that were read as missing values, counted: only an empty cell surely means it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from observer.frames import FloatArray

MISSING_WORDS = ("NaN", "nan", "NA", "N/A", "null", "NULL")
"""Words that stand for a missing value; an infinite number is one as well."""
MOST_TOLD = 3
_ANY = re.compile(rb"[,\n\"][ \t]*[+-]?(?:nan|inf|infinity|na|n/a|null)[ \t]*(?=[,\r\n\"]|\Z)", re.IGNORECASE)


class Words(NamedTuple):
    """Cells of a column that were read as missing because of what they say: how many, and what."""

    column: str
    cells: int
    say: tuple[str, ...]

    @property
    def text(self) -> str:
        """The same as a sentence without full stop, with what to do."""
        say, read = ("cell says", "was read") if self.cells == 1 else ("cells say", "were read")
        words = ", ".join(self.say[:MOST_TOLD]) + (", …" if len(self.say) > MOST_TOLD else "")
        return (
            f"channel {self.column}: {self.cells} {say} {words} and {read} as missing; look why the recorder "
            "wrote that, and leave empty what is missing"
        )


def words_in(data: bytes, header: Sequence[str], columns: Mapping[str, FloatArray]) -> tuple[Words, ...]:
    """Return the words in the text of a CSV, by the numbers (n,) that its columns were read as."""
    if not (found := {name: values for name, values in columns.items() if not np.isfinite(values).all()}):
        return ()
    if _ANY.search(data, max(data.find(b"\n"), 0)) is None:
        return ()
    import pyarrow as pa  # noqa: PLC0415 - slow to import, and the daemon reads no log
    from pyarrow import csv as pa_csv  # noqa: PLC0415

    table = pa_csv.read_csv(
        pa.py_buffer(data),
        read_options=pa_csv.ReadOptions(column_names=list(header), skip_rows=1),
        convert_options=pa_csv.ConvertOptions(
            column_types=dict.fromkeys(found, pa.string()), include_columns=list(found)
        ),
    )
    said = (_said(name, table.column(name), ~np.isfinite(values)) for name, values in found.items())
    return tuple(words for words in said if words.cells)


def _said(name: str, texts: Any, missing: Any) -> Words:
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.compute as pc  # noqa: PLC0415

    cells = pc.utf8_trim_whitespace(texts.filter(pa.array(missing)))
    counts = {entry["values"]: entry["counts"] for entry in pc.value_counts(cells).to_pylist()}
    counts.pop("", None)
    return Words(name, sum(counts.values()), tuple(sorted(counts, key=lambda word: (-counts[word], word))))


def infinite_in(columns: Mapping[str, FloatArray]) -> tuple[Words, ...]:
    """Return what stands for missing values in columns (n,) that were numbers already: infinite ones."""
    counts = {name: int(np.isinf(values).sum()) for name, values in columns.items()}
    return tuple(Words(name, count, ("inf",)) for name, count in counts.items() if count)
