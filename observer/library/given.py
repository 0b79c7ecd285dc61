"""Logs as users of the library have them: files, pandas tables, columns, results of a simulation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from observer.align.aligner import refuse_empty
from observer.errors import LogError
from observer.files.logs import TIME, Log, log_of
from observer.files.logs import read_log as read_file
from observer.installation import Installation
from observer.intake.reading import own_header, read_channels
from observer.intake.sentinels import cleaned
from observer.library.packages import in_words
from observer.library.signals import SignalTable
from observer.tables.logs import Logs

GivenLog = str | Path | Log | SignalTable | Mapping[str, Any] | Any
"""A log's path, a `Log`, the result of a simulation, columns by name, or a `pandas.DataFrame`."""


@in_words
def read_log(path: str | Path, *, accept_truncated: bool = False, accept_damaged: bool = False) -> Log:
    """Read a log, with all of its channels.

    One in our own form, or any other that `observer import` reads without asking: its channels then have the
    names and units of the file's columns, as `"Temp1 [°F]"`, and `doubts` says what was assumed of its times.
    A machine that is given the path instead reads the file by its `[log]`. `accept_truncated` drops a last
    row that was cut off, `accept_damaged` the rows of a recording that do not have the checksum they were
    recorded with. Raises `LogError` with one sentence that names the file, the row or column, and the remedy.
    """
    from observer.intake.importing import read_whole

    if own_header(Path(path), Logs()) is None:
        return read_whole(Path(path), accept_truncated=accept_truncated)
    log = read_file(path, accept_truncated=accept_truncated, accept_damaged=accept_damaged)
    return cleaned(log, Logs())


def recorded(path: Path, config: Installation, **accept: bool) -> Log:
    """Return a log of channels, each input of which has a value somewhere, or a recording of a CAN bus."""
    from observer.intake.readers import holds_signals, is_text_log
    from observer.record.recent import is_can_recording, read_can_log

    if is_can_recording(path) and not holds_signals(path) and not is_text_log(path):
        return read_can_log(path, config)
    log = read_channels(path, config, spare=(), **accept)
    refuse_empty(log, config, sensors=True)
    return log


def as_log(
    given: GivenLog, config: Installation, name: str = "log", *, accept: Mapping[str, bool] | None = None
) -> Log:
    """Return the given log, with a configuration's channels.

    `accept` has the options of `observer.read_log`, which concern files. Raises `LogError`.
    """
    if isinstance(given, str | Path):
        return recorded(Path(given), config, **(accept or {}))
    log = _in_memory(given, name)
    derived = config.derived_channels - set(log.channels)
    there = [c for c in config.channels if c not in derived]
    log = log.with_channels(there)
    refuse_empty(log, config, sensors=True)
    return log


def as_program(given: GivenLog, config: Installation, name: str = "log", spare: Iterable[str] = ()) -> Log:
    """Return the given log of a machine's inputs; sensors and `spare` channels may be missing in a file.

    Raises `LogError`.
    """
    if isinstance(given, str | Path):
        return read_channels(Path(given), config, spare=config.sensor_channels | set(spare))
    return _in_memory(given, name)


def as_several(given: GivenLog | Sequence[GivenLog], config: Installation) -> list[Log]:
    """Return one or more logs, each once. Raises `LogError`."""
    several = given if isinstance(given, list | tuple) else [given]
    if not several:
        raise LogError("no log was given; give one or more")
    return [as_log(one, config, f"log {i}") for i, one in enumerate(several, 1)]


def _in_memory(given: Any, name: str) -> Log:
    if isinstance(given, Log):
        return given
    if isinstance(given, SignalTable):
        return log_of({signal: given[signal] for signal in (TIME, *given.signals)}, name)
    if isinstance(given, Mapping):
        return log_of(given, name)
    columns = getattr(given, "columns", None)
    if columns is None or not hasattr(given, "__getitem__"):
        raise LogError(
            f"{name}: a {type(given).__name__} is not a log; give a path, a Log, a DataFrame or a dict "
            "of its "
            "columns"
        )
    table = {str(column): given[column] for column in columns}
    if TIME not in table and getattr(given.index, "name", None) == TIME:
        table[TIME] = given.index
    return log_of(table, name)
