"""The proposal of `observer import`: the `[log]` table that makes files a log, and its doubts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from observer.align.plausibility import kinds_of
from observer.config import Config
from observer.errors import LogError
from observer.files.log_checks import several
from observer.files.logs import Log
from observer.files.writer import write_log
from observer.intake.guess import Guess, columns_of_numbers, guessed
from observer.intake.mapped import Placed, logged, mapped, misunderstood, no_clock, placed_columns
from observer.intake.sheets import full_name
from observer.intake.sources import Sources, sources_of
from observer.intake.units import shown_unit, unit_of_channel
from observer.tables.logs import LogColumn, Logs

SHOWN_ROWS = 4
MOST_APART_S = 20.0
"""If numbers without a unit are further apart, they may be milliseconds or minutes."""


@dataclass(frozen=True, slots=True, eq=False)
class ImportedLog:
    """A log of files from other recorders; `table` is the `[log]` that reads such files directly.

    `asked` are doubts about guesses, sentences by the key of `[log]` that settles them. Compare `log` with
    `shown` before you use it while there are any.
    """

    log: Log
    how: Logs
    asked: dict[str, str]
    shown: tuple[tuple[str, ...], ...]
    zoneless: bool

    @property
    def doubts(self) -> tuple[str, ...]:
        """What every reader of the log is to know: doubts, cells read as missing, and what was confirmed."""
        confirmed = (f"{key}: {doubt}; confirmed at the import" for key, doubt in self.asked.items())
        words = (words.text for words in self.log.words)
        return tuple(dict.fromkeys((*self.log.doubts, *words, *confirmed)))

    @property
    def table(self) -> str:
        """The `[log]` table that reads such files, as TOML."""
        return table_of(self.how)

    def write(self, path: str | Path, *, agreed: bool = False) -> None:
        """Write the log as CSV or Parquet, by the suffix.

        Raises `LogError` where it cannot be written, or where something is doubtful and not `agreed`.
        """
        if self.asked and not agreed:
            doubts = [f"  {key}: {doubt}" for key, doubt in self.asked.items()]
            first = f"{path}: not written, because this is doubtful; clarify it in the configuration:"
            raise LogError("\n".join([first, *doubts, "the guess was", self.table]))
        columns = {name: self.log[name] for name in self.log.channels}
        write_log(Path(path), self.log.time_s, columns, self.doubts)


def proposed(paths: Sequence[Path], config: Config, how: Logs) -> ImportedLog:
    """Read files by given and guessed keys. Raises `LogError` with all that cannot be guessed."""
    sources = sources_of(paths, how)
    name = " + ".join(map(str, paths))
    if not sources.timed:
        raise several(name, list(sources.problems) or [no_clock(sources, how)])
    guess = guessed(sources, config, how)
    found = how.model_copy(update={"columns": guess.columns, "long": how.long or sources.long})
    if guess.missing or guess.problems:
        problems = [*sources.problems, *guess.problems]
        raise several(
            name, [*problems, *(_unplaced(channel, sources, guess, how) for channel in guess.missing)]
        )
    log = mapped(sources, paths, config, found)
    asked = {f"[log.columns] {channel}": said for channel, said in guess.doubts.items()}
    asked |= _of_time(sources, how)
    zoneless = any(s.clock.on_wall for s in sources.timed)
    return ImportedLog(log, found, asked, tuple(_rows(sources, config, found)), zoneless)


def _unplaced(channel: str, sources: Sources, guess: Guess, how: Logs) -> str:
    """The sentence for a channel without a column: what was named and is not there, and what is left."""
    taken = {entry.column for entry in guess.columns.values()}
    clocks = {name for source in sources.timed for name in source.clock.columns}
    names = dict.fromkeys(full_name(c) for s in sources.timed for c in s.sheet.columns)
    spare = [f'"{name}"' for name in names if name not in taken and name not in clocks]
    named = f'there is no column "{how.columns[channel].column}"; ' if channel in how.columns else ""
    choice = f", one of {', '.join(spare[:12])}" if spare else "; no column is left for it, add it to the log"
    return f'{named}name its column with [log.columns] {channel} = "…"{choice}'


def read_whole(path: Path, *, accept_truncated: bool = False) -> Log:
    """Read a file from another recorder with every column of numbers, called as in the file and in its unit.

    Raises `LogError` with all problems, doubts about the clock among them.
    """
    how = Logs()
    sources = sources_of([path], how, accept_truncated=accept_truncated)
    if not sources.timed:
        raise several(path, list(sources.problems) or [no_clock(sources, how)])
    asked = [f"{key}: {doubt}" for key, doubt in _of_time(sources, how).items()]
    if asked:
        asked.append("say it in the configuration of a machine, which then reads the file itself")
    placed = dict[str, list[Placed]]()
    for source in sources.timed:
        for found in columns_of_numbers(source):
            placed.setdefault(found.name, []).append(Placed(found.name, source, found.column, "", ""))
    columns = [part.column for parts in placed.values() for part in parts]
    doubts = [*sources.doubts, *misunderstood(columns)]
    return logged([path], placed, how, {}, [*sources.problems, *asked], doubts)


def _of_time(sources: Sources, how: Logs) -> dict[str, str]:
    """Doubts about the clocks, by the key that settles them."""
    asked = dict[str, str]()
    for source in sources.timed:
        clock = source.clock
        apart_s = float(np.median(np.diff(clock.time_s))) if len(clock.time_s) > 1 else 0.0
        if not clock.sure and how.time_format is None and apart_s > MOST_APART_S:
            asked["[log] time_format"] = (
                f'{clock.columns[0]} has no unit and its rows are {apart_s:.4g} apart: "s", "ms", "min"?'
            )
        for doubt in clock.doubts:
            asked["[log] timezone" if "timezone" in doubt else "[log] time_format"] = doubt
    walls = {s.clock.on_wall for s in sources.timed if s.clock.since_1970}
    if len(walls) > 1:
        asked["[log] timezone"] = "some clocks have a zone and others do not; give the zone of these"
    return asked


def _rows(sources: Sources, config: Config, how: Logs) -> list[tuple[str, ...]]:
    """Channel, column, unit in the file and unit of the channel, and the first cells as the file has them.

    Above them each clock: its columns, what it counts, and the first times in s.
    """
    placed, _ = placed_columns(sources, config, how, [])
    kinds, found = kinds_of(config), list[tuple[str, ...]]()
    for clock in {source.clock.columns: source.clock for source in sources.timed}.values():
        counts = clock.unit or ("date and time" if clock.since_1970 else "time of day")
        unit = counts if clock.sure else f"{counts}, assumed"
        times = (f"{time_s:.3f}" for time_s in clock.time_s[:SHOWN_ROWS])
        found.append(("time", " ".join(clock.columns), unit, *times))
    for channel, parts in placed.items():
        part = parts[0]
        to = unit_of_channel(channel, kinds[channel])
        unit = shown_unit(part.unit) or "–"
        units = unit if unit == shown_unit(part.to) else f"{unit} → {shown_unit(to)}"
        cells = part.column.values[:SHOWN_ROWS]
        cells = cells.to_pylist() if part.column.is_text else cells.tolist()
        found.append((channel, full_name(part.column), units, *("" if c is None else str(c) for c in cells)))
    return found


def table_of(how: Logs) -> str:
    """A `[log]` table as TOML, without unset keys."""
    given: dict[str, Any] = how.model_dump(exclude_unset=True, exclude_none=True, exclude={"columns"})
    lines = ["[log]", *(f"{key} = {_toml(value)}" for key, value in given.items())]
    if how.columns:
        lines.append("[log.columns]")
        lines += [f"{_key(name)} = {column_of(entry)}" for name, entry in how.columns.items()]
    return "\n".join(lines)


def column_of(entry: LogColumn) -> str:
    """An entry of `[log.columns]` as TOML."""
    if entry.unit is None:
        return _toml(entry.column)
    return f"{{ column = {_toml(entry.column)}, unit = {_toml(entry.unit)} }}"


def _key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else _toml(name)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)
