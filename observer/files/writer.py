"""Writing a table in blocks: it has its final name only when it is complete."""

from __future__ import annotations

import csv
import io
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from observer.errors import LogError
from observer.files.log_checks import DOUBT_LINE, DOUBTS
from observer.files.logs import TIME, suffix_of
from observer.frames import FloatArray

Column = NDArray[np.float64] | NDArray[np.str_]


class TableSink(Protocol):
    """A writer of the blocks of a table.

    `TableWriter` makes a file of them, `TemporaryTable` keeps them for this process.
    """

    def write(self, columns: Mapping[str, Column]) -> None:
        """Append rows, arrays (K,) by name; every block has the same columns in the same order."""


class TemporaryTable:
    """Stores the blocks of a table in a temporary file: the estimates of a long log may not fit into
    memory.

    The file has no name and vanishes with this object, also if the process is killed.

    Attributes:
        table: The `pyarrow.Table`, mapped from the file; it exists after the `with` block.

    Raises:
        LogError: The folder for temporary files has no room.
    """

    def __enter__(self) -> TemporaryTable:
        import pyarrow as pa  # noqa: PLC0415

        try:
            self._descriptor, name = tempfile.mkstemp(prefix="observer-")
        except OSError as error:
            raise _no_room(error) from None
        os.unlink(name)  # a process that is killed leaves nothing behind
        self._path = f"/proc/self/fd/{self._descriptor}"
        self._sink: Any = pa.OSFile(self._path, "wb")
        self._writer: Any = None
        return self

    def write(self, columns: Mapping[str, Column]) -> None:
        """Append rows, arrays (K,) by name; every block has the same columns in the same order.

        Raises:
            LogError: The folder for temporary files has no room.
        """
        import pyarrow as pa  # noqa: PLC0415

        block = arrow_table(columns)
        try:
            self._writer = self._writer or pa.ipc.new_file(self._sink, block.schema)
            self._writer.write_table(block)
        except OSError as error:
            raise _no_room(error) from None

    def __exit__(self, kind: type[BaseException] | None, *_error: object) -> None:
        import pyarrow as pa  # noqa: PLC0415

        try:
            if kind is None:
                self._writer.close()
                self._sink.close()
                self._file = pa.ipc.open_file(pa.OSFile(self._path))
                self.table = pa.ipc.open_file(pa.memory_map(self._path)).read_all()
        except OSError as error:
            raise _no_room(error) from None
        finally:
            os.close(self._descriptor)

    def blocks(self) -> Iterator[Any]:
        """Read the blocks from the file, one `pyarrow.Table` at a time; only after the `with` block."""
        import pyarrow as pa  # noqa: PLC0415

        for i in range(self._file.num_record_batches):
            yield pa.Table.from_batches([self._file.get_batch(i)])


def _no_room(error: OSError) -> LogError:
    return LogError(
        f"{tempfile.gettempdir()}: estimates cannot be stored there ({error.strerror or error}); free space, "
        "or set TMPDIR to another folder"
    )


def arrow_table(columns: Mapping[str, Column]) -> Any:
    """Return columns (K,) by name as a `pyarrow.Table`, in which NaN is null."""
    import pyarrow as pa  # noqa: PLC0415

    return pa.table({name: pa.array(column, from_pandas=True) for name, column in columns.items()})


class TableWriter:
    """Writes blocks of columns as CSV, CSV.gz or Parquet, by the suffix of `path`.

    Numbers are written so that reading them gives the same bits; NaN is an empty cell. The file takes the
    place of an older one when the `with` block ends without an exception, and vanishes otherwise.

    Raises:
        LogError: The suffix is another, or the file cannot be written.
    """

    def __init__(self, path: Path, doubts: Sequence[str] = ()) -> None:
        self._path = path
        self._doubts = [" ".join(sentence.split()) for sentence in doubts]
        self._suffix = suffix_of(path)
        self._part = path.with_name(f".{path.name}.part")
        self._sink: Any = None
        self._parquet: Any = None
        self._names: tuple[str, ...] | None = None

    def __enter__(self) -> TableWriter:
        import pyarrow as pa  # noqa: PLC0415 - slow to import, and the daemon's path does without

        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._sink = pa.OSFile(str(self._part), "wb")
        except OSError as error:
            raise self._unwritable(error) from None
        if self._suffix == ".csv.gz":
            self._sink = pa.CompressedOutputStream(self._sink, "gzip")
        return self

    def write(self, columns: Mapping[str, Column]) -> None:
        """Append rows, arrays (K,) by name.

        Raises:
            ValueError: The columns differ from those of the first block.
            LogError: The file cannot be written.
        """
        self.write_arrow(arrow_table(columns))

    def write_arrow(self, table: Any) -> None:
        """Append the rows of a `pyarrow.Table`.

        Raises:
            ValueError: The columns differ from those of the first block.
            LogError: The file cannot be written.
        """
        names = tuple(table.column_names)
        first, self._names = self._names is None, self._names or names
        if names != self._names:
            raise ValueError("a block has other columns than the first one")
        try:
            self._write_parquet(table) if self._suffix == ".parquet" else self._write_csv(table, first)
        except OSError as error:
            raise self._unwritable(error) from None

    def _write_csv(self, table: Any, first: bool) -> None:
        from pyarrow import csv as pa_csv  # noqa: PLC0415

        if first:
            line = io.StringIO()
            csv.writer(line, lineterminator="\n").writerow(table.column_names)
            self._sink.write(line.getvalue().encode())
        options = pa_csv.WriteOptions(include_header=False, quoting_style="none")
        pa_csv.write_csv(table, self._sink, options)

    def _write_parquet(self, table: Any) -> None:
        from pyarrow import parquet  # noqa: PLC0415

        if self._parquet is None:
            schema = table.schema
            if self._doubts:
                schema = schema.with_metadata({DOUBTS: "\n".join(self._doubts).encode()})
            self._parquet = parquet.ParquetWriter(self._sink, schema, write_page_checksum=True)
        self._parquet.write_table(table)

    def __exit__(self, kind: type[BaseException] | None, *_error: object) -> None:
        try:
            if self._parquet is not None:
                self._parquet.close()
            elif kind is None:
                self._sink.write(b"".join(DOUBT_LINE[1:] + d.encode() + b"\n" for d in self._doubts))
            self._sink.close()
            if kind is None:
                self._part.replace(self._path)
        except OSError as problem:
            if kind is None:
                raise self._unwritable(problem) from None
        finally:
            self._part.unlink(missing_ok=True)

    def _unwritable(self, error: OSError) -> LogError:
        reason = error.strerror or error
        return LogError(f"{self._path}: cannot be written ({reason}); free space or choose another place")


def write_log(
    path: Path, time_s: FloatArray, columns: Mapping[str, Column], doubts: Sequence[str] = ()
) -> None:
    """Write a whole log.

    Args:
        path: The file; its suffix chooses the format.
        time_s: Times (n,), which become the first column.
        columns: Cells (n,) by name; NaN is an empty cell.
        doubts: Sentences that every command shows which reads the log.

    Raises:
        LogError: The suffix is unknown, or the file cannot be written.
    """
    with TableWriter(path, doubts) as writer:
        writer.write({TIME: time_s, **columns})
