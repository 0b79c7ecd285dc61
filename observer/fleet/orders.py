"""What is to be done: which logs belong to which machine and which configuration, by a table or as given."""

from __future__ import annotations

import csv
import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from observer.errors import ConfigError, UserError
from observer.files.logs import SUFFIXES
from observer.installation import load

Verb = Literal["replay", "identify", "calibrate", "discover"]
OF_SEVERAL: tuple[Verb, ...] = ("calibrate", "discover")
"""The verbs that take all logs of a machine together."""
COLUMNS = ("log", "machine", "config")
_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,63}")  # a name becomes a folder: no dot in front


class Line(NamedTuple):
    """A line of the table."""

    log: Path
    machine: str
    config: Path


@dataclass(frozen=True, slots=True)
class Order:
    """One piece of work: logs of one machine, by one configuration; `place` is its folder in the output."""

    machine: str
    name: str
    logs: tuple[Path, ...]
    config: Path
    place: Path


def read_table(path: Path) -> list[Line]:
    """Read the table of a fleet (`.csv` or `.parquet`); its paths go out from its own folder.

    Raises `UserError` that names the row.
    """
    rows = _parquet_rows(path) if path.suffix == ".parquet" else _csv_rows(path)
    lines, seen = [], set()
    for number, row in enumerate(rows, 1):
        log, machine, config = (str(row.get(column) or "").strip() for column in COLUMNS)
        for column, cell in zip(COLUMNS, (log, machine, config), strict=True):
            if not cell:
                raise UserError(f"{path}: row {number}: {column} is empty; fill it or remove the row")
        if not _NAME.fullmatch(machine):
            raise UserError(
                f"{path}: row {number}: {machine[:70]!r} is no machine's name; names are of letters, "
                "digits and _.-, 64 at most, without a dot in front"
            )
        if (log, machine) in seen:
            raise UserError(f"{path}: row {number}: {log} of {machine} stands there twice; remove one")
        seen.add((log, machine))
        lines.append(Line(_below(path, log), machine, _below(path, config)))
    if not lines:
        raise UserError(f"{path}: names no log; give it rows of {', '.join(COLUMNS)}")
    return lines


def given(logs: Sequence[Path], config: Path) -> list[Line]:
    """Logs that all are of the machine of one configuration. Raises `ConfigError`."""
    about = load(config).machine
    machine = f"{about.name}-{about.axis}"
    if not _NAME.fullmatch(machine):
        raise ConfigError(
            f"{config}: machine.name: {machine} is to be a folder; use at most 64 letters and no dot in front"
        )
    return [Line(Path(os.path.abspath(log)), machine, Path(os.path.abspath(config))) for log in logs]


def orders_of(lines: Iterable[Line], verb: Verb) -> list[Order]:
    """Return the pieces of work of a verb: one for each log, or one for all logs of a machine.

    Raises `UserError` where a verb would need two configurations of one machine.
    """
    lines = list(lines)
    if verb not in OF_SEVERAL:
        stems = Counter((line.machine, _stem(line.log)) for line in lines)
        return [_single(line, verb, alone=stems[line.machine, _stem(line.log)] == 1) for line in lines]
    machines: dict[str, list[Line]] = {}
    for line in lines:
        machines.setdefault(line.machine, []).append(line)
    return [_together(machine, own, verb) for machine, own in machines.items()]


def _single(line: Line, verb: Verb, *, alone: bool) -> Order:
    """Work on one log; where another has the same name, its path tells them apart."""
    name = _stem(line.log)
    if not alone:
        name += "-" + hashlib.sha256(str(line.log).encode()).hexdigest()[:8]
    return Order(line.machine, name, (line.log,), line.config, Path(line.machine, verb, name))


def _together(machine: str, lines: Sequence[Line], verb: Verb) -> Order:
    configs = sorted({line.config for line in lines})
    if len(configs) > 1:
        raise UserError(
            f"fleet {verb}: {machine} has two configurations, {configs[0]} and {configs[1]}; name one for "
            "all of its logs"
        )
    logs = tuple(line.log for line in lines)
    return Order(machine, verb, logs, configs[0], Path(machine, verb))


def _stem(log: Path) -> str:
    suffix = next((s for s in SUFFIXES if log.name.endswith(s)), log.suffix)
    return log.name.removesuffix(suffix).lstrip(".") or "log"


def _below(table: Path, cell: str) -> Path:
    return Path(os.path.abspath(table.parent / cell))


def _csv_rows(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            _check_columns(path, reader.fieldnames or ())
            return list(reader)
    except (UnicodeDecodeError, csv.Error):
        raise UserError(f"{path}: not CSV in UTF-8; save the table so, or as .parquet") from None
    except OSError as error:
        raise _unreadable(path, error) from None


def _parquet_rows(path: Path) -> list[dict[str, str]]:
    import pyarrow as pa
    from pyarrow import parquet

    try:
        table = parquet.read_table(path)
    except OSError as error:
        raise _unreadable(path, error) from None
    except pa.ArrowException:
        raise UserError(f"{path}: damaged or not Parquet; write it again") from None
    _check_columns(path, table.column_names)
    rows: list[dict[str, str]] = table.select(COLUMNS).to_pylist()
    return rows


def _unreadable(path: Path, error: OSError) -> UserError:
    return UserError(f"{path}: cannot be read ({error.strerror or 'damaged'}); give the table of the fleet")


def _check_columns(path: Path, names: Sequence[str]) -> None:
    missing = [column for column in COLUMNS if column not in names]
    if missing:
        raise UserError(
            f"{path}: column {missing[0]} is missing; a fleet's table has the columns {', '.join(COLUMNS)}"
        )
