"""Results over time: named signals, with Arrow underneath."""

from __future__ import annotations

import html
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from observer.files.logs import TIME
from observer.files.writer import TableWriter
from observer.frames import FloatArray
from observer.library.packages import in_words
from observer.report.panels import Panel
from observer.units import unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ALONG = re.compile(r"(field|error)_([\d.]+)_(.+)")
_SHOWN = 12


@dataclass(frozen=True, eq=False, repr=False)
class SignalTable(ABC):
    """Signals over one time, by the names of the columns in the files that commands write.

    `result["heat_nut_W"]` is a column (n,) of numbers, NaN where unknown, or of words. A name that is no
    signal raises `KeyError`. `len(result)` is the number of rows.
    """

    _table: Any
    _title: str

    @property
    def signals(self) -> tuple[str, ...]:
        """The names of the signals in the order of the file's columns, without `time_s`."""
        return tuple(name for name in self._table.column_names if name != TIME)

    @property
    def time_s(self) -> FloatArray:
        """The time (n,) of each row, in seconds: since 1970 or since the log's own zero, as in the log."""
        return np.asarray(self[TIME])

    def __getitem__(self, name: str) -> Any:
        """Return a signal (n,): numbers, NaN where unknown, or words. Raises `KeyError`."""
        if name not in self._table.column_names:
            raise KeyError(f"{name!r} is not a signal of this result; .signals lists them")
        return self._table.column(name).to_numpy()

    def __len__(self) -> int:
        return int(self._table.num_rows)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._title}; {len(self)} rows, {len(self.signals)} signals>"

    def to_arrow(self) -> Any:
        """Return a `pyarrow.Table` with `time_s` and a column for each signal; no data are copied."""
        return self._table

    @in_words
    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` with `time_s` as its index and a column for each signal.

        Raises:
            UserError: pandas is not installed.
        """
        return self._table.to_pandas().set_index(TIME)

    @in_words
    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset` over `time_s` and, for field and thermal error, `position_m`.

        The columns along the screw become one variable (n, g) each, such as `field_degC`. Units are
        attributes.

        Raises:
            UserError: xarray is not installed.
        """
        import xarray

        variables: dict[str, Any] = {}
        along: dict[str, dict[float, Any]] = {}
        for name in self.signals:
            if (match := _ALONG.fullmatch(name)) is None:
                variables[name] = (TIME, self[name], {"units": unit_of(name)})
            else:
                kind, millimetres, suffix = match.groups()
                along.setdefault(f"{kind}_{suffix}", {})[float(millimetres) / 1000.0] = self[name]
        for name, columns in along.items():
            values = np.column_stack(list(columns.values()))
            variables[name] = ((TIME, "position_m"), values, {"units": unit_of(name)})
        coordinates: dict[str, Any] = {TIME: (TIME, self.time_s, {"units": "s"})}
        if along:
            places = next(iter(along.values()))
            coordinates["position_m"] = ("position_m", list(places), {"units": "m"})
        return xarray.Dataset(variables, coordinates, {"title": self._title})

    @in_words
    def plot(self) -> list[Axes]:
        """Draw the picture that the command writes, as a figure of pyplot.

        Returns:
            Its axes from the top.

        Raises:
            UserError: matplotlib is not installed.
        """
        from observer.report.pictures import shown

        with shown() as figure:
            return [panel.axes for panel in self._draw(figure)]

    @abstractmethod
    def _draw(self, figure: Figure) -> list[Panel]:
        """Draw the picture on an empty figure; return its panels from the top."""

    def _write_picture(self, path: Path) -> None:
        from observer.report.pictures import written

        with written(path) as figure:
            self._draw(figure)

    def _row_blocks(self) -> Iterator[Any]:
        """Yield the rows, one `pyarrow.Table` at a time."""
        for batch in self._table.to_batches():
            yield self._table.from_batches([batch])

    def _write_table(self, path: Path) -> None:
        with TableWriter(path) as writer:
            for block in self._row_blocks():
                writer.write_arrow(block)

    def _repr_html_(self) -> str:
        """Return a table of the first signals with their means, for notebooks."""
        first = [(html.escape(name), _mean(self[name])) for name in self.signals[:_SHOWN]]
        rows = "".join(f"<tr><td>{name}</td><td>{mean}</td></tr>" for name, mean in first)
        hidden = len(self.signals) - _SHOWN
        note = f"<p>and {hidden} more signals</p>" if hidden > 0 else ""
        head = f"<p><b>{html.escape(self._title)}</b>, {len(self)} rows</p>"
        return f"{head}<table><tr><th>signal</th><th>mean</th></tr>{rows}</table>{note}"


def _mean(values: Any) -> str:
    """Return the mean of a signal as text; for words, the most frequent one."""
    if values.dtype.kind not in "fiu":
        words, counts = np.unique(values.astype(str), return_counts=True)
        return html.escape(str(words[np.argmax(counts)]))
    finite = np.isfinite(values)
    return f"{values[finite].mean():.4g}" if finite.any() else "unknown"
