"""Logs as users of the library have them: files, pandas tables, columns, results of a simulation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from observer.align.aligner import refuse_empty
from observer.config.logs import Logs
from observer.errors import LogError
from observer.files.logs import TIME, Log, log_of
from observer.files.logs import read_log as read_file
from observer.installation import Installation
from observer.intake.reading import own_header, read_channels
from observer.intake.sentinels import cleaned
from observer.library.packages import in_words
from observer.library.signals import SignalTable

GivenLog = str | Path | Log | SignalTable | Mapping[str, Any] | Any
"""A log's path, a `Log`, the result of a simulation, columns by name, or a `pandas.DataFrame`."""


@in_words
def read_log(path: str | Path, *, accept_truncated: bool = False, accept_damaged: bool = False) -> Log:
    """Read a log, with all of its channels.

    Logs in another form are read as by `observer import` without options. Their channels have the names and
    units of the file's columns, as `"Temp1 [°F]"`; `doubts` states what was assumed of their times. Give the
    path to a machine instead to have the file read by the configuration's `[log]`.

    Args:
        path: CSV, compressed CSV, Parquet, or a log as another recorder wrote it.
        accept_truncated: Drop a last row that was cut off, instead of refusing the file.
        accept_damaged: Drop the rows of a recording whose checksum is wrong, instead of refusing the file.

    Returns:
        The log with its times in seconds, values (K, c), and NaN for missing values.

    Raises:
        LogError: The file cannot be read; one sentence names the file, the row or column, and the remedy.
    """
    from observer.intake.importing import read_whole

    if own_header(Path(path), Logs()) is None:
        return read_whole(Path(path), accept_truncated=accept_truncated)
    log = read_file(path, accept_truncated=accept_truncated, accept_damaged=accept_damaged)
    return cleaned(log, Logs())


def recorded(path: Path, config: Installation, **accept: bool) -> Log:
    """Return a file's log, with the channels of a configuration; it may be a recording of a CAN bus.

    Args:
        path: The file; a CAN recording is decoded by the drivers of the configuration.
        config: The machine whose channels and `[log]` are used.
        accept: The options of `observer.read_log`.

    Raises:
        LogError: The file cannot be read, or an input or every sensor has no value in any row.
    """
    from observer.intake.readers import holds_signals, is_text_log
    from observer.record.recent import is_can_recording, read_can_log

    if is_can_recording(path) and not holds_signals(path) and not is_text_log(path):
        return read_can_log(path, config)
    log = read_channels(path, config, spare=(), **accept)
    refuse_empty(log, config, sensors=True)
    return log


def as_log(
    log_given: GivenLog, config: Installation, name: str = "log", *, accept: Mapping[str, bool] | None = None
) -> Log:
    """Return the given log, with a configuration's channels.

    Args:
        log_given: A path, or a log as an object.
        config: The machine whose channels are needed.
        name: Names a log without a file in errors.
        accept: The options of `observer.read_log`, which concern files; None for none of them.

    Raises:
        LogError: The object is not a log, a channel is missing, or an input or every sensor has no value.
    """
    if isinstance(log_given, str | Path):
        return recorded(Path(log_given), config, **(accept or {}))
    log = _in_memory(log_given, name)
    derived = config.derived_channels - set(log.channels)
    stored = [c for c in config.channels if c not in derived]
    log = log.with_channels(stored)
    refuse_empty(log, config, sensors=True)
    return log


def as_program(
    log_given: GivenLog, config: Installation, name: str = "log", spare: Iterable[str] = ()
) -> Log:
    """Return the given log of a machine's inputs.

    Args:
        log_given: A path, or a log as an object, whose channels are checked later.
        config: The machine whose inputs a file must have; its sensors may be missing.
        name: Names a log without a file in errors.
        spare: Further channels that a file may lack, as they get a constant value.

    Raises:
        LogError: The file cannot be read, an input is missing in it, or the object is not a log.
    """
    if isinstance(log_given, str | Path):
        return read_channels(Path(log_given), config, spare=config.sensor_channels | set(spare))
    return _in_memory(log_given, name)


def as_several(logs_given: GivenLog | Sequence[GivenLog], config: Installation) -> list[Log]:
    """Return one log or a list of logs as a list, each with the configuration's channels.

    Logs without a file are called `log 1`, `log 2` … in errors.

    Raises:
        LogError: The list is empty, or one of them is not usable as a log.
    """
    several = logs_given if isinstance(logs_given, list | tuple) else [logs_given]
    if not several:
        raise LogError("no log was given; give one or more")
    return [as_log(one, config, f"log {i}") for i, one in enumerate(several, 1)]


def _in_memory(log_given: Any, name: str) -> Log:
    """Return a log that is given as an object. Raises `LogError` where its type is not one of a log."""
    if isinstance(log_given, Log):
        return log_given
    if isinstance(log_given, SignalTable):
        return log_of({signal: log_given[signal] for signal in (TIME, *log_given.signals)}, name)
    if isinstance(log_given, Mapping):
        return log_of(log_given, name)
    columns = getattr(log_given, "columns", None)
    if columns is None or not hasattr(log_given, "__getitem__"):
        raise LogError(
            f"{name}: a {type(log_given).__name__} is not a log; give a path, a Log, a DataFrame or a dict "
            "of its "
            "columns"
        )
    table = {str(column): log_given[column] for column in columns}
    if TIME not in table and getattr(log_given.index, "name", None) == TIME:
        table[TIME] = log_given.index
    return log_of(table, name)
