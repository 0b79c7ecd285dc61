"""The files of the past: rows as they come for the hour in progress, Parquet for a closed hour.

A row that was cut off by a crash is left out. A file holds the steps of one hour, one configuration and one
instance, and is named after its first step: `<machine>-<axis>-20260301T060000Z.steps`, once it is packed
`….steps.parquet`.
"""

from __future__ import annotations

import fcntl
import io
import math
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.errors import LogError, extra_remedy
from observer.files.folders import OWNER_ONLY, make_folder, write_whole
from observer.record.retention import STEPS_SUFFIX, is_being_written
from observer.record.step_columns import FIELDS, StepRows, StepSource

FILE_S = 3600.0
"""The length of the time that a file covers."""
_PACKED = ".parquet"
_DOCUMENT_KEY = b"ballscrew.steps"
_GROUP_ROWS = 1800
_MOST_DOCUMENT_BYTES = 1 << 24
_STAMP = "%Y%m%dT%H%M%SZ"
_STAMPED = re.compile(r"(.+)-(\d{8}T\d{6}Z)(?:-(\d+))?\.steps(?:\.parquet)?")


class StepFile(NamedTuple):
    """A file of steps.

    Attributes:
        path: Its path, with `.steps` or `.steps.parquet` at its end.
        from_s: Time of its first step, s since 1970, to the second below.
        to_s: End of its hour; its steps are before it.
    """

    path: Path
    from_s: float
    to_s: float

    @property
    def is_packed(self) -> bool:
        """Whether it is Parquet, so that it does not change any more."""
        return self.path.suffix == _PACKED


def step_files(folder: Path, name: str) -> list[StepFile]:
    """Return the files of an axis in the order of time; empty for a missing folder.

    A file that is packed at this moment counts once.

    Args:
        folder: The folder of recordings.
        name: `<machine>-<axis>`.

    Raises:
        LogError: The folder cannot be read.
    """
    files: dict[str, tuple[float, int, Path]] = {}
    for file in _names(folder):  # the packed one of two that are the same comes last
        if (match := _STAMPED.fullmatch(file)) is not None and match[1] == name:
            with suppress(ValueError):
                from_s = datetime.strptime(match[2], _STAMP).replace(tzinfo=UTC).timestamp()
                files[file.removesuffix(_PACKED)] = from_s, int(match[3] or 1), folder / file
    return [StepFile(path, from_s, hour_end_s(from_s)) for from_s, _, path in sorted(files.values())]


def axes_of(folder: Path) -> list[str]:
    """Return the names of the axes with steps in a folder, sorted; empty for a missing folder.

    Raises:
        LogError: The folder cannot be read.
    """
    return sorted({match[1] for file in _names(folder) if (match := _STAMPED.fullmatch(file))})


def _names(folder: Path) -> list[str]:
    try:
        return sorted(os.listdir(folder))
    except FileNotFoundError:
        return []
    except OSError as error:
        raise LogError(f"{folder}: cannot be read ({error.strerror}); fix record.directory") from None


def hour_end_s(time_s: float) -> float:
    """Return the end of the hour of UTC that a time is in, s since 1970."""
    return (time_s // FILE_S + 1.0) * FILE_S


def read_steps(file: StepFile, from_s: float, to_s: float, *, backwards: bool = False) -> Iterator[StepRows]:
    """Yield the steps of a file from one time up to another, some thousand at most at once.

    A file that is gone has no step.

    Args:
        file: The file, packed or not.
        from_s: First time.
        to_s: End, itself excluded.
        backwards: The later pieces come first, each still in the order of time.

    Raises:
        LogError: The file is damaged, or pyarrow is missing for a packed one.
    """
    with suppress(FileNotFoundError), _in_words(file):  # packed or removed meanwhile
        pieces = _packed_pieces(file.path, from_s, to_s, backwards) if file.is_packed else None
        for rows in pieces or _plain_pieces(file.path, backwards):
            begin, end = np.searchsorted(rows.time_s, [from_s, to_s])
            if begin < end:
                yield rows.at(slice(begin, end))


def read_columns(
    file: StepFile, from_s: float, to_s: float, names: Sequence[str] | None = None
) -> tuple[tuple[str, ...], list[NDArray[Any]]]:
    """Return the channels of a file, and the columns `time_s` and `names` of a span.

    Only these columns are read from a packed file.

    Args:
        file: The file, packed or not.
        from_s: First time.
        to_s: End, itself excluded.
        names: Columns as of `StepSource.places`; None for the values of all channels.

    Returns:
        The channels, and arrays (K,) with the time first. A column that the file lacks is NaN.

    Raises:
        LogError: The file is damaged, or pyarrow is missing for a packed one.
        FileNotFoundError: The file is gone.
    """
    with _in_words(file):
        if not file.is_packed:
            steps = _plain(file.path)
            steps = steps.at(slice(*np.searchsorted(steps.time_s, [from_s, to_s])))
            selected = steps.source.value_names if names is None else names
            return steps.source.channels, [np.array(steps.column(name)) for name in ("time_s", *selected)]
        from pyarrow import parquet  # noqa: PLC0415 - slow to import, and the daemon does without

        with parquet.ParquetFile(file.path) as packed:
            source = StepSource.of_json(packed.schema_arrow.metadata[_DOCUMENT_KEY])
            selected = source.value_names if names is None else names
            groups = list(_groups(packed, from_s, to_s))
            table = packed.read_row_groups(groups, columns=["time_s", *selected], use_threads=False)
        time_s = _numbers(table, "time_s")
        span = slice(*np.searchsorted(time_s, [from_s, to_s]))
        empty = np.full(len(time_s), np.nan)
        stored = set(table.column_names)
        columns = [_numbers(table, name) if name in stored else empty for name in selected]
        return source.channels, [column[span] for column in (time_s, *columns)]


@contextmanager
def _in_words(file: StepFile) -> Iterator[None]:
    """A block that reads a file; what it raises becomes a `LogError`, unless the file is gone."""
    try:
        yield
    except FileNotFoundError:
        raise
    except OSError as error:
        reason = error.strerror or error
        raise LogError(f"{file.path.name} cannot be read ({reason}); let this user read it") from None
    except (ValueError, KeyError, TypeError) as error:  # pyarrow's own are ValueErrors
        raise LogError(
            f"{file.path.name} is damaged ({error}); restore it from a copy, or remove it"
        ) from None
    except ModuleNotFoundError:
        raise LogError(f"{file.path.name} needs pyarrow: {extra_remedy('page')}") from None


def _plain(path: Path) -> StepRows:
    """Read a file of rows: what is whole, and in the order of time."""
    with path.open("rb") as file:
        line = file.readline(_MOST_DOCUMENT_BYTES)
        source = StepSource.of_json(line)
        count = (os.fstat(file.fileno()).st_size - len(line)) // source.dtype.itemsize
        if not count:
            return StepRows(source, np.zeros(0, source.dtype))
        rows: NDArray[Any] = np.memmap(file, source.dtype, "r", len(line), (count,))
    time_s = np.array(rows["time_s"])
    damaged = np.flatnonzero(~(np.diff(time_s, prepend=0.0) > 0.0))
    return StepRows(source, rows[: damaged[0]] if len(damaged) else rows)


def _plain_pieces(path: Path, backwards: bool) -> Iterator[StepRows]:
    whole = _plain(path)
    begins = range(0, len(whole), _GROUP_ROWS)
    for begin in reversed(begins) if backwards else begins:
        yield StepRows(whole.source, np.array(whole.rows[begin : begin + _GROUP_ROWS]))


def _packed_pieces(path: Path, from_s: float, to_s: float, backwards: bool) -> Iterator[StepRows]:
    from pyarrow import parquet  # noqa: PLC0415 - slow to import, and the daemon does without

    with parquet.ParquetFile(path) as packed:
        source = StepSource.of_json(packed.schema_arrow.metadata[_DOCUMENT_KEY])
        groups = list(_groups(packed, from_s, to_s))
        for number in reversed(groups) if backwards else groups:
            table = packed.read_row_group(number, use_threads=False)
            rows = np.zeros(table.num_rows, source.dtype)
            rows["time_s"], rows["sequence"] = _numbers(table, "time_s"), _numbers(table, "sequence")
            for name, (field, place) in source.places.items():
                rows[field][:, place] = _numbers(table, name)
            yield StepRows(source, rows)


def _groups(packed: Any, from_s: float, to_s: float) -> Iterator[int]:
    """The row groups of a Parquet file that may have steps of a span."""
    for number in range(packed.num_row_groups):
        times = packed.metadata.row_group(number).column(0).statistics
        if times is None or not times.has_min_max or (times.max >= from_s and times.min < to_s):
            yield number


def _numbers(table: Any, name: str) -> NDArray[Any]:
    """A column of a `pyarrow.Table`; not by its own `to_numpy`, which imports pandas."""
    chunks = [np.from_dlpack(chunk) for chunk in table.column(name).chunks]
    return np.concatenate(chunks) if chunks else np.empty(0)


def pack(path: Path) -> None:
    """Make a Parquet file of a file of rows, whole or not at all; a file without a step is removed.

    The modification time becomes that of the last step, so that retention by age is right.

    Raises:
        OSError: The files cannot be read or written.
        ValueError: The file is damaged.
        ModuleNotFoundError: pyarrow is not installed.
    """
    import pyarrow as pa  # noqa: PLC0415 - slow to import, and the daemon does without
    from pyarrow import parquet  # noqa: PLC0415

    steps = _plain(path)
    if not len(steps):
        path.unlink(missing_ok=True)
        return
    rows, source = steps.rows, steps.source
    names: dict[str, list[str]] = {field: [] for field in FIELDS}
    for name, (field, place) in sorted(source.places.items(), key=lambda item: item[1]):
        assert len(names[field]) == place
        names[field].append(name)
    columns = {"time_s": rows["time_s"], "sequence": rows["sequence"]}
    columns |= {name: rows[field][:, k] for field in FIELDS for k, name in enumerate(names[field])}
    table = pa.table({name: _arrow(np.ascontiguousarray(column)) for name, column in columns.items()})
    table = table.replace_schema_metadata({_DOCUMENT_KEY: source.to_json().encode()})
    packed, content = path.with_name(path.name + _PACKED), io.BytesIO()
    split = ["time_s", *(n for field in ("values", "age_s", "numbers") for n in names[field])]
    parquet.write_table(
        table, content, row_group_size=max(_GROUP_ROWS, math.ceil(len(rows) / 20)), compression="zstd",
        use_dictionary=False, use_byte_stream_split=split, write_statistics=["time_s"],
    )  # fmt: skip
    write_whole(packed, content.getvalue())
    os.utime(packed, (rows["time_s"][-1],) * 2)  # its age is that of its steps
    path.unlink(missing_ok=True)


def _arrow(column: NDArray[Any]) -> Any:
    """Return numbers as a `pyarrow.Array`, by its buffer: for an array pyarrow would import pandas."""
    import pyarrow as pa  # noqa: PLC0415

    return pa.Array.from_buffers(pa.from_numpy_dtype(column.dtype), len(column), [None, pa.py_buffer(column)])


def pack_closed(folder: Path, name: str) -> None:
    """Pack every file of rows that nobody writes; a damaged one is left unchanged.

    Raises:
        OSError: A file cannot be written.
        ModuleNotFoundError: pyarrow is not installed.
    """
    for file in step_files(folder, name):
        if not file.is_packed and not is_being_written(file.path):
            with suppress(ValueError, KeyError, TypeError):
                pack(file.path)


class StepAppender:
    """Appends rows of one source to files, a new one each hour. For one thread.

    It locks the file that it writes, so that nobody packs or removes it.
    """

    def __init__(self, folder: Path, name: str, source: StepSource) -> None:
        self._folder, self._name, self._source = folder, name, source
        self._fd, self._size, self._end_s, self._path = -1, 0, -math.inf, folder

    def append(self, rows: NDArray[Any]) -> int:
        """Write the first rows, those of one hour, to the system.

        A file that somebody has deleted is begun anew.

        Args:
            rows: At least one row of `source.dtype`, in the order of time.

        Returns:
            The number of rows written.

        Raises:
            OSError: The disk refuses them; then none is written.
        """
        if self._fd >= 0 and os.fstat(self._fd).st_nlink == 0:
            self.close()  # somebody has deleted it
        if self._fd < 0 or rows["time_s"][0] >= self._end_s:
            self.close()
            self._open(float(rows["time_s"][0]))
        count = int(np.searchsorted(rows["time_s"], self._end_s))
        self._write(rows[:count].tobytes())
        return count

    def _open(self, time_s: float) -> None:
        make_folder(self._folder)
        stamp = f"{datetime.fromtimestamp(time_s, UTC):{_STAMP}}"
        for number in range(1, 1000):
            part = f"-{number}" if number > 1 else ""
            path = self._folder / f"{self._name}-{stamp}{part}{STEPS_SUFFIX}"
            if path.with_name(path.name + _PACKED).exists():
                continue
            with suppress(FileExistsError):
                self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, OWNER_ONLY)
                break
        self._path, self._size, self._end_s = path, 0, hour_end_s(time_s)
        with suppress(OSError):  # a file system without locks: nobody else writes a file of this name
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        try:
            self._write(self._source.to_json().encode() + b"\n")
        except OSError:
            self.close()
            path.unlink(missing_ok=True)
            raise

    def _write(self, data: bytes) -> None:
        try:
            rest = memoryview(data)
            while rest:
                rest = rest[os.pwrite(self._fd, rest, self._size + len(data) - len(rest)) :]
        except OSError:
            os.ftruncate(self._fd, self._size)
            raise
        self._size += len(data)

    def sync(self) -> None:
        """Return once everything is on the disk.

        Raises:
            OSError: The disk refuses it.
        """
        if self._fd >= 0:
            os.fsync(self._fd)

    def close(self) -> None:
        """Close the file, if there is one, and release its lock; the next row begins another."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
