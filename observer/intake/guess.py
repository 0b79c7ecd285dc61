"""Matches columns to channels by name, unit and plausible values, with the doubts about each match."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import SequenceMatcher

import numpy as np
from scipy.optimize import linear_sum_assignment

from observer.align.plausibility import TEMPERATURES, ChannelKind, Limits
from observer.align.unit_errors import likely_unit
from observer.config.logs import LogColumn, Logs
from observer.config.machine import Config
from observer.errors import LogError
from observer.frames import FloatArray
from observer.intake.cells import numbers_of
from observer.intake.mapped import last_part, placed_columns, plain_name, unit_of_column
from observer.intake.sheets import RawColumn, full_name
from observer.intake.sources import Sources, TimedSheet
from observer.intake.units import (
    converted,
    fits,
    known_unit,
    resolved,
    shown_unit,
    split_name,
    unit_of_channel,
)

SURE, APART = 0.75, 0.15
"""The smallest score of a match without doubt, and its lead over the next best column."""
_WORDS = {
    ChannelKind.SCREW: r"temp|lager|bearing|mutter|nut|spindel|screw|tc|pt100|therm",
    ChannelKind.NODE: r"temp|housing|gehäuse|flansch|flange|motor",
    ChannelKind.END: r"temp|end|lager|bearing|motor",
    ChannelKind.AMBIENT: r"amb|air|luft|halle|raum|room|umgeb|hall",
    ChannelKind.COOLANT: r"cool|kühl|chill|inlet|vorlauf",
    ChannelKind.POSITION: r"^[xyzuvw]\d?$|pos|weg|lage|^act",
    ChannelKind.SPEED: r"speed|drehzahl|rpm|^n$|^s\d?$|spindle|rev|u/min",
    ChannelKind.OTHER: r"power|leistung|heat|^p\d?$",
}


@dataclass(frozen=True, slots=True, eq=False)
class ColumnValues:
    """A column of numbers that may be a channel's.

    Attributes:
        name: Its name with the unit that the file has.
        column: The raw column.
        values: Its numbers (n,) in its own unit, NaN where a cell is not a number.
    """

    name: str
    column: RawColumn
    values: FloatArray


@dataclass(frozen=True, slots=True)
class Guess:
    """A guessed assignment of columns to channels.

    Attributes:
        columns: The guessed `[log.columns]`, those configured included.
        doubts: A question by channel, for a match that is not sure.
        missing: The channels without a column.
        problems: Errors, a sentence each.
    """

    columns: dict[str, LogColumn]
    doubts: dict[str, str]
    missing: tuple[str, ...]
    problems: tuple[str, ...] = ()


def guessed(sources: Sources, config: Config, options: Logs) -> Guess:
    """Return the column of each channel, also of those neither configured nor obvious.

    Each pair of channel and spare column gets a score by name, unit and plausible values. The assignment with
    the largest sum of scores wins (Hungarian algorithm, `scipy.optimize.linear_sum_assignment`).

    Args:
        sources: The sheets with their clocks.
        config: The machine whose channels are needed.
        options: The `[log]` table; its columns are taken as they are.

    Returns:
        The assignment. Errors are in `problems`; none is raised.
    """
    problems = list[str]()
    placed, missing = placed_columns(sources, config, options, problems)
    used_names = {full_name(p.column) for parts in placed.values() for p in parts}
    spare = [c for s in sources.timed for c in columns_of_numbers(s) if c.name not in used_names]
    spare = list({c.name: c for c in spare}.values())
    unplaced = [name for name in config.channels if name in missing and name not in options.columns]
    limits, columns, doubts = Limits.of(config), dict(options.columns), dict[str, str]()
    for channel, parts in placed.items():
        configured = options.columns.get(channel)
        candidates = [c for c in columns_of_numbers(parts[0].source) if c.column is parts[0].column]
        if candidates and (configured is None or configured.unit is None):
            _with_unit(limits, config, channel, candidates[0], columns, doubts)
    scores = np.array([[_score(limits, config, channel, c) for c in spare] for channel in unplaced])
    scores = scores.reshape(len(unplaced), len(spare))
    unit_fits = np.array([[_says_unit(c, config, limits, name) for c in spare] for name in unplaced])
    unit_fits = unit_fits.reshape(scores.shape)
    assignment = dict(zip(*(indices.tolist() for indices in linear_sum_assignment(-scores)), strict=True))
    unmatched = [
        name for i, name in enumerate(unplaced) if i not in assignment or scores[i, assignment[i]] <= 0.0
    ]
    for i, j in assignment.items():
        channel, best = unplaced[i], scores[i, j]
        if best <= 0.0:
            continue
        columns[channel] = LogColumn(column=spare[j].name)
        rivals = [spare[k].name for k in range(len(spare)) if k != j and scores[i, k] > best - APART]
        is_only_match = unit_fits[i, j] and unit_fits[i].sum() == 1 and unit_fits[:, j].sum() == 1
        if best < SURE and not is_only_match:
            doubts[channel] = f'is "{spare[j].name}" {channel}? its name does not say so'
        elif rivals and not is_only_match:
            doubts[channel] = f'is "{spare[j].name}" {channel}, or is it "{rivals[0]}"?'
        _with_unit(limits, config, channel, spare[j], columns, doubts)
    _alike_in_unit(limits, config, {c.name: c for c in spare}, columns, doubts)
    unmatched += [name for name in options.columns if f"{name} = {options.columns[name].column}" in missing]
    return Guess(columns, doubts, tuple(unmatched), tuple(problems))


def columns_of_numbers(source: TimedSheet) -> list[ColumnValues]:
    """Return the columns of numbers of a sheet, without those of its clock and those with mostly words."""
    columns = []
    for column in source.sheet.columns:
        name = full_name(column)
        if name in source.clock.columns or column.is_moments:
            continue
        values, words = numbers_of(column, source.sheet.decimal)
        if 2 * int(np.isfinite(values).sum()) > words.cells:
            columns.append(ColumnValues(name, column, values))
    return columns


def _says_unit(candidate: ColumnValues, config: Config, limits: Limits, channel: str) -> bool:
    """Whether the file gives the column a unit that suits the channel."""
    to = unit_of_channel(channel, limits.kinds[config.channels.index(channel)])
    named = candidate.column.unit or split_name(candidate.name)[1]
    return bool(named and to) and fits(_unit_or(candidate.column, to), resolved(to))


def _unit_or(column: RawColumn, to: str) -> str:
    """Return the unit of a column; the channel's unit `to` if the file gives none that is understood.

    An unknown unit is reported where the column is read.
    """
    try:
        return unit_of_column(column, to)
    except LogError:
        return to


def _score(limits: Limits, config: Config, channel: str, candidate: ColumnValues) -> float:
    """Return the score, 0 … 1, for a column being a channel's, by its name, unit and values."""
    j = config.channels.index(channel)
    kind, to = limits.kinds[j], unit_of_channel(channel, limits.kinds[j])
    unit = _unit_or(candidate.column, to)
    if not fits(unit, resolved(to) if to else ""):
        return 0.0
    stem, channel_stem = last_part(split_name(last_part(candidate.name))[0]), split_name(channel)[0]
    similarity = SequenceMatcher(None, plain_name(stem), plain_name(channel_stem)).ratio()
    if (column_digits := re.findall(r"\d+", stem)) and (channel_digits := re.findall(r"\d+", channel_stem)):
        similarity = (
            max(similarity, 0.6)
            if [int(n) for n in column_digits] == [int(n) for n in channel_digits]
            else min(similarity, 0.3)
        )
    word_matches = bool(re.search(_WORDS[kind], stem.casefold()))
    other_word_matches = any(
        re.search(words, stem.casefold()) for other_kind, words in _WORDS.items() if other_kind is not kind
    )
    named = candidate.column.unit or split_name(candidate.name)[1]
    if plain_name(stem) == plain_name(channel_stem):
        return 1.0
    score = (
        0.5 * similarity
        + 0.4 * word_matches
        - 0.2 * (other_word_matches and not word_matches)
        + 0.3 * bool(named)
    )
    values = converted(candidate.values, unit, resolved(to) if to else "")
    return max(score if named or _plausible(limits, j, values) else score - 0.3, 0.0)


def _plausible(limits: Limits, j: int, values: FloatArray) -> bool:
    """Whether values (n,) are plausible for channel number j, in its unit or in one mistaken for it."""
    finite = values[np.isfinite(values)]
    breaches = [np.asarray(is_beyond) for _, is_beyond in limits.breaches(j, finite, np.nan)]
    is_plausible = not len(finite) or not np.any(breaches, axis=0).mean() > 0.05
    return is_plausible or likely_unit(limits, j, values, np.nan) is not None


def _with_unit(
    limits: Limits,
    config: Config,
    channel: str,
    candidate: ColumnValues,
    columns: dict[str, LogColumn],
    doubts: dict[str, str],
) -> None:
    """Add the unit that the values suggest to `columns`, and a doubt about it."""
    j = config.channels.index(channel)
    to = unit_of_channel(channel, limits.kinds[j])
    channel_unit = resolved(to) if to else ""
    unit = _unit_or(candidate.column, to)
    likely = likely_unit(
        limits, j, converted(candidate.values, resolved(unit) if unit else "", channel_unit), np.nan
    )
    if likely is None:
        return
    finite = candidate.values[np.isfinite(candidate.values)]
    shown = f"{np.median(finite):.4g}" if len(finite) else ""
    doubts[channel] = (
        f'"{candidate.name}" looks like {likely.in_words}, not {shown_unit(unit)}: its median is {shown}'
    )
    if meant := known_unit(likely.in_words):
        columns[channel] = LogColumn(column=candidate.name, unit=meant)


def _alike_in_unit(
    limits: Limits,
    config: Config,
    spare: Mapping[str, ColumnValues],
    columns: dict[str, LogColumn],
    doubts: dict[str, str],
) -> None:
    """Suspect °F for every temperature without a unit in the file, if one of them is clearly in °F."""
    warm = [
        channel
        for channel, entry in columns.items()
        if limits.kinds[config.channels.index(channel)] in TEMPERATURES and entry.column in spare
    ]
    if not any(columns[channel].unit == "degF" and channel in doubts for channel in warm):
        return
    for channel in warm:
        candidate = spare[columns[channel].column]
        if columns[channel].unit is None and not (candidate.column.unit or split_name(candidate.name)[1]):
            columns[channel] = LogColumn(column=candidate.name, unit="degF")
            doubts[channel] = f'"{candidate.name}" may be in °F, as another temperature of this file looks'
