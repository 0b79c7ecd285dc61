"""From sheets to a log: each channel's column, in the channel's unit, on one clock; all problems at once."""

from __future__ import annotations

import difflib
import itertools
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from observer.align.plausibility import ChannelKind, kinds_of
from observer.config.logs import TIME_UNITS, LogColumn, Logs
from observer.config.machine import Config
from observer.errors import LogError
from observer.files.log_checks import Words, refuse_other_units, several
from observer.files.logs import Log
from observer.frames import FloatArray
from observer.intake.cells import numbers_of
from observer.intake.clock import is_called_time
from observer.intake.join import ChannelSamples, joined, with_steps
from observer.intake.sentinels import without_sentinels
from observer.intake.sheets import RawColumn, Sheet, full_name
from observer.intake.sources import Sources, TimedSheet, sources_of
from observer.intake.units import (
    converted,
    fits,
    known_unit,
    resolved,
    shown_unit,
    split_name,
    unit_of_channel,
)

MOST_WORDS = 0.5
"""Fraction of a column's cells that may be words; with more it is not a column of numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A channel's column in a sheet.

    Attributes:
        channel: Name of the channel.
        source: The sheet with its clock.
        column: The column in it.
        unit: Its unit, as `resolved` gives it; empty if unknown.
        to: The channel's unit, as `resolved` gives it; empty for a channel without one.
    """

    channel: str
    source: TimedSheet
    column: RawColumn
    unit: str
    to: str


def read_foreign(
    paths: Sequence[Path], config: Config, *, spare: Collection[str] = (), accept_truncated: bool = False
) -> Log:
    """Read files from other recorders, by `[log]` and obvious names.

    Args:
        paths: Files of one run.
        config: The machine with its channels and `[log]`.
        spare: Channels that may be missing.
        accept_truncated: Drop a last row that was cut off, instead of refusing the file.

    Raises:
        LogError: All problems in one error: unreadable files, missing columns, units, cells that are not
            numbers.
    """
    options = config.log
    return mapped(
        sources_of(paths, options, accept_truncated=accept_truncated), paths, config, options, spare
    )


def mapped(
    sources: Sources, paths: Sequence[Path], config: Config, options: Logs, spare: Collection[str] = ()
) -> Log:
    """Return the log of the sheets by the columns of `options`.

    Args:
        sources: The sheets with their clocks, and the problems found so far.
        paths: The files they come from, named in errors.
        config: The machine with its channels.
        options: The `[log]` table.
        spare: Channels that may be missing.

    Raises:
        LogError: All problems in one error, those of `sources` included.
    """
    name = " + ".join(map(str, paths))
    problems, doubts = list(sources.problems), list(sources.doubts)
    if not sources.timed:
        raise several(name, problems or [no_clock(sources, options)])
    placed, missing = placed_columns(sources, config, options, problems)
    if missing := [name for name in missing if name not in spare]:
        problems.append(_without(missing, sources))
    return logged(paths, placed, options, kinds_of(config), problems, doubts)


def logged(
    paths: Sequence[Path],
    placed: Mapping[str, Sequence[Placed]],
    options: Logs,
    kinds: Mapping[str, ChannelKind],
    problems: list[str],
    doubts: list[str],
) -> Log:
    """Return the log of placed columns.

    Args:
        paths: The files, named in errors.
        placed: The columns of each channel; several are joined one after another.
        options: The `[log]` table; with `hold`, inputs keep their value until the next row.
        kinds: The kind of each channel; one that is missing has an unknown meaning.
        problems: Errors so far; it is extended.
        doubts: Doubts so far; it is extended.

    Returns:
        Values (K, c) in the channels' units, with NaN for sentinels and words, which are counted in `words`.

    Raises:
        LogError: All problems in one error, also those passed in.
    """
    name = " + ".join(map(str, paths))
    sources = [p.source for parts in placed.values() for p in parts]
    problems += unlike_clocks(sources)
    doubts += [
        f"{clock.columns[0]} has no unit and was taken for seconds"
        for clock in (source.clock for source in sources)
        if not clock.sure
    ]
    samples, words = list[ChannelSamples](), list[Words]()
    for channel, parts in placed.items():
        kind = kinds.get(channel, ChannelKind.OTHER)
        values_of_parts = [_values(p, problems, words, options) for p in parts]
        is_held = parts[0].source.is_held and kind not in (ChannelKind.SCREW, ChannelKind.NODE)
        if len(values_of_parts) == 1:
            samples.append(ChannelSamples(channel, parts[0].source.clock.time_s, values_of_parts[0], is_held))
        else:
            samples.append(_one_after_another(channel, parts, values_of_parts, problems))
    if problems or not samples:
        raise several(name, problems or ["holds no channel of the configuration"])
    time_s, values, of_several = joined(samples)
    if options.hold:
        inputs = [keeps_its_value(kinds.get(s.channel, ChannelKind.OTHER)) for s in samples]
        rows = len(time_s)
        time_s, values = with_steps(time_s, values, np.array(inputs))
        of_several = of_several or len(time_s) > rows
    if not len(time_s):
        raise several(name, ["holds no row with a time; give a log with at least one sample"])
    column = next((c for source in sources for c in source.clock.columns), "the time")
    refuse_other_units(paths[0], column, time_s, options.rows_apart_s)
    channels = tuple(s.channel for s in samples)
    return Log(
        paths[0],
        time_s,
        channels,
        values,
        words=tuple(words),
        doubts=tuple(dict.fromkeys(doubts)),
        joined=of_several,
    )


def keeps_its_value(kind: ChannelKind) -> bool:
    """Return whether a channel of this kind may keep its value until the next row.

    Commanded values may. Temperatures of screw and nodes, and positions, may not: they change between rows.
    """
    return kind not in (ChannelKind.SCREW, ChannelKind.NODE, ChannelKind.POSITION)


def no_clock(sources: Sources, options: Logs) -> str:
    """Return the sentence for files without a known clock: the candidates, and the remedy.

    It distinguishes a wrong `[log] time`, a `time_format` that fits no cell, cells in an unknown form, and no
    candidate at all.
    """
    columns = [c for sheet in sources.without for c in sheet.columns]
    names = ", ".join(f'"{full_name(c)}"' for c in columns[:12])
    if options.time is not None or options.time_format is not None:
        named = (options.time,) if isinstance(options.time, str) else options.time or ()
        chosen = [c for sheet in sources.without for n in named if (c := sheet.named(n)) is not None]
        texts = [c for c in chosen or columns if c.is_text and is_called_time(c.name)] or [
            c for c in chosen or columns if c.is_text
        ]
        shown = f'; "{full_name(texts[0])}" has cells such as "{_first_cell(texts[0])}"' if texts else ""
        if chosen and any(
            known_unit(c.unit or split_name(c.name)[1]) not in ("", *TIME_UNITS) for c in chosen
        ):
            name = full_name(chosen[0])
            return f'[log] time: the unit of "{name}" is none of time; name another of {names}'
        if options.time_format is not None:
            place = f'column "{" and ".join(named)}"' if named else "any column"
            return (
                f'[log] time_format: "{options.time_format}" fits no cell of {place}{shown}; '
                f"there are {names}"
            )
        named_so = " and ".join(named)
        return f'[log] time: no column "{named_so}" with times in a known form{shown}; there are {names}'
    called = [c for c in columns if c.is_text and is_called_time(c.name)]
    if called:
        return (
            f'"{full_name(called[0])}" has cells such as "{_first_cell(called[0])}", which is no known form '
            "of a time; say in [log] time_format how it is written"
        )
    rising = ", ".join(f'"{full_name(c)}"' for s in sources.without for c in rising_columns(s)[:6])
    doubt = f"; {rising} increases steadily, but neither name nor unit says that it is one" if rising else ""
    return (
        f'no column is known to hold the time{doubt}; name it with [log] time = "…" (there are {names}), '
        "or, if the rows are evenly spaced, say how far apart they are with [log] every_s = 60"
    )


def rising_columns(sheet: Sheet) -> list[RawColumn]:
    """Return the columns of numbers that only increase, as candidates for a clock."""
    rising = []
    for column in sheet.columns:
        if column.is_moments:
            continue
        values, words = numbers_of(column, sheet.decimal)
        finite = values[np.isfinite(values)]
        if len(finite) > 2 and words.cells == 0 and bool((np.diff(finite) > 0.0).all()):
            rising.append(column)
    return rising


def _first_cell(column: RawColumn) -> str:
    return next((cell for cell in column.values[:50].to_pylist() if cell), "")[:40]


def placed_columns(
    sources: Sources, config: Config, options: Logs, problems: list[str]
) -> tuple[dict[str, list[Placed]], list[str]]:
    """Return the columns of each channel, and the channels without any.

    Args:
        sources: The sheets with their clocks.
        config: The machine; derived channels need no column.
        options: The `[log]` table.
        problems: A sentence is appended for each unit that is unknown or does not fit its channel.

    Returns:
        Columns by channel, several if it continues from file to file; and the missing channels. One whose
            configured column is missing is given as `channel = column`.
    """
    kinds, placed, missing = kinds_of(config), dict[str, list[Placed]](), list[str]()
    derived = config.derived_channels
    for channel in (c for c in config.channels if c not in derived):
        entry = options.columns.get(channel)
        to = unit_of_channel(channel, kinds[channel])
        parts = [(s, c) for s in sources.timed if (c := _column(s, channel, entry)) is not None]
        if not parts:
            missing.append(channel if entry is None else f"{channel} = {entry.column}")
            continue
        first = parts[0][1]
        same = [(s, c) for s, c in parts if full_name(c) == full_name(first)]
        try:
            chosen = resolved(entry.unit) if entry is not None and entry.unit else ""
            unit = chosen or unit_of_column(first, to)
            channel_unit = resolved(to) if to else ""
            if not fits(unit, channel_unit):
                raise LogError(
                    f'column "{full_name(first)}" is in {shown_unit(unit)}, which cannot be '
                    f"{shown_unit(channel_unit)}; name another in [log.columns] {channel}, or its unit"
                )
        except LogError as error:
            problems.append(f"{channel}: {error}")
            continue
        placed[channel] = [Placed(channel, s, c, unit, channel_unit) for s, c in same]
    return placed, missing


def unit_of_column(column: RawColumn, to: str) -> str:
    """Return the unit of a column by its file; the channel's unit `to` if the file gives none.

    Raises:
        LogError: The unit is not understood; the sentence shows how to give it in `[log.columns]`.
    """
    written = column.unit or split_name(column.name)[1]
    if not written:
        return to
    try:
        return resolved(written) or to
    except LogError:
        raise LogError(
            f'the unit "{written}" of column "{full_name(column)}" is not understood; say it as '
            f'{{ column = "{full_name(column)}", unit = "degC" }} in [log.columns]'
        ) from None


def misunderstood(columns: Iterable[RawColumn]) -> list[str]:
    """Return a sentence for each column whose unit is not understood; its values stay as they are."""
    doubts = []
    for column in columns:
        try:
            unit_of_column(column, "")
        except LogError as error:
            doubts.append(str(error))
    return doubts


def _column(source: TimedSheet, channel: str, entry: LogColumn | None) -> RawColumn | None:
    """Return a channel's column in a sheet, if it is configured or obvious."""
    sheet = source.sheet
    if entry is not None:
        return sheet.named(entry.column)
    if (column := sheet.named(channel)) is not None:
        return column
    stem = plain_name(split_name(channel)[0])
    for stem_of in (lambda name: name, last_part):
        same_named = [c for c in sheet.columns if stem_of(c.name).casefold() == channel.casefold()] or [
            c
            for c in sheet.columns
            if plain_name(split_name(stem_of(c.name))[0]) == stem and (c.unit or split_name(c.name)[1])
        ]
        if len(same_named) == 1:
            return same_named[0]
    return None


def last_part(name: str) -> str:
    """Return a name without a group before it, as in `sensor.t1_degC`, and without a suffix such as
    `_Avg`.
    """
    return re.sub(r"_(?:avg|mean|smp)$", "", re.sub(r"^[A-Za-z]\w*[.:](?=[A-Za-z])", "", name), flags=re.I)


def plain_name(name: str) -> str:
    """Return a name in canonical form: letters and digits in lower case, for comparison."""
    return "".join(c for c in name.casefold() if c.isalnum())


def _without(missing: Sequence[str], sources: Sources) -> str:
    """Return the sentence for channels without an obvious column."""
    spare = [
        full_name(c) for s in sources.timed for c in s.sheet.columns if full_name(c) not in s.clock.columns
    ]
    names = []
    for channel in missing:
        close = difflib.get_close_matches(channel, spare, n=1)
        names.append(f'"{channel}"' + (f' (did you mean "{close[0]}"?)' if close else ""))
    noun, verb = ("column", "is") if len(names) == 1 else ("columns", "are")
    existing = ", ".join(dict.fromkeys(spare[:12])) + (", …" if len(spare) > 12 else "")
    return (
        f"{noun} {', '.join(names)} {verb} missing; name their columns in [log.columns], "
        f"or let `observer import` find them; there are {existing}"
    )


def unlike_clocks(sources: Sequence[TimedSheet]) -> Iterator[str]:
    """Yield the reason why clocks cannot be joined: some count from 1970 and others from their own
    beginning.
    """
    since = {s.clock.since_1970 for s in sources}
    if len(since) > 1:
        sheet = next(s.sheet for s in sources if not s.clock.since_1970)
        yield (
            f"{sheet.path.name}{f' ({sheet.name})' if sheet.name else ''} counts from its own beginning and "
            "the others from 1970, so they cannot be joined; export it with dates"
        )


def _values(placed: Placed, problems: list[str], words: list[Words], options: Logs) -> FloatArray:
    """Return a channel's values (n,) in its unit, NaN for sentinels; problems and words are appended."""
    sheet, column = placed.source.sheet, placed.column
    values, unread = numbers_of(column, sheet.decimal)
    in_rows = unread.cells - len(column.dropped)
    if column.is_moments or in_rows > MOST_WORDS * (in_rows + int(np.isfinite(values).sum())):
        cells = "dates" if column.is_moments else ", ".join(repr(word[:20]) for word in unread.texts[:3])
        row = 0 if column.is_moments else int(np.flatnonzero(~np.isfinite(values))[0])
        problems.append(
            f'{sheet.place(row)}, column "{full_name(column)}": holds {cells} where '
            f"{placed.channel} needs numbers; name another in [log.columns] {placed.channel}"
        )
    if unread.cells:
        words.append(Words(placed.channel, unread.cells, unread.texts))
    written = column.unit or split_name(column.name)[1]
    values, missing = without_sentinels(
        values, placed.channel, placed.unit or known_unit(written), options.missing
    )
    words += missing
    return converted(values, placed.unit, placed.to)


def _one_after_another(
    channel: str, parts: Sequence[Placed], values: Sequence[FloatArray], problems: list[str]
) -> ChannelSamples:
    """Return the samples of a channel that continues from file to file."""
    order = sorted(range(len(parts)), key=lambda i: float(parts[i].source.clock.time_s[0]))
    times = [parts[i].source.clock.time_s for i in order]
    if any(b[0] <= a[-1] for a, b in itertools.pairwise(times)):
        places = ", ".join(dict.fromkeys(p.source.sheet.name or p.source.sheet.path.name for p in parts))
        problems.append(
            f'column "{full_name(parts[0].column)}" for {channel} is in {places} at the same times; name one '
            'with its group before it in [log.columns], as "group/name"'
        )
    is_held = parts[0].source.is_held
    return ChannelSamples(channel, np.concatenate(times), np.concatenate([values[i] for i in order]), is_held)
