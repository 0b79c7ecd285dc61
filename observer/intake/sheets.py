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
        name: Its name in the file.
        values: (n,) float64 with NaN, `datetime64[ns]` with NaT, or a pyarrow array of strings with nulls.
        unit: The unit that the file has in a row or field of its own; empty for none.
        utc: Whether times are in UTC, not wall-clock times.
        dropped: Words in cells of rows that were left out.
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
        path: Its file.
        name: Name of the group or sheet in its file; empty for the only one.
        columns: Its columns, in the file's order.
        time_s: Times (n,) in s, where the format has its own clock; None if a column holds them.
        since_1970: Whether these count from 1970.
        on_wall: Whether they are wall-clock times without a zone.
        decimal: Decimal separator of text.
        first_line: Line number of the first row where lines are consecutive; None if they are not lines.
        lines: Line numbers of the rows, (n,); None if they are consecutive.
        left_out: Lines of rows that did not fit.
        doubts: Sentences about rows that were left out.
        preamble: Lines above the header.
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
        """Return the position of a row, counted from 0, in its file, for a message: `line 12`, or `row 3`
        of a sheet.
        """
        sheet = f'"{self.name}", ' if self.name else ""
        if self.lines is not None:
            return f"{sheet}line {self.lines[row]}"
        return f"{sheet}row {row + 1}" if self.first_line is None else f"{sheet}line {self.first_line + row}"

    def named(self, name: str) -> RawColumn | None:
        """Return the column of a name; None if no column has it.

        The sheet's name may stand before it, as in `group/name`. Its unit may be left out if no other column
        has that name.
        """
        plain = name.removeprefix(f"{self.name}/")
        if (column := next((c for c in self.columns if plain in (c.name, full_name(c))), None)) is not None:
            return column
        same_named = [c for c in self.columns if split_name(c.name)[0] == plain]
        return same_named[0] if len(same_named) == 1 else None


def full_name(column: RawColumn) -> str:
    """Return the name of a column with the unit that the file has in a row or field of its own."""
    return f"{column.name} [{column.unit}]" if column.unit else column.name
