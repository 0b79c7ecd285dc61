"""Parquet, Arrow and Feather, with their own types of times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from observer.files.logs import CELL_BYTES
from observer.files.regular import refuse_large
from observer.intake.sheets import RawColumn, Sheet


def read_arrow(path: Path, kind: str) -> list[Sheet]:
    """Read the table of a Parquet, Arrow or Feather file.

    Columns that are neither numbers, moments nor text are left out. The field's metadata `unit` is its unit.

    Args:
        path: The file.
        kind: Its suffix: `.parquet`, or any of the others.

    Raises:
        LogError: The table would be too large for the memory.
        pyarrow.ArrowException: The file is damaged.
    """
    table = _parquet_table(path) if kind == ".parquet" else _ipc_table(path)
    columns = [_column(field, table.column(i)) for i, field in enumerate(table.schema)]
    return [Sheet(path, "", tuple(column for column in columns if column is not None))]


def _parquet_table(path: Path) -> Any:
    from pyarrow import parquet  # noqa: PLC0415 - slow to import, and the daemon reads no log

    with parquet.ParquetFile(path, page_checksum_verification=True) as file:
        refuse_large(path, CELL_BYTES * file.metadata.num_rows * file.metadata.num_columns)
        return file.read()


def _ipc_table(path: Path) -> Any:
    """Read a Feather or Arrow file batch by batch, so that its size is known before it fills the memory."""
    import pyarrow as pa  # noqa: PLC0415

    with pa.OSFile(str(path)) as source:
        reader = pa.ipc.open_file(source)
        batches, size_bytes = [], 0
        for number in range(reader.num_record_batches):
            batches.append(reader.get_batch(number))
            size_bytes += batches[-1].nbytes
            refuse_large(path, size_bytes)
        return pa.Table.from_batches(batches, reader.schema)


def _column(field: Any, cells: Any) -> RawColumn | None:
    """A column of numbers, moments or text; None for one of anything else."""
    import pyarrow as pa  # noqa: PLC0415
    from pyarrow import types  # noqa: PLC0415

    unit = ((field.metadata or {}).get(b"unit") or b"").decode("utf-8", "replace")
    cells = cells.combine_chunks()
    if types.is_dictionary(cells.type):
        cells = cells.cast(cells.type.value_type)
    kind = cells.type
    if types.is_timestamp(kind) or types.is_date(kind):
        moments = cells.cast(pa.timestamp("ns", getattr(kind, "tz", None)), safe=False).to_numpy(
            zero_copy_only=False
        )
        return RawColumn(
            field.name, moments.astype("datetime64[ns]"), unit, utc=getattr(kind, "tz", None) is not None
        )
    if types.is_duration(kind):
        seconds = cells.cast(pa.duration("ns")).cast(pa.int64()).cast(pa.float64(), safe=False)
        return RawColumn(field.name, np.asarray(seconds.to_numpy(zero_copy_only=False)) / 1e9, "s")
    if types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind) or types.is_boolean(kind):
        numbers = cells.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
        return RawColumn(field.name, np.asarray(numbers, dtype=np.float64), unit)
    if types.is_string(kind) or types.is_large_string(kind):
        return RawColumn(field.name, cells.cast(pa.string()), unit)
    return None
