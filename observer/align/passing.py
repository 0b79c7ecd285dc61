"""A displacement that is measured wherever the nut is, as readings at the places which the nut passes.

A scale beside the axis, compared with the motor's encoder, shows the thermal error at the nut, which is
somewhere else at each reading. An estimator's rows belong to fixed places. So such a sensor counts as one
sensor at each of several places, which reads when the nut passes it. It reads only while the nut moves away
from x = 0. So the play of the drive is the same at each reading and part of the zero.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Set
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.config.sensors import PASSING_S
from observer.files.logs import Log
from observer.frames import FloatArray, Reading

APART_S = 5.0
"""Readings further apart say nothing of the place between them …"""
_PART = 0.5
"""… nor those further apart than this part of the distance between two places: the error is not straight."""
NEAR_M = 0.003
"""A reading so near a place is one at that place, however far away the one before was."""
_WAITING = 64


class Sighting(NamedTuple):
    """A measurement at a known place.

    Attributes:
        time_s: The time of the measurement.
        position_m: The nut's position then, interpolated between its readings.
        value: The measured value, in the unit of its channel.
    """

    time_s: float
    position_m: float
    value: float


class Passing(NamedTuple):
    """A quantity measured along a nut's way.

    Attributes:
        measured: The channel of the measurement.
        position: The channel of the nut's position.
        channels: A channel for each of the n places, in order.
        places_m: The places on the screw, in m, ascending.
    """

    measured: str
    position: str
    channels: tuple[str, ...]
    places_m: tuple[float, ...]

    @property
    def most_m(self) -> float:
        """The largest distance in m between two readings that show a passage."""
        return _PART * float(np.diff(self.places_m).min())


def passings_of(config: Config) -> tuple[Passing, ...]:
    """Return the sensors of a configuration that measure along a nut's way."""
    positions = {s.name: str(s.position_channel) for s in config.source}
    sensors = [s for s in config.sensor if s.along is not None]
    passings = []
    for measured in dict.fromkeys(s.measured_channel for s in sensors):
        along_nut = [s for s in sensors if s.measured_channel == measured]
        channels, places_m = (
            tuple(s.channel for s in along_nut),
            tuple(s.position_m or 0.0 for s in along_nut),
        )
        passings.append(Passing(measured, positions[str(along_nut[0].along)], channels, places_m))
    return tuple(passings)


@dataclass(slots=True)
class _Track:
    """The recent readings of one `Passing`: positions of the nut, and values that wait for a position."""

    of: Passing
    nut: tuple[float, float] = (math.nan, math.nan)
    waiting: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=_WAITING))
    way: deque[Sighting] = field(default_factory=lambda: deque(maxlen=4))
    read_s: dict[str, float] = field(default_factory=dict)

    def take(self, reading: Reading) -> list[Reading]:
        """Return the readings at the places that the nut has passed by this reading."""
        value = float(reading.values.get(self.of.measured, math.nan))
        if math.isfinite(value) and self.of.measured not in reading.faults:
            self.waiting.append((reading.time_s, value))
        position_m = float(reading.values.get(self.of.position, math.nan))
        if not math.isfinite(position_m) or self.of.position in reading.faults:
            return []
        (before_s, before_m), self.nut = self.nut, (reading.time_s, position_m)
        readings, since_s = [], reading.time_s - before_s
        while self.waiting and self.waiting[0][0] <= reading.time_s:
            time_s, value = self.waiting.popleft()
            if time_s == reading.time_s:
                there_m = position_m
            elif 0.0 < since_s <= APART_S and time_s >= before_s:
                there_m = before_m + (position_m - before_m) * (time_s - before_s) / since_s
            else:
                continue
            readings += self._passed(Sighting(time_s, there_m, value))
        return readings

    def _passed(self, now: Sighting) -> list[Reading]:
        """Return the readings at places between the second and third of the last four sightings.

        The outer two show that the nut does not turn next to them, where part of the play could be in the
        value.
        """
        if self.way and not self.way[-1].time_s < now.time_s <= self.way[-1].time_s + APART_S:
            self.way.clear()
        self.way.append(now)
        if len(self.way) < 4 or np.diff([m.position_m for m in self.way]).min() <= 0.0:
            return []
        _, before, after, _ = self.way
        way_m = after.position_m - before.position_m
        close, readings = way_m <= self.of.most_m, []
        for channel, place_m in zip(self.of.channels, self.of.places_m, strict=True):
            if close and before.position_m < place_m <= after.position_m:
                part = (place_m - before.position_m) / way_m
            elif not close and abs(after.position_m - place_m) <= NEAR_M:
                part = 1.0
            else:
                continue
            time_s = before.time_s + part * (after.time_s - before.time_s)
            if time_s - self.read_s.get(channel, -math.inf) >= PASSING_S:
                self.read_s[channel] = time_s
                value = before.value + part * (after.value - before.value)
                readings.append(Reading(time_s, {channel: value}))
        return readings


class Passings:
    """Takes readings as they come, and returns the readings that follow from them at the places passed.

    A place is read once in `PASSING_S`. Between such readings the screw hardly changes, and readings closer
    in time would share their errors.
    """

    def __init__(self, passings: tuple[Passing, ...]) -> None:
        self._tracks = [_Track(passing) for passing in passings]

    def take(self, reading: Reading) -> list[Reading]:
        """Return the readings that follow from one, none of them later than it."""
        return [passed for track in self._tracks for passed in track.take(reading)]


def never_read(log: Log, passings: Iterable[Passing], read: Set[str]) -> Iterator[str]:
    """Yield a sentence for each sensor with places that are never read: the places, the reason, and the
    remedy.

    Args:
        log: The log.
        passings: The sensors that measure along a nut's way.
        read: The channels that have a value in the frames of the log.
    """
    for passing in passings:
        if not {passing.measured, passing.position} <= set(log.channels):
            continue
        missed = [x for x, c in zip(passing.places_m, passing.channels, strict=True) if c not in read]
        if missed and np.isfinite(log[passing.measured]).any():
            places = f"at {', '.join(f'{x:g}' for x in missed)} m"
            location = places if len(missed) < len(passing.places_m) else "at any of its places"
            reason = _why(log, passing)
            yield f"{passing.measured} is never read {location}, so it says nothing there: {reason}"


def _why(log: Log, passing: Passing) -> str:
    """Return why places are never read in a log, and the remedy."""
    has_value, has_position = (np.isfinite(log[channel]) for channel in (passing.measured, passing.position))
    time_s = log.time_s[has_value]
    position_m = np.interp(time_s, log.time_s[has_position], log[passing.position][has_position])
    outwards = np.diff(position_m) > 0.0
    if not outwards.any():
        return "the nut never goes away from x = 0 past them; log a program that does"
    # most rows' ways, since of a row in which the nut turns only a part is seen
    way_m, apart_s = (float(np.quantile(np.diff(x)[outwards], 0.9)) for x in (position_m, time_s))
    if way_m <= passing.most_m:
        return "the nut does not pass them on its way from x = 0; log a program that does"
    return (
        f"the nut moves {1000 * way_m:.3g} mm between two readings, where at most "
        f"{1000 * passing.most_m:.3g} mm show a passage; log both every "
        f"{_two_digits(apart_s * passing.most_m / way_m)} s or faster, instead of every {apart_s:.3g} s"
    )


def _two_digits(value: float) -> str:
    """Return a value as text, rounded down to two digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.floor(value / unit) * unit:.2g}"


def with_passings(log: Log, sensors: tuple[Passing, ...]) -> Log:
    """Return a plain log with a column for each place; a value is in the row after the passage."""
    if not (
        sensors := tuple(
            passing for passing in sensors if {passing.measured, passing.position} <= set(log.channels)
        )
    ):
        return log
    names = tuple(
        channel for passing in sensors for channel in passing.channels if channel not in log.channels
    )
    column = {name: j for j, name in enumerate(names)}
    values_at_places: FloatArray = np.full((len(log), len(names)), np.nan)
    read = list(dict.fromkeys(name for passing in sensors for name in (passing.measured, passing.position)))
    values, passings = log.values[:, [log.channels.index(name) for name in read]], Passings(sensors)
    for row, (time_s, row_values) in enumerate(zip(log.time_s.tolist(), values.tolist(), strict=True)):
        for reading in passings.take(Reading(time_s, dict(zip(read, row_values, strict=True)))):
            for name, value in reading.values.items():
                if name in column:
                    values_at_places[row, column[name]] = value
    return log.adding(names, values_at_places)
