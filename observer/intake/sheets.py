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
    """A column as its file has it.

    `values` (n,): float64 with NaN for an empty cell, `datetime64[ns]` with NaT, or a pyarrow array of
    strings with nulls. `unit` is the one in the file, empty for none. `utc`: times are in
    UTC, not wall-clock times. `dropped` are words in cells of rows that were left out.
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
    """A table of a file: columns of one length, and on which clock they are if the file itself says so.

    `name` is that of the group or sheet in its file, empty for the only one. `time_s` (n,): seconds, where
    the format has a clock of its own; `since_1970` says whether they count from then, `on_wall` that they are
    wall-clock times whose zone is not given. `decimal` is the decimal
    separator of text. `lines` are the line numbers of the rows, `first_line` that of the
    first row where they are consecutive, `left_out` the lines of rows that did not fit. `doubts` are
    sentences about what was left out, `preamble` the lines above the header.
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
        """The place of a row, as its reader counts."""
        sheet = f'"{self.name}", ' if self.name else ""
        if self.lines is not None:
            return f"{sheet}line {self.lines[row]}"
        return f"{sheet}row {row + 1}" if self.first_line is None else f"{sheet}line {self.first_line + row}"

    def named(self, name: str) -> RawColumn | None:
        """The column of a name, with the sheet's before it or without; None where there is none.

        Its unit may be left out where no other column has that name.
        """
        plain = name.removeprefix(f"{self.name}/")
        if (found := next((c for c in self.columns if plain in (c.name, full_name(c))), None)) is not None:
            return found
        alike = [c for c in self.columns if split_name(c.name)[0] == plain]
        return alike[0] if len(alike) == 1 else None


def full_name(column: RawColumn) -> str:
    """The name of a column with the unit that stands in a row or field of its own."""
    return f"{column.name} [{column.unit}]" if column.unit else column.name
