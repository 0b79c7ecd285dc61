"""Plausible values: limits by kind of channel, and the likely unit of a value beyond them.

A wrong unit or a device's fault code is a number like any other. The limits here are those of a ball screw in
a machine tool; `[limits]` overrides them for single channels.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from observer.config.machine import Config
from observer.frames import BoolArray, FloatArray, NutPath
from observer.kernels.selftest import DISAGREE, FALLS_SHORT
from observer.kernels.walk import GRADUAL_K, WARMED
from observer.units import Unit, others_of

SCREW_RANGE_DEGC = (-40.0, 150.0)
AMBIENT_RANGE_DEGC = (-20.0, 60.0)
RATE_K_S = 5.0
"""A thermocouple on steel is slower; coolant that splashes on it is not."""
ABOVE_AMBIENT_K, BELOW_AMBIENT_K = 45.0, 25.0
"""From 17 °C on, the same temperature in °F lies further above the air than this, and no screw should."""
BEYOND_ENDS = 0.05
"""Part of the screw's length by which a nut's position may lie beyond an end."""
DN_MM_RPM = 250_000.0
"""Diameter times speed that no ball screw reaches (catalogues end at 220,000)."""


class ChannelKind(Enum):
    """The quantity that a channel measures."""

    SCREW = "temperature of the screw"
    NODE = "temperature of a node"
    END = "temperature of an end"
    AMBIENT = "ambient temperature"
    COOLANT = "temperature of the coolant"
    POSITION = "position of a nut"
    DISPLACEMENT = "displacement"
    SPEED = "speed"
    OTHER = "other"


TEMPERATURES = (
    ChannelKind.SCREW, ChannelKind.NODE, ChannelKind.END, ChannelKind.AMBIENT, ChannelKind.COOLANT,
)  # fmt: skip


class Breach(Enum):
    """Which limit a value violates; the numbers are those of the compiled walk over the rows."""

    WITHIN_LIMITS = 0
    LOW = 1
    HIGH = 2
    RATE = 3
    ABOVE_AMBIENT = 4
    BELOW_AMBIENT = 5


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of c channels; infinite means no limit.

    Attributes:
        low, high: (c,) in the channel's own unit
        rate_per_s: (c,) largest change in a second
        above_K, below_K: (c,) largest difference from ambient
        slack: (c,) change between two samples that noise alone may make
        usual: (c, 2) range of values on this machine, from which the unit of others is guessed
        ambient: number of the ambient's channel, or −1
        ambient_degC: constant ambient where `ambient` is −1; NaN if not known
    """

    kinds: tuple[ChannelKind, ...]
    low: FloatArray
    high: FloatArray
    rate_per_s: FloatArray
    above_K: FloatArray
    below_K: FloatArray
    slack: FloatArray
    usual: FloatArray
    ambient: int = -1
    ambient_degC: float = math.nan

    @classmethod
    def of(cls, config: Config) -> Limits:
        """Return the limits of a configuration's channels, in their order."""
        kinds = kinds_of(config)
        rows = [_limits(config, channel, kinds[channel]) for channel in config.channels]
        noise = {s.channel: s.noise / s.channel_scale for s in config.sensor}
        strokes = {s.position_channel: s.stroke_m for s in config.source if s.stroke_m}
        low, high, rate, above, below = np.array(rows, dtype=float).T
        ambient = config.ambient.channel
        return cls(
            tuple(kinds[channel] for channel in config.channels),
            low, high, rate, above, below,
            np.array([10.0 * noise.get(channel, 0.0) for channel in config.channels]),
            np.array([strokes.get(c, row[:2]) for c, row in zip(config.channels, rows, strict=True)]),
            -1 if ambient is None else config.channels.index(ambient),
            math.nan if config.ambient.temperature_degC is None else config.ambient.temperature_degC,
        )  # fmt: skip

    def sentence(self, channel: int, breach: Breach, value: float, ambient_degC: float) -> str:
        """Return how a value violates its limits and, if recognisable, which unit it looks like.

        Args:
            channel: The channel's number.
            breach: The violated limit.
            value: The value in the channel's own unit.
            ambient_degC: The air's temperature; NaN if it is not known.
        """
        air = f"the ambient {ambient_degC:.4g} °C"
        limit = {
            Breach.LOW: f"below {self.low[channel]:g}",
            Breach.HIGH: f"above {self.high[channel]:g}",
            Breach.RATE: f"a change faster than {self.rate_per_s[channel]:g} a second",
            Breach.ABOVE_AMBIENT: f"more than {self.above_K[channel]:g} K above {air}",
            Breach.BELOW_AMBIENT: f"more than {self.below_K[channel]:g} K below {air}",
        }[breach]
        hint = unit_hint(
            self.kinds[channel], value, self.usual[channel, 0], self.usual[channel, 1], ambient_degC
        )
        return f"implausible: {value:.6g} is {limit}" + (f"; {hint}" if hint else "")

    def breaches(self, channel: int, value: Any, ambient_degC: float) -> Iterator[tuple[Breach, Any]]:
        """Yield each limit for single values with whether a value violates it; for an array, which values do.

        Args:
            channel: The channel's number.
            value: A number or an array, in the channel's own unit.
            ambient_degC: The air's temperature; with NaN the limits relative to it do not apply.
        """
        yield Breach.LOW, value < self.low[channel]
        yield Breach.HIGH, value > self.high[channel]
        yield Breach.ABOVE_AMBIENT, value - ambient_degC > self.above_K[channel]
        yield Breach.BELOW_AMBIENT, ambient_degC - value > self.below_K[channel]

    def doubt(self, channel: int, value: float) -> str | None:
        """Return how a single value violates its limits; None if it is plausible."""
        for breach, is_beyond in self.breaches(channel, value, self.ambient_degC):
            if is_beyond:
                return self.sentence(channel, breach, value, self.ambient_degC)
        return None


def kinds_of(config: Config) -> Mapping[str, ChannelKind]:
    """Return the kind of each channel of a configuration."""
    kinds = dict.fromkeys(config.channels, ChannelKind.OTHER)
    inlets = (getattr(effect, "inlet_channel", None) for effect in config.effect)
    kinds |= {name: ChannelKind.COOLANT for name in inlets if name is not None}
    for source in config.source:
        for name in (source.speed_channel, source.nut_speed_channel):
            if name is not None:
                kinds[name] = ChannelKind.SPEED
        if source.position_channel is not None:
            kinds[source.position_channel] = ChannelKind.POSITION
    for end in (config.boundary.left, config.boundary.right):
        if end.channel is not None:
            kinds[end.channel] = ChannelKind.END
    if config.ambient.channel is not None:
        kinds[config.ambient.channel] = ChannelKind.AMBIENT
    if config.bed is not None and config.bed.channel is not None:
        kinds[config.bed.channel] = ChannelKind.NODE
    for sensor in config.sensor:
        of_node = ChannelKind.NODE if sensor.on else ChannelKind.SCREW
        kinds[sensor.channel] = ChannelKind.DISPLACEMENT if sensor.kind == "displacement" else of_node
    return kinds


def _limits(config: Config, channel: str, kind: ChannelKind) -> tuple[float, ...]:
    """Return low, high, rate, and the largest rise above and drop below ambient, of one channel."""
    length_m, most_rpm = config.screw.length_m, DN_MM_RPM / (1000.0 * config.screw.diameter_m)
    low, high = {
        ChannelKind.AMBIENT: AMBIENT_RANGE_DEGC,
        ChannelKind.POSITION: (-BEYOND_ENDS * length_m, (1.0 + BEYOND_ENDS) * length_m),
        ChannelKind.SPEED: (-most_rpm, most_rpm),
        ChannelKind.DISPLACEMENT: _grown(config, channel),
        ChannelKind.OTHER: (-math.inf, math.inf),
    }.get(kind, SCREW_RANGE_DEGC)
    rate = RATE_K_S if kind in {ChannelKind.SCREW, ChannelKind.NODE} else math.inf
    # A heater on a test bench warms a rod as no friction does.
    is_near_ambient = kind is ChannelKind.SCREW and all(
        source.power_channel is None for source in config.source
    )
    above_K, below_K = (ABOVE_AMBIENT_K, BELOW_AMBIENT_K) if is_near_ambient else (math.inf, math.inf)
    default, configured = (low, high, rate, above_K, below_K), config.limits.get(channel)
    if configured is None:
        return default
    stated = (
        configured.low,
        configured.high,
        configured.rate_per_s,
        configured.above_ambient_K,
        configured.below_ambient_K,
    )
    return tuple(d if s is None else s for s, d in zip(stated, default, strict=True))


def _grown(config: Config, channel: str) -> tuple[float, float]:
    """Return the growth of the screw at the limits of its temperature, in the unit of a displacement's
    channel.
    """
    units_m = [
        1e-6 * s.channel_scale for s in config.sensor if s.channel == channel and s.kind == "displacement"
    ]
    least_degC, most_degC = SCREW_RANGE_DEGC
    most_m = (config.screw.expansion_1_K or 0.0) * config.screw.length_m * (most_degC - least_degC)
    return (-most_m / units_m[0], most_m / units_m[0]) if units_m else (-math.inf, math.inf)


UNIT_OF_KIND = dict.fromkeys(ChannelKind, "degC") | {
    ChannelKind.POSITION: "m",
    ChannelKind.DISPLACEMENT: "m",
    ChannelKind.SPEED: "rpm",
    ChannelKind.OTHER: "",
}
"""The unit in which the configuration expects a channel whose name does not give one."""


def units_of(kind: ChannelKind) -> tuple[Unit, ...]:
    """Return the other units in which a device may report a quantity."""
    return () if kind is ChannelKind.DISPLACEMENT else others_of(UNIT_OF_KIND[kind])


_FAULT_CODES = (32767.0, 32768.0, 3276.7, 3276.8, 327.67, 327.68, 2047.9375, 9999.0, 999.9)
_DS18B20 = {85.0: "the 85 °C of a DS18B20 before its first conversion", -127.0: "a DS18B20 that is missing"}
_RESOLUTIONS_K = (1.0, 0.1, 0.01, 0.0625)
"""The steps in which devices count temperatures."""
_LIKELY_BELOW_K = 15.0
"""A unit that would put a screw further below the air than this is not named."""


def unit_hint(kind: ChannelKind, value: float, low: float, high: float, ambient_degC: float) -> str | None:
    """Return a sentence with every cause that explains a value outside its range; None if none does.

    The causes are units, signs and fault codes.

    Args:
        kind: The quantity.
        value: The value in the channel's own unit.
        low: The least usual value.
        high: The largest usual value.
        ambient_degC: The air's temperature; NaN counts as 22 °C.
    """
    if kind in TEMPERATURES:
        centre = 22.0 if math.isnan(ambient_degC) or not -20.0 < ambient_degC < 60.0 else ambient_degC
        candidates = list(_temperature_candidates(value, centre))
    else:
        candidates = [unit.in_words for unit in units_of(kind) if low <= unit.to_base(value) <= high]
    if not candidates:
        return None
    *first, last = candidates
    return f"it looks like {', '.join(first)}{' or ' if first else ''}{last}"


def _temperature_candidates(value: float, centre_degC: float) -> Iterator[str]:
    """Yield each explanation of a temperature reading that lies far from `centre_degC`."""
    if any(abs(abs(value) - code) < 1e-4 * code for code in _FAULT_CODES):
        yield "a device's fault code (give it to its driver as fault_codes)"
    yield from (cause for code_degC, cause in _DS18B20.items() if abs(value - code_degC) < 1e-6)
    for bits in (16, 32):
        for step_K in _RESOLUTIONS_K:
            signed_degC = value - 2.0**bits * step_K
            if signed_degC < 0.0 and abs(signed_degC - centre_degC) <= ABOVE_AMBIENT_K:
                yield f'{signed_degC:.4g} °C read as an unsigned number (type = "int{bits}")'
    for unit in others_of("degC"):
        if -_LIKELY_BELOW_K <= unit.to_base(value) - centre_degC <= ABOVE_AMBIENT_K:
            yield unit.in_words


_RATIOS = (
    *(
        (unit.size, f"the speed looks like {unit.in_words} where rpm is expected")
        for unit in others_of("rpm")
    ),
    (1000.0, "the position looks like mm where m is expected"),
    (0.001, "the position looks like km, or lead_m like mm"),
)


def motion_sentence(position: str, speed: str, ratio: float) -> str:
    """Return a sentence about a nut that moves another way than speed and lead give, with the likely unit.

    Args:
        position: The channel of its position.
        speed: The channel of its speed.
        ratio: Its way over the way that speed and lead give.
    """
    likely = next((text for factor, text in _RATIOS if abs(ratio / factor - 1.0) < 0.25), None)
    finding = f"{position} moves {ratio:.2g} times as far as {speed} and lead_m say"
    return f"{finding}; {likely or 'check lead_m, any gear between them, and both units'}"


def ambient_of_log_degC(config: Config, values: FloatArray, channels: Sequence[str]) -> float:
    """Return the air's temperature in a log, in °C.

    Args:
        config: The configuration.
        values: The log's cells, (n, c).
        channels: Their c channels.

    Returns:
        The median of the ambient's channel, else the configured value; NaN if unknown.
    """
    if config.ambient.channel not in channels:
        return math.nan if config.ambient.temperature_degC is None else config.ambient.temperature_degC
    air_degC = values[:, channels.index(config.ambient.channel)]
    air_degC = air_degC[np.isfinite(air_degC)]
    return float(np.median(air_degC)) if len(air_degC) else math.nan


def doubts_of_log(
    config: Config, values: FloatArray, channels: Sequence[str], paths: Sequence[Mapping[str, NutPath]]
) -> Iterator[str]:
    """Yield a sentence for each channel of a log that is beyond its limits, with the unit it looks like.

    Args:
        config: The configuration.
        values: The log's cells, (n, c).
        channels: Their c channels, in order.
        paths: The nuts' paths, block by block.
    """
    for name, part, sentence in implausible(config, values, channels):
        share = f" ({part:.0%} of its values)" if part < 0.995 else ""
        yield f"channel {name}{share} is {sentence}"
    for source in config.source:
        position, speed = source.position_channel, source.speed_channel
        if position is not None and speed is not None:
            ratio = way_ratio([part[position] for part in paths], stroke_of_m(config, source.stroke_m))
            if ratio is not None and not FALLS_SHORT <= ratio <= DISAGREE:
                yield motion_sentence(position, speed, ratio)


def cells_of(config: Config, values: FloatArray, channels: Sequence[str]) -> FloatArray:
    """Return a log's cells in the order of the configuration's channels, NaN where it lacks one.

    Args:
        config: The configuration.
        values: The log's cells, (n, c).
        channels: Their c channels, in order.

    Returns:
        Cells of n rows, one column for each configured channel.
    """
    cells = np.full((len(values), len(config.channels)), np.nan)
    for j, name in enumerate(config.channels):
        if name in channels:
            cells[:, j] = values[:, channels.index(name)]
    return cells


def implausible(
    config: Config, values: FloatArray, channels: Sequence[str]
) -> Iterator[tuple[str, float, str]]:
    """Yield the channels that violate their limits: name, fraction of such values, and a sentence about them.

    Only the first violated limit of a channel is named.

    Args:
        config: The configuration.
        values: The log's cells, (n, c).
        channels: Their c channels, in order.
    """
    limits, ambient_degC = Limits.of(config), ambient_of_log_degC(config, values, channels)
    cells = cells_of(config, values, channels)
    for j, name in enumerate(config.channels):
        if name not in channels:
            continue
        column, credible = cells[:, j], warm_enough(limits, j, cells, ambient_degC)
        usable = np.isfinite(column)
        column, credible = column[usable], credible[usable]
        for breach, outside in limits.breaches(j, column, ambient_degC):
            implausible_rows = outside & ~credible if breach is Breach.ABOVE_AMBIENT else outside
            if implausible_rows.any():
                typical = float(np.median(column[implausible_rows]))
                yield (
                    name,
                    float(np.mean(implausible_rows)),
                    limits.sentence(j, breach, typical, ambient_degC),
                )
                break


def warm_enough(limits: Limits, j: int, values: FloatArray, air_degC: float) -> BoolArray:
    """Return which values of channel j are credible although further above ambient than the limit, (n,).

    As in the compiled walk, a high value is credible in two cases. The temperature may have risen there
    gradually. Or another thermocouple within its limit is nearer to the value than to the same value read as
    °F.

    Args:
        limits: The limits of c channels.
        j: The channel's number.
        values: The columns of all channels, (n, c).
        air_degC: The air's temperature.
    """
    column, above_K = values[:, j], limits.above_K
    hot: BoolArray = (column - air_degC > above_K[j]) & (column - air_degC <= WARMED * above_K[j])
    if not hot.any():
        return hot
    others = np.array([k for k in np.flatnonzero(np.isfinite(above_K)) if k != j], int)
    cool = np.where(values[:, others] - air_degC <= above_K[others], values[:, others], np.nan)
    nearer_in_degC = np.abs(column[:, None] - cool) < np.abs(((column - 32.0) / 1.8)[:, None] - cool)
    sure = nearer_in_degC.any(axis=1) | (column - air_degC <= above_K[j])
    rows = np.flatnonzero(np.isfinite(column))
    stretch = np.cumsum(np.abs(np.diff(column[rows], prepend=column[rows[0]])) > GRADUAL_K)
    run_starts = np.flatnonzero(np.diff(stretch, prepend=-1))
    sure_from = np.maximum.accumulate(np.where(sure[rows], np.arange(len(rows)), -1))
    credible = np.zeros(len(column), bool)
    credible[rows] = sure_from >= run_starts[stretch]
    return np.asarray(hot & credible)


def stroke_of_m(config: Config, stroke_m: tuple[float, float] | None) -> float:
    """Return the length of a stroke in m; the length of the screw if no stroke is given."""
    return config.screw.length_m if stroke_m is None else stroke_m[1] - stroke_m[0]


def way_ratio(parts: Sequence[NutPath], stroke_m: float) -> float | None:
    """Return the nut's path over the path that speed and lead give, where samples are close enough.

    Args:
        parts: The nut's paths, block by block.
        stroke_m: The length of its stroke, in m.

    Returns:
        1 if all units are right; None if the nut has moved less than one stroke.
    """
    driven_path_m, travelled_m = 0.0, 0.0
    for path in parts:
        since_s = np.diff(path.time_s)
        driven_m = 0.5 * (path.driven_m_s[1:] + path.driven_m_s[:-1]) * since_s
        close = (since_s > 0.0) & (since_s < 10.0) & np.isfinite(driven_m) & (2.5 * driven_m <= stroke_m)
        driven_path_m += float(driven_m[close].sum())
        travelled_m += float(np.abs(np.diff(path.position_m))[close].sum())
    if max(driven_path_m, travelled_m) < stroke_m:
        return None
    return travelled_m / max(driven_path_m, 1e-6 * stroke_m)
