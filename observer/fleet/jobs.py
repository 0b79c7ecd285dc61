"""The jobs of a fleet: a table or the command line assigns logs to machines and configurations."""

from __future__ import annotations

import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from glob import glob
from pathlib import Path
from typing import Any, Literal, NamedTuple

from observer import ConfigError, UserError, load
from observer.files.logs import SUFFIXES

Verb = Literal["replay", "identify", "calibrate", "discover"]
OF_SEVERAL: tuple[Verb, ...] = ("calibrate", "discover")
"""The verbs that take all logs of a machine together."""
COLUMNS = ("log", "machine", "config")
TAKEN = ("results.parquet", "report.html")
_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,63}")  # a name becomes a folder: no leading dot


class TableRow(NamedTuple):
    """A row of the fleet's table: one log, its machine, its configuration.

    Attributes:
        log: The absolute path of the log, which need not exist.
        machine: The machine's name, which becomes a folder.
        config: The absolute path of an existing configuration.
    """

    log: Path
    machine: str
    config: Path


@dataclass(frozen=True, slots=True)
class Job:
    """One piece of work: logs of one machine, by one configuration.

    Attributes:
        machine: The machine's name, the first folder of the results.
        name: The log's name without suffix, or the verb for a job on several logs.
        logs: The logs, in the order of the table.
        config: The configuration of all of them.
        folder: The folder of its results, relative to the output.
    """

    machine: str
    name: str
    logs: tuple[Path, ...]
    config: Path
    folder: Path


def read_table(path: Path) -> list[TableRow]:
    """Return the lines of a fleet's table (`.csv` or `.parquet`); its paths are relative to its own folder.

    A log's cell may be a pattern with * ? or [ ] for all files that match it, in their order. Empty rows are
    skipped.

    Returns:
        One line for each log, in the order of the table.

    Raises:
        UserError: If the table cannot be read, a cell is empty or invalid, a log is listed twice, or none of
            the logs exists. The text names the file and row.
    """
    numbered: list[tuple[int, TableRow]] = []
    for number, row in enumerate(_rows(path), 1):
        if any(str(cell or "").strip() for cell in row.values()):  # not as a spreadsheet leaves at its end
            cells = [str(row.get(column) or "").strip() for column in COLUMNS]
            place = f"{path}: row {number}"
            numbered += [(number, line) for line in _lines_of(place, path.parent, *cells)]
    _check_once(path, numbered)
    lines = [line for _, line in numbered]
    if not lines:
        raise UserError(f"{path}: names no log; give it rows of {', '.join(COLUMNS)}")
    if not any(line.log.is_file() for line in lines):
        raise UserError(
            f"{path}: none of its {len(lines)} logs exists, for instance {lines[0].log} for one; paths are "
            "relative to the table's own folder"
        )
    return lines


def _lines_of(place: str, folder: Path, log: str, machine: str, config: str) -> Iterator[TableRow]:
    """Yield the lines of a row: one, or one for each file that matches a pattern. Raises `UserError`."""
    for column, cell in zip(COLUMNS, (log, machine, config), strict=True):
        if not cell:
            raise UserError(f"{place}: {column} is empty; fill it or remove the row")
    if not _NAME.fullmatch(machine) or machine in TAKEN:
        raise UserError(
            f"{place}: {machine[:70]!r} is not a valid machine name; names consist of at most 64 letters, "
            f"digits and _.-, without a leading dot, and are not {' or '.join(TAKEN)}"
        )
    by = _below(folder, config)
    if not by.is_file():
        problem = "is a folder" if by.is_dir() else "is not there"
        raise UserError(f"{place}: config: {by} {problem}; give the path of a configuration")
    path = _below(folder, log)
    if path.is_dir():
        raise UserError(f"{place}: log: {path} is a folder; name its logs, as {log.rstrip('/')}/*.csv")
    if path.exists() or not set(log) & set("*?["):
        yield TableRow(path, machine, by)
        return
    fitting = sorted(file for file in map(Path, glob(str(path), recursive=True)) if file.is_file())
    if not fitting:
        raise UserError(f"{place}: log: no file matches {path}; paths are relative to the table's own folder")
    yield from (TableRow(file, machine, by) for file in fitting)


def _check_once(path: Path, numbered: Sequence[tuple[int, TableRow]]) -> None:
    """Reject a log that is listed twice for a machine, or for two machines of the same configuration."""
    first_rows: dict[tuple[str, str | Path], tuple[int, str]] = {}
    for number, line in numbered:
        log, machine, place = os.path.realpath(line.log), line.machine, f"{path}: row {number}: {line.log}"
        this = (number, machine)
        if (before := first_rows.setdefault((log, machine), this)) is not this:
            raise UserError(f"{place} of {machine} is there twice, in row {before[0]} already; remove one")
        before = first_rows.setdefault((log, line.config), this)
        if before[1] != machine:
            raise UserError(
                f"{place} is of {machine}, and by the same configuration of {before[1]} in row {before[0]}; "
                "remove one"
            )


def rows_of_logs(logs: Sequence[Path], config: Path) -> list[TableRow]:
    """Return a row for each log, all of the machine of one configuration.

    The machine's name is `machine.name`, a hyphen and `machine.axis`. Paths become absolute.

    Args:
        logs: The logs, which need not exist.
        config: The configuration.

    Raises:
        ConfigError: If the configuration is invalid, or its names cannot be a folder.
        UserError: If a log is named twice.
    """
    machine_table = load(config).config.machine
    machine = f"{machine_table.name}-{machine_table.axis}"
    if not _NAME.fullmatch(machine):
        raise ConfigError(
            f"{config}: machine.name: {machine} is to be a folder; use at most 64 letters and no dot in front"
        )
    lines = [TableRow(Path(os.path.abspath(log)), machine, Path(os.path.abspath(config))) for log in logs]
    for log, count in Counter(os.path.realpath(line.log) for line in lines).items():
        if count > 1:
            raise UserError(f"{log}: named {count} times; name it once")
    return lines


def jobs_of(lines: Iterable[TableRow], verb: Verb) -> list[Job]:
    """Return the jobs of a verb: one for each log, or one for all logs of a machine.

    Verbs of `OF_SEVERAL` take all logs of a machine together. Two logs of one name get different folders.

    Args:
        lines: The lines of a table.
        verb: What is done with the logs.

    Raises:
        UserError: If such a verb would need two configurations for one machine.
    """
    lines = list(lines)
    if verb not in OF_SEVERAL:
        return list(_singles(lines, verb))
    machines: dict[str, list[TableRow]] = {}
    for line in lines:
        machines.setdefault(line.machine, []).append(line)
    return [_job_of_machine(machine, rows, verb) for machine, rows in machines.items()]


def _singles(lines: Iterable[TableRow], verb: Verb) -> Iterator[Job]:
    """Yield a job for each log; a digest of its path is added to a name that is already in use."""
    used_names: set[tuple[str, str]] = set()
    for line in lines:
        name = stem = _stem(line.log)
        if (line.machine, stem) in used_names:
            name += "-" + hashlib.sha256(str(line.log).encode()).hexdigest()[:8]
        used_names.add((line.machine, stem))
        yield Job(line.machine, name, (line.log,), line.config, Path(line.machine, verb, name))


def _job_of_machine(machine: str, lines: Sequence[TableRow], verb: Verb) -> Job:
    """Return one job for all logs of a machine. Raises `UserError` if they have two configurations."""
    configs = sorted({line.config for line in lines})
    if len(configs) > 1:
        raise UserError(
            f"fleet {verb}: {machine} has two configurations, {configs[0]} and {configs[1]}; name one for "
            "all of its logs"
        )
    logs = tuple(line.log for line in lines)
    return Job(machine, verb, logs, configs[0], Path(machine, verb))


def _stem(log: Path) -> str:
    suffix = next((s for s in SUFFIXES if log.name.endswith(s)), log.suffix)
    return log.name.removesuffix(suffix).lstrip(".") or "log"


def _below(folder: Path, cell: str) -> Path:
    return Path(os.path.abspath(folder / Path(cell).expanduser()))


def _rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a fleet's table, unchecked. Raises `UserError` if it cannot be read."""
    import pyarrow as pa
    from pyarrow import csv, parquet

    try:
        if path.suffix == ".parquet":
            table = parquet.read_table(path)
        else:
            with path.open(encoding="utf-8-sig") as file:
                delimiter = max(",;\t", key=file.readline().count)  # as spreadsheets write in some countries
            as_text = csv.ConvertOptions(column_types=dict.fromkeys(COLUMNS, pa.string()))
            one_by_one = csv.ReadOptions(use_threads=False)  # an error then says in which row
            table = csv.read_csv(path, one_by_one, csv.ParseOptions(delimiter=delimiter), as_text)
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UserError(
            f"{path}: cannot be read ({reason}); give the table as .parquet or as CSV in UTF-8, a cell with "
            "a comma in quotes"
        ) from None
    table = table.rename_columns([name.strip() for name in table.column_names])
    for column in COLUMNS:
        if (count := table.column_names.count(column)) != 1:
            columns = ", ".join(name[:40] for name in table.column_names[:8]) or "nothing"
            raise UserError(
                f"{path}: column {column} is {'there twice' if count else 'missing'}; a fleet's table has "
                f"the columns {', '.join(COLUMNS)}, and its first line says {columns}"
            )
    rows: list[dict[str, Any]] = table.select(COLUMNS).to_pylist()
    return rows
