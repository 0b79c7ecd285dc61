"""The proposal of `observer import`: the `[log]` table that makes files a log, and its doubts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from observer.align.plausibility import kinds_of
from observer.config.logs import LogColumn, Logs
from observer.config.machine import Config
from observer.errors import LogError
from observer.files.log_checks import several
from observer.files.logs import Log
from observer.files.writer import write_log
from observer.intake.guess import Guess, columns_of_numbers, guessed
from observer.intake.mapped import Placed, logged, mapped, misunderstood, no_clock, placed_columns
from observer.intake.sheets import full_name
from observer.intake.sources import Sources, sources_of
from observer.intake.units import shown_unit, unit_of_channel

SHOWN_ROWS = 4
MOST_APART_S = 20.0
"""If numbers without a unit are further apart, they may be milliseconds or minutes."""


@dataclass(frozen=True, slots=True, eq=False)
class ImportedLog:
    """A log of files from other recorders.

    Compare `log` with `shown` before you use it while `asked` has any doubts.

    Attributes:
        log: The log with the configuration's channels, in their units.
        options: The `[log]` table with guessed keys, which reads such files directly.
        asked: Doubts about guesses: sentences by the key of `[log]` that settles them.
        shown: Rows to display: name, column, unit and first cells of each clock and channel.
        zoneless: Whether times are wall-clock times without a zone.
    """

    log: Log
    options: Logs
    asked: dict[str, str]
    shown: tuple[tuple[str, ...], ...]
    zoneless: bool

    @property
    def doubts(self) -> tuple[str, ...]:
        """The doubts to report to every reader of the log: about the files, missing values, and confirmed
        guesses.

        They are written into the log, so that a later replay repeats them.
        """
        confirmed = (f"{key}: {doubt}; confirmed at the import" for key, doubt in self.asked.items())
        words = (words.text for words in self.log.words)
        return tuple(dict.fromkeys((*self.log.doubts, *words, *confirmed)))

    @property
    def table(self) -> str:
        """The `[log]` table that reads such files, as TOML, to be put into the configuration."""
        return table_of(self.options)

    def write(self, path: str | Path, *, agreed: bool = False) -> None:
        """Write the log as CSV or Parquet, by the suffix.

        Args:
            path: The file; an existing one is replaced.
            agreed: Write in spite of doubts in `asked`, which the log then states.

        Raises:
            LogError: Something is doubtful and not `agreed`, or the file cannot be written.
        """
        if self.asked and not agreed:
            doubts = [f"  {key}: {doubt}" for key, doubt in self.asked.items()]
            first = f"{path}: not written, because this is doubtful; clarify it in the configuration:"
            raise LogError("\n".join([first, *doubts, "the guess was", self.table]))
        columns = {name: self.log[name] for name in self.log.channels}
        write_log(Path(path), self.log.time_s, columns, self.doubts)


def proposed(paths: Sequence[Path], config: Config, options: Logs) -> ImportedLog:
    """Read files by configured and guessed keys.

    Args:
        paths: Files of one run.
        config: The machine whose channels are needed.
        options: Its `[log]` table, or one with options of a command.

    Raises:
        LogError: A file cannot be read, or clock, columns or units cannot be guessed; all problems in one
            error.
    """
    sources = sources_of(paths, options)
    name = " + ".join(map(str, paths))
    if not sources.timed:
        raise several(name, list(sources.problems) or [no_clock(sources, options)])
    guess = guessed(sources, config, options)
    completed = options.model_copy(update={"columns": guess.columns, "long": options.long or sources.long})
    if guess.missing or guess.problems:
        problems = [*sources.problems, *guess.problems]
        raise several(
            name,
            [*problems, *(_missing_column(channel, sources, guess, options) for channel in guess.missing)],
        )
    log = mapped(sources, paths, config, completed)
    questions = {f"[log.columns] {channel}": doubt for channel, doubt in guess.doubts.items()}
    questions |= _clock_doubts(sources, options)
    zoneless = any(s.clock.on_wall for s in sources.timed)
    return ImportedLog(log, completed, questions, tuple(_rows(sources, config, completed)), zoneless)


def _missing_column(channel: str, sources: Sources, guess: Guess, options: Logs) -> str:
    """Return the sentence for a channel without a column: a wrong configured name, and the unused columns."""
    used_columns = {entry.column for entry in guess.columns.values()}
    clocks = {name for source in sources.timed for name in source.clock.columns}
    names = dict.fromkeys(full_name(c) for s in sources.timed for c in s.sheet.columns)
    spare = [f'"{name}"' for name in names if name not in used_columns and name not in clocks]
    named = f'there is no column "{options.columns[channel].column}"; ' if channel in options.columns else ""
    choice = f", one of {', '.join(spare[:12])}" if spare else "; no column is left for it, add it to the log"
    return f'{named}name its column with [log.columns] {channel} = "…"{choice}'


def read_whole(path: Path, *, accept_truncated: bool = False) -> Log:
    """Read a file from another recorder: every column of numbers, with its name and unit in the file.

    Args:
        path: The file.
        accept_truncated: Drop a last row that was cut off, instead of refusing the file.

    Raises:
        LogError: All problems in one error, among them doubts about the clock, which only a `[log]` settles.
    """
    options = Logs()
    sources = sources_of([path], options, accept_truncated=accept_truncated)
    if not sources.timed:
        raise several(path, list(sources.problems) or [no_clock(sources, options)])
    questions = [f"{key}: {doubt}" for key, doubt in _clock_doubts(sources, options).items()]
    if questions:
        questions.append("say it in the configuration of a machine, which then reads the file itself")
    placed = dict[str, list[Placed]]()
    for source in sources.timed:
        for candidate in columns_of_numbers(source):
            placed.setdefault(candidate.name, []).append(
                Placed(candidate.name, source, candidate.column, "", "")
            )
    columns = [part.column for parts in placed.values() for part in parts]
    doubts = [*sources.doubts, *misunderstood(columns)]
    return logged([path], placed, options, {}, [*sources.problems, *questions], doubts)


def _clock_doubts(sources: Sources, options: Logs) -> dict[str, str]:
    """Return the doubts about the clocks, by the key that settles them."""
    questions = dict[str, str]()
    for source in sources.timed:
        clock = source.clock
        apart_s = float(np.median(np.diff(clock.time_s))) if len(clock.time_s) > 1 else 0.0
        if not clock.sure and options.time_format is None and apart_s > MOST_APART_S:
            questions["[log] time_format"] = (
                f'{clock.columns[0]} has no unit and its rows are {apart_s:.4g} apart: "s", "ms", "min"?'
            )
        for doubt in clock.doubts:
            questions["[log] timezone" if "timezone" in doubt else "[log] time_format"] = doubt
    walls = {s.clock.on_wall for s in sources.timed if s.clock.since_1970}
    if len(walls) > 1:
        questions["[log] timezone"] = "some clocks have a zone and others do not; give the zone of these"
    return questions


def _rows(sources: Sources, config: Config, options: Logs) -> list[tuple[str, ...]]:
    """Return rows for display, one for each clock and channel.

    A clock has its columns, its unit, and its first times in s. A channel has its column, the units in the
    file and of the channel, and the first cells of the file.
    """
    placed, _ = placed_columns(sources, config, options, [])
    kinds, rows = kinds_of(config), list[tuple[str, ...]]()
    for clock in {source.clock.columns: source.clock for source in sources.timed}.values():
        counts = clock.unit or ("date and time" if clock.since_1970 else "time of day")
        unit = counts if clock.sure else f"{counts}, assumed"
        times = (f"{time_s:.3f}" for time_s in clock.time_s[:SHOWN_ROWS])
        rows.append(("time", " ".join(clock.columns), unit, *times))
    for channel, parts in placed.items():
        part = parts[0]
        to = unit_of_channel(channel, kinds[channel])
        unit = shown_unit(part.unit) or "–"
        units = unit if unit == shown_unit(part.to) else f"{unit} → {shown_unit(to)}"
        cells = part.column.values[:SHOWN_ROWS]
        cells = cells.to_pylist() if part.column.is_text else cells.tolist()
        rows.append((channel, full_name(part.column), units, *("" if c is None else str(c) for c in cells)))
    return rows


def table_of(options: Logs) -> str:
    """Return a `[log]` table as TOML, with `[log.columns]` below it and without unset keys."""
    set_keys: dict[str, Any] = options.model_dump(exclude_unset=True, exclude_none=True, exclude={"columns"})
    lines = ["[log]", *(f"{key} = {_toml(value)}" for key, value in set_keys.items())]
    if options.columns:
        lines.append("[log.columns]")
        lines += [f"{_key(name)} = {column_of(entry)}" for name, entry in options.columns.items()]
    return "\n".join(lines)


def column_of(entry: LogColumn) -> str:
    """Return an entry of `[log.columns]` as TOML: a name, or a table with the name and its unit."""
    if entry.unit is None:
        return _toml(entry.column)
    return f"{{ column = {_toml(entry.column)}, unit = {_toml(entry.unit)} }}"


def _key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else _toml(name)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(entry)}" for key, entry in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)
