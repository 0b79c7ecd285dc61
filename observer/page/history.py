"""What has been recorded: which files there are, and the least and the most of each channel over a span.

The files of a recording are long; of one only the rows of the span are read, in blocks, so that neither its
size nor the span's decides how much memory is used.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.errors import LogError
from observer.files.logs import EMPTY_CELLS, FLAGS, LATE, STEP, TIME

_SUFFIX = ".csv"
_BLOCK_BYTES = 4 << 20
_LINE_BYTES = 1 << 16
_MARGIN_S = 30.0
"""Rows stand in the order of their use, so their times may go back a little."""
_OWN = {TIME, STEP, LATE, FLAGS}
MOST_POINTS = 2000


@dataclass(frozen=True, slots=True)
class Recorded:
    """A file of a recording: its name, and the times of its first and last row in s since 1970."""

    path: Path
    from_s: float
    to_s: float


def recordings(folder: Path, name: str) -> list[Recorded]:
    """The files of an axis in the order of their time; raises `LogError` where the folder is not readable."""
    try:
        paths = sorted(path for path in folder.glob(f"{name}*{_SUFFIX}") if path.is_file())
    except OSError as error:
        raise LogError(f"{folder}: cannot be read ({error.strerror}); mend record.directory") from None
    found = []
    for path in paths:
        try:
            with path.open("rb") as file:
                file.readline(_LINE_BYTES)
                first_s = _time(file.readline(_LINE_BYTES))
                last_s = _last(file, path.stat().st_size)
        except OSError:
            continue  # it has been removed meanwhile
        if first_s is not None and last_s is not None:
            found.append(Recorded(path, first_s, max(first_s, last_s)))
    return sorted(found, key=lambda recorded: recorded.from_s)


def history(files: list[Recorded], from_s: float, to_s: float, points: int) -> dict[str, Any]:
    """The least and the most of each channel in each of `points` equal parts of a span.

    `{"from_s", "to_s", "time_s": [the middle of each part], "channels": {name: {"least", "most"}}}`; a part
    without a reading is None. Raises `ValueError` for a span that is none.
    """
    if not (np.isfinite([from_s, to_s]).all() and from_s < to_s and 1 <= points <= MOST_POINTS):
        raise ValueError(f"no span: give from < to in seconds and 1 to {MOST_POINTS} points")
    least: dict[str, NDArray[np.float64]] = {}
    most: dict[str, NDArray[np.float64]] = {}
    for recorded in files:
        if recorded.to_s + _MARGIN_S < from_s or recorded.from_s - _MARGIN_S > to_s:
            continue
        for time_s, channels in _blocks(recorded.path, from_s, to_s):
            part = np.floor((time_s - from_s) / (to_s - from_s) * points)
            within = (part >= 0) & (part < points)
            for name, values in channels.items():
                here = within & np.isfinite(values)
                index = part[here].astype(np.intp)
                np.minimum.at(least.setdefault(name, np.full(points, np.inf)), index, values[here])
                np.maximum.at(most.setdefault(name, np.full(points, -np.inf)), index, values[here])
    middle_s = from_s + (np.arange(points) + 0.5) * (to_s - from_s) / points
    return {
        "from_s": from_s,
        "to_s": to_s,
        "time_s": np.round(middle_s, 3).tolist(),
        "channels": {name: {"least": _known(least[name]), "most": _known(most[name])} for name in least},
    }


def _known(values: NDArray[np.float64]) -> list[float | None]:
    return [round(x, 6) if np.isfinite(x) else None for x in values.tolist()]


def _blocks(
    path: Path, from_s: float, to_s: float
) -> Iterator[tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]]:
    """Times and channels of the rows around a span, a block of the file at a time."""
    from pyarrow import ArrowInvalid  # noqa: PLC0415  # it takes a third of a second, and not all look back
    from pyarrow import csv as pa_csv  # noqa: PLC0415

    with path.open("rb") as file:
        header = next(csv.reader([file.readline(_LINE_BYTES).decode("utf-8", "replace")]), [])
        names = [name for name in header if name not in _OWN]
        types = dict.fromkeys([TIME, *names], "float64")
        file.seek(_offset(file, path.stat().st_size, from_s - _MARGIN_S))
        rest = b""
        while block := file.read(_BLOCK_BYTES):
            rows, _, rest = (rest + block).rpartition(b"\n")
            if not rows:
                continue
            try:
                table = pa_csv.read_csv(
                    io.BytesIO(rows),
                    parse_options=pa_csv.ParseOptions(invalid_row_handler=lambda _: "skip"),
                    read_options=pa_csv.ReadOptions(column_names=header, use_threads=False),
                    convert_options=pa_csv.ConvertOptions(
                        column_types=types,
                        include_columns=[TIME, *names],
                        null_values=EMPTY_CELLS,
                        strings_can_be_null=True,
                    ),
                )
            except ArrowInvalid:
                continue  # a damaged block; `observer replay` says where
            columns = {
                name: np.asarray(table.column(name).to_numpy(), dtype=float) for name in table.column_names
            }
            time_s = columns.pop(TIME)
            yield time_s, columns
            if time_s[-1] > to_s + _MARGIN_S:
                return


def _offset(file: io.BufferedReader, size: int, time_s: float) -> int:
    """Where a row begins before which all are older than a time, by halving the file."""
    begin = low = file.tell()
    high = size
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


def _last(file: io.BufferedReader, size: int) -> float | None:
    """The time of the last whole row."""
    file.seek(max(0, size - _LINE_BYTES))
    for line in reversed(file.read(_LINE_BYTES).split(b"\n")[:-1]):
        if (time_s := _time(line)) is not None:
            return time_s
    return None


def _time(line: bytes) -> float | None:
    """The time at the beginning of a row, None where there is none."""
    try:
        return float(line.split(b",", 1)[0])
    except ValueError:
        return None
