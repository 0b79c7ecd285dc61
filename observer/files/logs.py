"""Logs: CSV (plain or gzip) and Parquet, read with every cell checked, written whole or not at all.

The first column is `time_s`; the others are channels. A log with the columns `step` and `flags` is one of
the service's own recordings: each row is a reading or, where `step` is 1, a tick of the estimator.
"""

from __future__ import annotations

import csv
import difflib
import io
import math
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.errors import LogError, UserError
from observer.files.log_checks import (
    DOUBTS,
    MISSING_WORDS,
    MOST_PROBLEMS,
    Words,
    damaged,
    doubts_in,
    infinite_in,
    refuse_other_units,
    rows_of,
    several,
    without,
    without_doubts,
    words_in,
)
from observer.files.regular import MOST_LOG_BYTES, one_line, refuse_irregular, refuse_large
from observer.frames import BoolArray, FloatArray

TIME = "time_s"
STEP = "step"
FLAGS = "flags"
LATE = "late_s"
SUFFIXES = (".csv", ".csv.gz", ".parquet")
EMPTY_CELLS = ("", *MISSING_WORDS)
CELL_BYTES = 8
"""Of a number in memory."""


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """A recorded run of n rows.

    Attributes:
        path: Its file, or its name in errors.
        time_s: Strictly increasing times (n,).
        channels: Names of the c channels.
        values: Values (n, c) in the channels' units, NaN where a cell is empty.
        step: In the service's own recordings: which rows are ticks of the estimator, (n,); else None.
        flags: In recordings: the faults of each row as text, (n,).
        late_s: In newer recordings: how long before its row a reading was true, (n,), NaN for not at all.
        words: The cells that were read as missing because of what they say.
        doubts: Other assumptions of its reader, sentences.
        joined: Whether its rows come from several clocks, so that an empty cell is not a missing reading.
    """

    path: Path
    time_s: FloatArray
    channels: tuple[str, ...]
    values: FloatArray
    step: BoolArray | None = None
    flags: tuple[str | None, ...] | None = None
    late_s: FloatArray | None = None
    words: tuple[Words, ...] = ()
    doubts: tuple[str, ...] = ()
    joined: bool = False

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, channel: str) -> FloatArray:
        """A channel's values (n,), NaN in empty cells."""
        return self.values[:, self.channels.index(channel)]

    def with_channels(self, names: Sequence[str]) -> Log:
        """Return the log with the channels `names` alone, in the order of the file.

        Raises:
            LogError: A channel is missing; the sentence proposes one with a similar name.
        """
        selected = [name for name in _selected(self.path, [TIME, *self.channels], names) if name != TIME]
        columns = [self.channels.index(name) for name in selected]
        words = tuple(words for words in self.words if words.column in selected)
        return replace(self, channels=tuple(selected), values=self.values[:, columns], words=words)

    def adding(self, names: Sequence[str], values: FloatArray) -> Log:
        """Return the log with other channels behind its own.

        Args:
            names: Their names, c.
            values: Their values (n, c).
        """
        return replace(self, channels=(*self.channels, *names), values=np.hstack([self.values, values]))


def log_of(columns: Mapping[str, Any], name: str = "log") -> Log:
    """Return the log that columns of numbers make.

    Args:
        columns: Arrays (n,), or sequences, by name; `time_s` is the time.
        name: What errors call the log.

    Raises:
        LogError: `time_s` is missing, empty or not strictly increasing, or a column does not hold n numbers.
    """
    import pyarrow as pa  # noqa: PLC0415 - slow to import, and the daemon reads no log

    path, arrays = Path(name), dict[str, FloatArray]()
    for key in [TIME, *(key for key in columns if key not in (TIME, STEP, FLAGS, LATE))]:
        if key not in columns:
            raise LogError(f"{path}: has no {key}; give the seconds of its rows as {key}")
        try:
            arrays[str(key)] = np.asarray(columns[key], dtype=np.float64)
        except (TypeError, ValueError):
            raise LogError(f'{path}: column "{key}" does not hold numbers; give it as numbers') from None
        if arrays[str(key)].shape != arrays[TIME].shape or arrays[TIME].ndim != 1:
            raise LogError(
                f'{path}: column "{key}" does not have one value a row; give them as one-dimensional'
            )
    log = _checked(path, pa.table(arrays), lambda row: f"row {row + 1}")
    return replace(log, words=infinite_in(_columns(log)))


def read_log(
    path: Path | str,
    only: Sequence[str] = (),
    *,
    accept_truncated: bool = False,
    accept_damaged: bool = False,
    rows_apart_s: float = math.inf,
    missing: Sequence[str] = (),
) -> Log:
    """Read a log in the program's own form.

    Args:
        path: CSV, compressed CSV or Parquet.
        only: Columns to read; empty for all.
        accept_truncated: Drop a last row that was cut off, instead of refusing the file.
        accept_damaged: Drop the rows of a recording whose checksum is wrong, instead of refusing the file.
        rows_apart_s: Refuse a log most of whose rows are further apart, as its times are not in seconds.
        missing: Texts of cells that are missing, besides `MISSING_WORDS`.

    Raises:
        LogError: The file is missing, unreadable, too large, cut off or damaged; a column is missing, a cell
            is not a number, or the time does not increase. The sentence names the file, the row or column,
            and the remedy.
    """
    path = Path(path)
    try:
        suffix = suffix_of(path)
        refuse_irregular(path, "a readable log")
        refuse_large(path, path.stat().st_size)
        if suffix == ".parquet":
            log = _read_parquet(path, only)
        else:
            log = _read_csv(path, only, accept_truncated, accept_damaged, missing)
        refuse_other_units(path, TIME, log.time_s, rows_apart_s)
    except FileNotFoundError:
        raise LogError(f"{path}: no such file; give the path of a log") from None
    except OSError as error:
        reason = error.strerror or one_line(str(error))
        raise LogError(f"{path}: cannot be read ({reason}); give a readable log") from None
    except csv.Error as error:
        raise LogError(
            f"{path}: not readable as CSV ({error}); save it again, without stray quotes"
        ) from None
    except LogError:
        raise
    except UserError as error:
        raise LogError(str(error)) from None
    return log


def suffix_of(path: Path) -> str:
    """Return the kind of a log by its name, one of `SUFFIXES`.

    Raises:
        LogError: The name ends with none of them.
    """
    for suffix in SUFFIXES:
        if path.name.endswith(suffix):
            return suffix
    raise LogError(f"{path}: unknown kind of log; name it {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")


def _read_csv(
    path: Path, only: Sequence[str], accept_truncated: bool, accept_damaged: bool, missing: Sequence[str]
) -> Log:
    data, cut = bytes_of(path)
    data, doubts = without_doubts(data)
    header = _header(path, data)
    selected = _selected(path, header, only)
    data = _without_cut_row(path, data, header, cut, accept_truncated)
    if _is_recording(header):
        data = _without_damage(path, data, accept_damaged)
    return replace(_parsed(path, data, header, selected, missing), doubts=doubts)


def read_part(path: Path, first: bytes, data: bytes, only: Sequence[str]) -> tuple[Log | None, int]:
    """Read whole blocks of a recording; damaged ones are left out.

    Args:
        path: The recording, named in errors.
        first: Its first line; only data from its beginning hold it too.
        data: The bytes of the blocks.
        only: Columns to read.

    Returns:
        The rows, or None without any, and the number of damaged blocks.

    Raises:
        LogError: A column is missing, or a cell is not a number.
    """
    header = _header(path, first)
    selected, begins = _selected(path, header, only), data.startswith(first)
    parts = damaged(data, has_header=begins)
    data = without(data, parts) if begins else first + without(data, parts)
    return (_parsed(path, data, header, selected) if len(data) > len(first) else None), len(parts)


def _parsed(
    path: Path, data: bytes, header: list[str], selected: list[str], missing: Sequence[str] = ()
) -> Log:
    """The rows of a CSV with their words."""
    import pyarrow as pa  # noqa: PLC0415 - slow to import, and the daemon reads no log
    from pyarrow import csv as pa_csv  # noqa: PLC0415

    types = {name: pa.string() if _is_flags(name, header) else pa.float64() for name in selected}
    numbered = [name or f"\0{i}" for i, name in enumerate(header)]  # unnamed columns are never wanted
    try:
        table = pa_csv.read_csv(
            pa.py_buffer(data),
            read_options=pa_csv.ReadOptions(column_names=numbered, skip_rows=1),
            convert_options=pa_csv.ConvertOptions(
                column_types=types,
                include_columns=selected,
                null_values=[*EMPTY_CELLS, *missing],
                strings_can_be_null=True,
            ),
        )
    except pa.ArrowInvalid as error:
        raise several(path, _problems(data, header, selected, error, missing)) from None
    log = _checked(path, table, lambda row: _place(data, row))
    return replace(log, words=words_in(data, numbered, _columns(log), missing))


def bytes_of(path: Path) -> tuple[bytes, bool]:
    """Return the text of a log, unpacked, and whether its end is missing.

    The end is missing where compressed data are cut, or the disk left blank blocks after a power cut.

    Raises:
        LogError: Compressed data are damaged, or have more than 1 GiB once unpacked.
        OSError: The file cannot be read.
    """
    data = path.read_bytes()
    if not path.name.lower().endswith(".gz"):
        return data.rstrip(b"\0"), data.endswith(b"\0")
    text, size_bytes = list[bytes](), 0
    while data:
        member = zlib.decompressobj(wbits=zlib.MAX_WBITS | 16)
        try:
            text.append(member.decompress(data, MOST_LOG_BYTES + 1 - size_bytes))
        except zlib.error as error:
            raise LogError(f"{path}: damaged gzip data ({error}); copy the log again") from None
        size_bytes += len(text[-1])
        refuse_large(path, size_bytes)
        if not member.eof:
            return b"".join(text), True
        data = member.unused_data
    return b"".join(text), False


def _header(path: Path, data: bytes) -> list[str]:
    """The names of the columns; `time_s` first, none twice."""
    line = data.split(b"\n", 1)[0]
    try:
        cells = next(csv.reader([line.decode("utf-8-sig")]), [])
    except (UnicodeDecodeError, csv.Error):
        raise LogError(f"{path}: not UTF-8 text; save the log as CSV in UTF-8") from None
    header = [cell.strip() for cell in cells]
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        raise LogError(
            f"{path}: columns are separated by semicolons or tabs; separate them by commas, and write "
            "numbers with a point"
        )
    _check_names(path, header)
    return header


def _check_names(path: Path, header: Sequence[str]) -> None:
    if not header or header[0] != TIME:
        first = repr(header[0]) if header else "nothing"
        raise LogError(f"{path}: the first column is {first}; name it {TIME} and give seconds in it")
    for name in header:
        if name and header.count(name) > 1:
            raise LogError(f'{path}: column "{name}" occurs twice; rename or remove one')


def _selected(path: Path, header: Sequence[str], only: Sequence[str]) -> list[str]:
    """The columns to read: time, what is needed (everything, if nothing is), and a recording's own."""
    missing = [name for name in dict.fromkeys(only) if name not in header]
    if missing:
        spare = [name for name in header if name not in (TIME, *only)]
        names = ", ".join(f'"{name}"{_similar(name, spare)}' for name in missing)
        one = len(missing) == 1
        noun, verb, it, other = (
            ("column", "is", "it", "another") if one else ("columns", "are", "them", "others")
        )
        raise LogError(
            f"{path}: {noun} {names} {verb} missing; add {it} to the log or name {other} in the configuration"
        )
    service_columns = {STEP, FLAGS, LATE} if _is_recording(header) else set()
    keep = {TIME, *only, *service_columns} if only else set(header)
    return [name for name in header if name in keep and name]


def _similar(name: str, spare: Sequence[str]) -> str:
    """Which of the columns that nothing else needs may be meant."""
    close = difflib.get_close_matches(name, spare, n=1)
    return f' (did you mean "{close[0]}"?)' if close else ""


def _is_recording(header: Sequence[str]) -> bool:
    return STEP in header and FLAGS in header


def _is_flags(name: str, header: Sequence[str]) -> bool:
    return name == FLAGS and STEP in header


def _without_cut_row(path: Path, data: bytes, header: Sequence[str], cut: bool, accept: bool) -> bytes:
    """The data without a last row that was cut off; refuses such a row unless `accept`.

    A recording ends every row with a newline, so there a missing one is enough; elsewhere a last row that
    has all its cells is whole.
    """
    start = data.rfind(b"\n") + 1
    last = data[start:]
    if not last.strip() and not cut:
        return data
    whole = len(next(csv.reader([last.decode("utf-8", "replace")]), [])) >= len(header)
    if whole and not cut and not _is_recording(header):
        return data
    if accept or start == 0:
        return data[:start]
    row = len([line for line in data.splitlines() if line.strip()]) - 2
    raise LogError(
        f"{path}: {_place(data, row)} is cut off; use the rows before it with --accept-truncated, "
        "or copy the log again"
    )


def _without_damage(path: Path, data: bytes, accept: bool) -> bytes:
    """The data without the blocks whose checksum is wrong; refuses such blocks unless `accept`."""
    parts = damaged(data)
    if accept or not parts:
        return without(data, parts)
    also = f", nor do rows at {len(parts) - 1} more places" if len(parts) > 1 else ""
    raise LogError(
        f"{path}: {rows_of(data, parts[0])} do not have the checksum they were recorded with{also}; copy the "
        "recording again, or leave those rows out with --accept-damaged"
    )


def _place(data: bytes, row: int) -> str:
    """Data row `row` (from 0) as row number from 1 and line number with the header."""
    lines = [number for number, line in enumerate(data.splitlines(), 1) if line.strip()]
    return f"row {row + 1} (line {lines[row + 1]})" if row + 1 < len(lines) else f"row {row + 1}"


def _problems(
    data: bytes, header: list[str], selected: list[str], error: Exception, missing: Sequence[str]
) -> Iterator[str]:
    """A sentence for each cell that is not a number, and each row of another length."""
    numeric = [i for i, name in enumerate(header) if name in selected and not _is_flags(name, header)]
    reader = csv.reader(io.StringIO(data.decode("utf-8", "replace"), newline=""))
    has_bad_cell, lines = False, [n for n, line in enumerate(data.splitlines(), 1) if line.strip()]
    for number, row in enumerate(row for row in reader if row):
        if number == 0:
            continue
        place = f"row {number} (line {lines[number]})" if number < len(lines) else f"row {number}"
        if len(row) != len(header):
            cells = f"{len(row)} cells where the header names {len(header)}"
            has_bad_cell = True
            yield f"{place} has {cells}; fix or remove it"
            continue
        for i in numeric:
            cell = row[i].strip()
            if cell not in EMPTY_CELLS and cell not in missing and not _is_number(cell):
                has_bad_cell = True
                cell_place = f'{place}, column "{header[i]}"'
                yield f"{cell_place}: {cell[:40]!r} is not a number; fix it or leave it empty"
    if not has_bad_cell:
        yield f"not readable as CSV ({str(error).splitlines()[0]}); fix that row"


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell and cell.isascii()


def _read_parquet(path: Path, only: Sequence[str]) -> Log:
    import pyarrow as pa  # noqa: PLC0415
    from pyarrow import parquet  # noqa: PLC0415

    try:
        with parquet.ParquetFile(path, page_checksum_verification=True) as file:
            refuse_large(path, CELL_BYTES * file.metadata.num_rows * file.metadata.num_columns)
            header = list(file.schema_arrow.names)
            doubts = doubts_in((file.schema_arrow.metadata or {}).get(DOUBTS, b""))
            _check_names(path, header)
            table = file.read(columns=_selected(path, header, only))
    except (pa.ArrowException, UnicodeDecodeError) as error:
        raise LogError(f"{path}: damaged or not Parquet ({one_line(str(error))}); copy it again") from None
    for i, name in enumerate(table.column_names):
        if _is_flags(name, header):
            continue
        try:
            table = table.set_column(i, name, table.column(i).cast(pa.float64()))
        except pa.ArrowException:
            kind = table.column(i).type
            raise LogError(
                f'{path}: column "{name}" holds {kind}, not numbers; write it as float64'
            ) from None
    log = _checked(path, table, lambda row: f"row {row + 1}")
    return replace(log, words=infinite_in(_columns(log)), doubts=doubts)


def _columns(log: Log) -> dict[str, FloatArray]:
    return {name: log.values[:, i] for i, name in enumerate(log.channels)}


def _checked(path: Path, table: Any, place: Callable[[int], str]) -> Log:
    """A log from a table of columns, once its times are seen to be finite and increasing."""
    names = table.column_names
    recording = _is_recording(names)
    time_s = _numbers(table, TIME)
    if not len(time_s):
        raise LogError(f"{path}: holds no rows; record at least one sample")
    _check_time(path, time_s, place)
    channels = tuple(n for n in names if n != TIME and not (recording and n in {STEP, FLAGS, LATE}))
    values = np.empty((len(time_s), len(channels)))
    for i, name in enumerate(channels):
        values[:, i] = _numbers(table, name)
    if not recording:
        return Log(path, time_s, channels, values)
    step = _numbers(table, STEP) == 1.0
    late_s = _numbers(table, LATE) if LATE in names else None
    return Log(path, time_s, channels, values, step, tuple(table.column(FLAGS).to_pylist()), late_s)


def _numbers(table: Any, name: str) -> FloatArray:
    return np.asarray(table.column(name).to_numpy(), dtype=np.float64)


def _going_back(time_s: FloatArray, rows: NDArray[np.intp], place: Callable[[int], str]) -> Iterator[str]:
    """Yield a sentence for each row whose time does not exceed that of the row before."""
    for number, row in enumerate(rows):
        before_s, after_s = float(time_s[row - 1]), float(time_s[row])
        change = "repeats" if after_s == before_s else f"goes back from {before_s!r} to"
        row_place = (
            place(int(row)) if number < MOST_PROBLEMS else f"row {row + 1}"
        )  # looking up a line is slow
        yield f"{row_place}: {TIME} {change} {after_s!r}; sort the rows or split the log there"


def _check_time(path: Path, time_s: FloatArray, place: Callable[[int], str]) -> None:
    bad = np.flatnonzero(~np.isfinite(time_s))
    if len(bad):
        raise LogError(f"{path}: {place(int(bad[0]))}: {TIME} is empty or not finite; give seconds there")
    if len(back := np.flatnonzero(np.diff(time_s) <= 0) + 1):
        raise several(path, _going_back(time_s, back, place))
