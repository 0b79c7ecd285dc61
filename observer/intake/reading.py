"""The one way in which commands read a log: directly if it has the program's own form, by `[log]` if not."""

from __future__ import annotations

import csv
import zlib
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from observer.align.plausibility import ChannelKind, kinds_of
from observer.config.logs import Logs
from observer.config.machine import Config
from observer.files.logs import FLAGS, STEP, SUFFIXES, TIME, Log, read_log
from observer.intake.join import with_steps
from observer.intake.layout import is_value
from observer.intake.mapped import keeps_its_value, read_foreign
from observer.intake.sentinels import cleaned

_HEAD = 65_536


def read_channels(
    path: Path,
    config: Config,
    *,
    spare: Collection[str] = (),
    **accept: bool,
) -> Log:
    """Read the channels of a configuration from a log, in the program's own form or in another recorder's.

    Args:
        path: The log.
        config: The machine with its channels and `[log]`.
        spare: Channels that may be missing.
        accept: `accept_truncated` and `accept_damaged`, as of `read_log`.

    Raises:
        LogError: The file cannot be read, or a channel is missing.
        ModuleNotFoundError: The package for the file's format is not installed.
    """
    options = config.log
    header = own_header(path, options)
    none_of_ours = header is not None and len(header) > 1 and not set(config.channels) & set(header)
    if header is None or none_of_ours:
        return read_foreign(
            [path], config, spare=spare, accept_truncated=accept.get("accept_truncated", False)
        )
    spare = {*spare, *config.derived_channels}
    required = [name for name in config.channels if name in header or name not in spare]
    log = read_log(path, required, rows_apart_s=options.rows_apart_s, missing=options.missing, **accept)
    log = cleaned(log, options)
    return log if log.step is not None or not options.hold else with_held_inputs(log, config)


def with_held_inputs(log: Log, config: Config) -> Log:
    """Return a log whose inputs keep their value until the next row: rows are inserted where they change.

    Temperatures of the screw and its nodes, and positions, have no value in the inserted rows.
    """
    kinds = kinds_of(config)
    keeping = np.array([keeps_its_value(kinds.get(name, ChannelKind.SCREW)) for name in log.channels])
    time_s, values = with_steps(log.time_s, log.values, keeping)
    return replace(log, time_s=time_s, values=values, joined=log.joined or len(time_s) > len(log))


def own_header(path: Path, options: Logs) -> list[str] | None:
    """Return the columns of a log in the program's own form.

    Only the head of the file is read. A file that cannot be read counts as one of the own form, so that
    reading it reports the reason.

    Returns:
        The names, `time_s` first; None for any other form, or if `[log.columns]` names columns of the file.
    """
    suffix = next((ending for ending in SUFFIXES if path.name.endswith(ending)), None)
    if suffix is None:
        return None
    try:
        header = _parquet_header(path) if suffix == ".parquet" else _csv_header(path)
    except OSError:
        return [TIME]
    if header is None or (STEP in header and FLAGS in header):
        return header
    has_new_names = all(
        name in header and entry.column not in header for name, entry in options.columns.items()
    )
    return header if has_new_names else None


def _csv_header(path: Path) -> list[str] | None:
    """Return the columns' names of a log in the program's own form, None for any other file.

    A damaged `.gz` file counts as the own form, so that its reader reports the damage.
    """
    with path.open("rb") as file:
        data = file.read(_HEAD)
    if path.name.endswith(".gz"):
        try:
            data = zlib.decompressobj(wbits=zlib.MAX_WBITS | 16).decompress(data, _HEAD)
        except zlib.error:
            return [TIME]
    lines = data.split(b"\n", 2)
    try:
        header = [cell.strip() for cell in next(csv.reader([lines[0].decode("utf-8-sig")]), [])]
        first = lines[1].decode("utf-8").split(",", 1)[0].strip() if len(lines) > 1 else ""
    except (UnicodeDecodeError, csv.Error):
        return None
    written = ":" in first and is_value(first)  # a date, though the column has our name
    return header if header[:1] == [TIME] and not written else None


def _parquet_header(path: Path) -> list[str] | None:
    import pyarrow as pa  # noqa: PLC0415 - slow to import, and the daemon reads no log
    from pyarrow import parquet, types  # noqa: PLC0415

    try:
        schema = parquet.read_schema(path)
    except (pa.ArrowException, UnicodeDecodeError):
        return [TIME]
    is_own_form = schema.names[:1] == [TIME] and not types.is_temporal(schema.field(0).type)
    return list(schema.names) if is_own_form else None
