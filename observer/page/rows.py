"""The rows of a recording's file: where a time begins in it, and its channels in blocks.

The files are long; only the rows that are asked for are read, a block at a time, so that neither the size of
a file nor a span's decides how much memory is used.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from observer.files.logs import EMPTY_CELLS, FLAGS, LATE, STEP, TIME

if TYPE_CHECKING:
    import pyarrow as pa

_BLOCK_BYTES = 1 << 19
_LINE_BYTES = 1 << 16
Values = NDArray[np.floating[Any]]
_OWN = {TIME, STEP, LATE, FLAGS}


@dataclass(frozen=True, slots=True)
class Block:
    """Some rows: their times (n), a column for each channel (n, channels), and where the next row begins."""

    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    end: int


def header(path: Path) -> tuple[list[str], int]:
    """The names of a file's columns, and where its first row begins. Raises `OSError`."""
    with path.open("rb") as file:
        line = file.readline(_LINE_BYTES)
        return next(csv.reader([line.decode("utf-8", "replace")]), []), file.tell()


def channels_of(columns: list[str]) -> list[str]:
    """Those columns that are channels."""
    return [name for name in columns if name not in _OWN]


def blocks(path: Path, columns: list[str], begin: int) -> Iterator[Block]:
    """The rows from a place in the file on; damaged blocks are left out. Raises `OSError`."""
    from pyarrow import ArrowInvalid  # noqa: PLC0415  # it takes a third of a second, and not all look back
    from pyarrow import csv as pa_csv  # noqa: PLC0415

    names = channels_of(columns)
    parse = pa_csv.ParseOptions(invalid_row_handler=lambda _: "skip")
    read = pa_csv.ReadOptions(column_names=columns, use_threads=False)
    convert = pa_csv.ConvertOptions(
        column_types=dict.fromkeys([TIME, *names], "float64"),
        include_columns=[TIME, *names],
        null_values=EMPTY_CELLS,
        strings_can_be_null=True,
    )
    with path.open("rb") as file:
        file.seek(begin)
        end, rest = begin, b""
        while data := file.read(_BLOCK_BYTES):
            rows, newline, rest = (rest + data).rpartition(b"\n")
            end += len(rows) + len(newline)
            if not rows:
                continue
            try:
                table = pa_csv.read_csv(
                    io.BytesIO(rows), parse_options=parse, read_options=read, convert_options=convert
                )
            except ArrowInvalid:
                continue  # `observer replay` says where
            if table.num_rows:
                values = [_numbers(table.column(name)) for name in names]
                stacked = np.column_stack(values) if values else np.empty((table.num_rows, 0))
                yield Block(_numbers(table.column(TIME)), stacked, end)


def offset(path: Path, begin: int, time_s: float) -> int:
    """Where a row begins before which all are older than a time, by halving the file. Raises `OSError`."""
    with path.open("rb") as file:
        low, high = begin, path.stat().st_size
        while high - low > _LINE_BYTES:
            middle = (low + high) // 2
            file.seek(middle)
            file.readline(_LINE_BYTES)
            start = file.tell()
            found_s = _time(file.readline(_LINE_BYTES))
            if found_s is None or found_s >= time_s:
                high = middle
            else:
                low = start
    return max(begin, low)


def ends(path: Path) -> tuple[float, float] | None:
    """The times of the first and of the last whole row, None where there are none. Raises `OSError`."""
    with path.open("rb") as file:
        file.readline(_LINE_BYTES)
        first_s = _time(file.readline(_LINE_BYTES))
        file.seek(max(0, path.stat().st_size - _LINE_BYTES))
        for line in reversed(file.read(_LINE_BYTES).split(b"\n")[:-1]):
            if first_s is not None and (last_s := _time(line)) is not None:
                return first_s, max(first_s, last_s)
    return None


def extremes(
    keys: NDArray[np.int64], least: Values, most: Values
) -> tuple[NDArray[np.int64], Values, Values]:
    """The least and the most (keys, channels) of the rows with the same key; NaN where none has a value."""
    if np.any(keys[1:] < keys[:-1]):
        order = np.argsort(keys, kind="stable")
        keys, least, most = keys[order], least[order], most[order]
    first = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
    return keys[first], np.fmin.reduceat(least, first), np.fmax.reduceat(most, first)


def _numbers(column: pa.ChunkedArray) -> NDArray[np.float64]:
    """A column of float64 with NaN where it is empty, by Arrow's columnar format: a bitmap, and the values.

    Arrow's own `to_numpy` imports pandas, which takes 50 MB.
    """
    chunks = []
    for chunk in column.chunks:
        bitmap, data = chunk.buffers()
        here = slice(chunk.offset, chunk.offset + len(chunk))
        values = np.frombuffer(data, dtype=np.float64)[here]
        if bitmap is not None:
            known = np.unpackbits(np.frombuffer(bitmap, dtype=np.uint8), bitorder="little")[here]
            values = np.where(known == 1, values, np.nan)
        chunks.append(values)
    return np.concatenate(chunks)


def _time(line: bytes) -> float | None:
    """The time at the beginning of a row, None where there is none."""
    try:
        return float(line.split(b",", 1)[0])
    except ValueError:
        return None
