"""Matches columns to channels, by name, unit and plausible values, with the doubts about it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import SequenceMatcher

import numpy as np
from scipy.optimize import linear_sum_assignment

from observer.align.plausibility import TEMPERATURES, ChannelKind, Limits
from observer.align.unit_errors import likely_unit
from observer.config import Config
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
from observer.tables.logs import LogColumn, Logs

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
    """A column of numbers that may be a channel's."""

    name: str
    column: RawColumn
    values: FloatArray


@dataclass(frozen=True, slots=True)
class Guess:
    """`[log.columns]` as found, the doubts by channel, channels without any column, and errors."""

    columns: dict[str, LogColumn]
    doubts: dict[str, str]
    missing: tuple[str, ...]
    problems: tuple[str, ...] = ()


def guessed(sources: Sources, config: Config, how: Logs) -> Guess:
    """Find the column of each channel that is neither given nor obvious. Raises no error."""
    problems = list[str]()
    placed, missing = placed_columns(sources, config, how, problems)
    taken = {full_name(p.column) for parts in placed.values() for p in parts}
    spare = [c for s in sources.timed for c in columns_of_numbers(s) if c.name not in taken]
    spare = list({c.name: c for c in spare}.values())
    wanted = [name for name in config.channels if name in missing and name not in how.columns]
    limits, columns, doubts = Limits.of(config), dict(how.columns), dict[str, str]()
    for channel, parts in placed.items():
        given = how.columns.get(channel)
        own = [c for c in columns_of_numbers(parts[0].source) if c.column is parts[0].column]
        if own and (given is None or given.unit is None):
            _with_unit(limits, config, channel, own[0], columns, doubts)
    scores = np.array([[_score(limits, config, channel, c) for c in spare] for channel in wanted])
    scores = scores.reshape(len(wanted), len(spare))
    unit_fits = np.array([[_says_unit(c, config, limits, name) for c in spare] for name in wanted])
    unit_fits = unit_fits.reshape(scores.shape)
    found = dict(zip(*(each.tolist() for each in linear_sum_assignment(-scores)), strict=True))
    lost = [name for i, name in enumerate(wanted) if i not in found or scores[i, found[i]] <= 0.0]
    for i, j in found.items():
        channel, best = wanted[i], scores[i, j]
        if best <= 0.0:
            continue
        columns[channel] = LogColumn(column=spare[j].name)
        rivals = [spare[k].name for k in range(len(spare)) if k != j and scores[i, k] > best - APART]
        alone = unit_fits[i, j] and unit_fits[i].sum() == 1 and unit_fits[:, j].sum() == 1
        if best < SURE and not alone:
            doubts[channel] = f'is "{spare[j].name}" {channel}? its name does not say so'
        elif rivals and not alone:
            doubts[channel] = f'is "{spare[j].name}" {channel}, or is it "{rivals[0]}"?'
        _with_unit(limits, config, channel, spare[j], columns, doubts)
    _alike_in_unit(limits, config, {c.name: c for c in spare}, columns, doubts)
    lost += [name for name in how.columns if f"{name} = {how.columns[name].column}" in missing]
    return Guess(columns, doubts, tuple(lost), tuple(problems))


def columns_of_numbers(source: TimedSheet) -> list[ColumnValues]:
    """The columns of numbers of a sheet, except its clock's."""
    found = []
    for column in source.sheet.columns:
        name = full_name(column)
        if name in source.clock.columns or column.is_moments:
            continue
        values, words = numbers_of(column, source.sheet.decimal)
        if 2 * int(np.isfinite(values).sum()) > words.cells:
            found.append(ColumnValues(name, column, values))
    return found


def _says_unit(found: ColumnValues, config: Config, limits: Limits, channel: str) -> bool:
    """Whether the file gives a unit for a column that suits the channel."""
    to = unit_of_channel(channel, limits.kinds[config.channels.index(channel)])
    named = found.column.unit or split_name(found.name)[1]
    return bool(named and to) and fits(_unit_or(found.column, to), resolved(to))


def _unit_or(column: RawColumn, to: str) -> str:
    """The unit of a column, that of its channel where the file gives none that is understood.

    The error about a unit that is not understood comes where the column is read.
    """
    try:
        return unit_of_column(column, to)
    except LogError:
        return to


def _score(limits: Limits, config: Config, channel: str, found: ColumnValues) -> float:
    """The score for a column being a channel's, by its name, unit and values; 0 for no evidence."""
    j = config.channels.index(channel)
    kind, to = limits.kinds[j], unit_of_channel(channel, limits.kinds[j])
    unit = _unit_or(found.column, to)
    if not fits(unit, resolved(to) if to else ""):
        return 0.0
    stem, own = last_part(split_name(last_part(found.name))[0]), split_name(channel)[0]
    alike = SequenceMatcher(None, plain_name(stem), plain_name(own)).ratio()
    if (theirs := re.findall(r"\d+", stem)) and (ours := re.findall(r"\d+", own)):
        alike = max(alike, 0.6) if [int(n) for n in theirs] == [int(n) for n in ours] else min(alike, 0.3)
    said = bool(re.search(_WORDS[kind], stem.casefold()))
    others = any(re.search(words, stem.casefold()) for other, words in _WORDS.items() if other is not kind)
    named = found.column.unit or split_name(found.name)[1]
    if plain_name(stem) == plain_name(own):
        return 1.0
    score = 0.5 * alike + 0.4 * said - 0.2 * (others and not said) + 0.3 * bool(named)
    values = converted(found.values, unit, resolved(to) if to else "")
    return max(score if named or _plausible(limits, j, values) else score - 0.3, 0.0)


def _plausible(limits: Limits, j: int, values: FloatArray) -> bool:
    """Whether values (n,) are plausible for a channel, in its unit or in one mistaken for it."""
    there = values[np.isfinite(values)]
    beyond = [np.asarray(each) for _, each in limits.beyond(j, there, np.nan)]
    within = not len(there) or not np.any(beyond, axis=0).mean() > 0.05
    return within or likely_unit(limits, j, values, np.nan) is not None


def _with_unit(
    limits: Limits,
    config: Config,
    channel: str,
    found: ColumnValues,
    columns: dict[str, LogColumn],
    doubts: dict[str, str],
) -> None:
    """Add the unit that the values suggest where the file gives none; report where it gives another."""
    j = config.channels.index(channel)
    to = unit_of_channel(channel, limits.kinds[j])
    own = resolved(to) if to else ""
    unit = _unit_or(found.column, to)
    likely = likely_unit(limits, j, converted(found.values, resolved(unit) if unit else "", own), np.nan)
    if likely is None:
        return
    there = found.values[np.isfinite(found.values)]
    shown = f"{np.median(there):.4g}" if len(there) else ""
    doubts[channel] = (
        f'"{found.name}" looks like {likely[0]}, not {shown_unit(unit)}: it says {shown} in the middle'
    )
    if meant := known_unit(likely[0]):
        columns[channel] = LogColumn(column=found.name, unit=meant)


def _alike_in_unit(
    limits: Limits,
    config: Config,
    spare: Mapping[str, ColumnValues],
    columns: dict[str, LogColumn],
    doubts: dict[str, str],
) -> None:
    """Suspect °F for every temperature without a unit in the file, where one of them is clearly in °F."""
    warm = [
        channel
        for channel, entry in columns.items()
        if limits.kinds[config.channels.index(channel)] in TEMPERATURES and entry.column in spare
    ]
    if not any(columns[channel].unit == "degF" and channel in doubts for channel in warm):
        return
    for channel in warm:
        found = spare[columns[channel].column]
        if columns[channel].unit is None and not (found.column.unit or split_name(found.name)[1]):
            columns[channel] = LogColumn(column=found.name, unit="degF")
            doubts[channel] = f'"{found.name}" may be in °F, as another temperature of this file looks'
