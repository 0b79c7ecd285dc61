"""The result of every format's reader: sheets of plain columns, nothing converted yet."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.frames import FloatArray
from observer.intake.units import split_name


@dataclass(frozen=True, slots=True, eq=False)
class RawColumn:
    """A column with the contents of its file.

    Attributes:
        values: (n,) float64 with NaN, `datetime64[ns]` with NaT, or a pyarrow array of strings with nulls
        unit: the one in the file, empty for none
        utc: whether times are in UTC, not wall-clock times
        dropped: words in cells of rows that were left out
    """

    name: str
    values: Any
    unit: str = ""
    utc: bool = False
    dropped: tuple[str, ...] = ()

    @property
    def is_text(self) -> bool:
        """Whether the cells are text."""
        return not isinstance(self.values, np.ndarray)

    @property
    def is_moments(self) -> bool:
        """Whether the cells are dates with times."""
        return not self.is_text and self.values.dtype.kind == "M"

    def __len__(self) -> int:
        return len(self.values)


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A table of a file: columns of one length, and their clock if the file itself defines it.

    Attributes:
        name: of the group or sheet in its file, empty for the only one
        time_s: (n,) s, where the format has its own clock
        since_1970: whether these count from 1970
        on_wall: whether they are wall-clock times without a zone
        decimal: decimal separator of text
        first_line: line number of the first row where lines are consecutive
        lines: (n,) line numbers of the rows
        left_out: lines of rows that did not fit
        doubts: sentences about rows that were left out
        preamble: lines above the header
    """

    path: Path
    name: str
    columns: tuple[RawColumn, ...]
    time_s: FloatArray | None = None
    since_1970: bool = True
    on_wall: bool = False
    decimal: str = "."
    first_line: int | None = None
    lines: NDArray[np.int64] | None = None
    left_out: tuple[int, ...] = ()
    doubts: tuple[str, ...] = ()
    preamble: tuple[str, ...] = ()

    def place(self, row: int) -> str:
        """Return the position of a row in its file, as its reader counts."""
        sheet = f'"{self.name}", ' if self.name else ""
        if self.lines is not None:
            return f"{sheet}line {self.lines[row]}"
        return f"{sheet}row {row + 1}" if self.first_line is None else f"{sheet}line {self.first_line + row}"

    def named(self, name: str) -> RawColumn | None:
        """Return the column of a name, with or without the sheet's name before it; None if no column has it.

        Its unit may be left out if no other column has that name.
        """
        plain = name.removeprefix(f"{self.name}/")
        if (column := next((c for c in self.columns if plain in (c.name, full_name(c))), None)) is not None:
            return column
        same_named = [c for c in self.columns if split_name(c.name)[0] == plain]
        return same_named[0] if len(same_named) == 1 else None


def full_name(column: RawColumn) -> str:
    """Return the name of a column with the unit that the file has in a row or field of its own."""
    return f"{column.name} [{column.unit}]" if column.unit else column.name
