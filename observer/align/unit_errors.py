"""Logs in which a channel is in another unit than the configured one, converted to that unit.

A channel is converted only if its values leave no doubt. In the configured unit they are beyond the limits of
such a machine, and in another unit all of them are within.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.align.aligner import AlignPlan, frames_of_log
from observer.align.plausibility import (
    ChannelKind,
    Limits,
    ambient_of_log_degC,
    cells_of,
    stroke_of_m,
    units_of,
    warm_enough,
    way_ratio,
)
from observer.config.machine import Config
from observer.files.logs import Log
from observer.frames import FloatArray, NutPath
from observer.units import BY_NAME, Unit, others_of

MOSTLY, SOMETIMES, ALL = 0.5, 0.05, 0.99
"""Fractions of a channel's values: beyond its limits (a speed is 0 at rest), and within them once converted.
"""
FIRST = 5
"""How many values count as a temperature's beginning."""
OFF_STROKE = 0.1
"""How far beyond a stroke a nut may go, as a part of it."""
LIKE = 0.25
"""Relative tolerance between a nut's path and its speed in a unit."""


class Misread(NamedTuple):
    """A channel that was converted.

    Attributes:
        channel: The channel.
        unit: Its unit in the log, in words.
        expected: Its configured unit.
    """

    channel: str
    unit: str
    expected: str

    @property
    def text(self) -> str:
        """A sentence without full stop: the wrong unit, the conversion, and the remedy."""
        return (
            f"{self.channel} is in {self.unit} where {self.expected} is expected; it was converted for this "
            f"search, so log it in {self.expected} before the configuration is used"
        )


def in_configured_units(
    log: Log, config: Config, paths: Sequence[Mapping[str, NutPath]] | None = None
) -> tuple[Log, tuple[Misread, ...]]:
    """Return a log with every channel in its configured unit, and the channels that had to be converted.

    Args:
        log: The log; it is not changed.
        config: The configuration.
        paths: The nuts' paths in the frames of the unconverted log; None if they are not known.
    """
    misread = []
    limits = Limits.of(config)
    order = sorted(range(len(config.channels)), key=lambda j: j != limits.ambient)
    for j in order:
        name = config.channels[j]
        if name not in log.channels:
            continue
        column = log.values[:, log.channels.index(name)]
        air_degC = ambient_of_log_degC(config, log.values, log.channels)
        warm = warm_enough(limits, j, cells_of(config, log.values, log.channels), air_degC)
        likely = None if warm.any() else likely_unit(limits, j, column, air_degC)
        if likely is not None:
            log = _with(log, name, likely.to_base(column))
            misread.append(Misread(name, likely.in_words, BY_NAME[likely.base].shown))
    if misread or paths is None:
        paths = [block.path for block in frames_of_log(log, AlignPlan.of(config))]
    for channel, unit, factor in _speeds_in_other_units(config, paths):
        log = _with(log, channel, log.values[:, log.channels.index(channel)] * factor)
        misread.append(Misread(channel, unit, "rpm"))
    return log, tuple(misread)


_BEGIN_ANYWHERE = (ChannelKind.POSITION, ChannelKind.SPEED, ChannelKind.OTHER)


def likely_unit(limits: Limits, j: int, column: FloatArray, air_degC: float) -> Unit | None:
    """Return the unit in which a channel's values are plausible; None if they leave a doubt.

    Args:
        limits: The limits of all channels.
        j: The channel's number.
        column: Its values, NaN where missing, (n,).
        air_degC: The air's temperature.
    """
    values = column[np.isfinite(column)]
    if len(values) == 0 or np.ptp(values) == 0.0:  # nothing, or a device's code for a fault
        return None
    smallest_share = SOMETIMES if limits.kinds[j] is ChannelKind.SPEED else MOSTLY
    if _share_beyond(limits, j, values, air_degC) < smallest_share:
        return None
    if limits.kinds[j] not in _BEGIN_ANYWHERE and _share_beyond(limits, j, values[:FIRST], air_degC) < ALL:
        return None  # it became so hot; in another unit it would have been from the first row on
    for unit in units_of(limits.kinds[j]):
        converted = unit.to_base(values)
        if _share_beyond(limits, j, converted, air_degC) <= 1.0 - ALL and _usual(limits, j, converted):
            return unit
    return None


def _usual(limits: Limits, j: int, values: FloatArray) -> bool:
    """Whether positions (n,) lie on the stroke and cover some of it; True for any other quantity."""
    if limits.kinds[j] is not ChannelKind.POSITION:
        return True
    low, high = limits.usual[j]
    extremes = np.quantile(values, [1.0 - ALL, ALL])
    slack = OFF_STROKE * (high - low)
    return bool(low - slack <= extremes[0] and extremes[1] <= high + slack and np.ptp(extremes) > slack)


def _share_beyond(limits: Limits, j: int, values: FloatArray, air_degC: float) -> float:
    """Return the fraction of values (n,) that violate one of the limits."""
    breaches = [np.asarray(is_beyond) for _, is_beyond in limits.breaches(j, values, air_degC)]
    return float(np.mean(np.any(breaches, axis=0)))


def _speeds_in_other_units(
    config: Config, paths: Sequence[Mapping[str, NutPath]]
) -> Iterator[tuple[str, str, float]]:
    """Yield speeds that the nut's path shows to be in another unit: channel, unit, and factor to rpm."""
    reported = set[str]()
    for source in config.source:
        if not (source.position_channel and source.speed_channel):
            continue
        channel = str(source.speed_channel)
        ratio = way_ratio(
            [part[str(source.position_channel)] for part in paths], stroke_of_m(config, source.stroke_m)
        )
        for unit in others_of("rpm"):
            if ratio is not None and abs(ratio / unit.size - 1.0) < LIKE and channel not in reported:
                reported.add(channel)
                yield channel, unit.in_words, unit.size


def _with(log: Log, channel: str, column: FloatArray) -> Log:
    values = log.values.copy()
    values[:, log.channels.index(channel)] = column
    return replace(log, values=values)
