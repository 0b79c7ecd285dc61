"""The times of a log from another recorder: how often each channel has a value, and the unit of the times.

A recorder that asks slow or scanned sensors in turn writes a row for each question, most cells of which are
empty. Such a cell is not a missing value; one that stays empty beyond the sensor's own interval is.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from observer.config import Config
from observer.files.logs import Log
from observer.frames import BoolArray, FloatArray

OVERDUE = 1.5
"""Intervals after which an empty cell is a missing value: one value did not come."""
LEAST_VALUES = 8
"""Fewer values say nothing about a channel's interval."""
REGULAR = 0.9
"""The least part of the times between values that lies within half of the usual one, for it to be the usual
one. Of values that are missing at random no more than 0.8 do.
"""
MOST = 0.95
"""Part of the times between irregular values that are no gaps."""
ROWS_FROM_S = 5.0
"""Taken as milliseconds, closer rows are 5 ms apart, which any recorder may write."""
SLOWEST_S = 2 * 86_400.0
"""Screws warm and cool within hours, every day again; whatever takes longer is hardly a temperature."""
GAP_S, GAP_ROWS = 600.0, 20.0
"""A gap between rows is longer than both: the screw has warmed or cooled by degrees."""
MOVED = 10.0
"""Multiple of its noise by which a sensor must vary to show how fast it does."""


def intervals_s(log: Log, channels: tuple[str, ...], given_s: FloatArray) -> FloatArray:
    """The time between the values of each channel (c,) of a log; NaN for one that every row has.

    `given_s` (c,) are those that the configuration gives, NaN where it is to be learnt.
    """
    found_s = given_s.copy()
    for j in np.flatnonzero(np.isnan(given_s)):
        if channels[j] in log.channels:
            there = np.isfinite(log.values[:, log.channels.index(channels[j])])
            found_s[j] = _learnt_s(log.time_s, there, joined=log.joined)
    return found_s


def _learnt_s(time_s: FloatArray, there: BoolArray, *, joined: bool) -> float:
    """The usual time between values that are regularly rarer than the rows; NaN where they are not.

    Where rows of several clocks were joined it is any channel's own, and that of irregular values the time
    within which most of them come.
    """
    rows = np.flatnonzero(there)
    if len(rows) <= LEAST_VALUES or (not joined and np.median(np.diff(rows)) < 2):
        return np.nan
    apart_s = np.diff(time_s[rows])
    usual_s = float(np.median(apart_s))
    if joined:
        return max(usual_s, float(np.quantile(apart_s, MOST)) / OVERDUE)
    regular = float(np.mean(np.abs(apart_s - usual_s) <= 0.5 * usual_s)) >= REGULAR
    return usual_s if regular else np.nan


def expected_cells(time_s: FloatArray, there: BoolArray, interval_s: float) -> BoolArray:
    """Which cells (n,) of a channel carry information: its values, and overdue ones.

    `there` (n,): which hold a value.
    """
    if np.isnan(interval_s):
        return np.ones(len(time_s), np.bool_)
    last = np.maximum.accumulate(np.where(there, np.arange(len(time_s)), -1))
    since_s = np.where(last >= 0, time_s - time_s[last], time_s - time_s[0])
    return np.asarray(there | (since_s > OVERDUE * interval_s))


def given_intervals_s(config: Config) -> FloatArray:
    """Return what `[log] sensor_period_s` says of each channel (c,) in s, NaN where it says nothing; infinite
    of an occasional one, or one that sends only on change: no cell of theirs is overdue.
    """
    given, of_channel = config.log.sensor_period_s, {s.channel: s for s in config.sensor}
    found_s = np.full(len(config.channels), np.nan)
    for j, name in enumerate(config.channels):
        sensor = of_channel.get(name)
        if name in config.heartbeats_s or (sensor is not None and sensor.occasional):
            found_s[j] = np.inf
        elif sensor is not None and given is not None:
            found_s[j] = given if isinstance(given, float) else given.get(sensor.name, np.nan)
    return found_s


def doubt_of_times(log: Log, config: Config) -> str | None:
    """Report times that look like milliseconds: rows that are far apart, and temperatures that nevertheless
    take days for what screws do within hours.
    """
    apart_s = float(np.median(np.diff(log.time_s))) if len(log) > 1 else 0.0
    if log.step is not None or apart_s < ROWS_FROM_S:
        return None
    taken = [
        _scale_s(log, log.values[:, log.channels.index(s.channel)], MOVED * s.noise_K)
        for s in config.sensor
        if s.channel in log.channels and s.kind == "temperature"
    ]
    known = [each for each in taken if np.isfinite(each)]
    if not known or min(known) < SLOWEST_S:
        return None
    return (
        f"by time_s the rows are {apart_s:.3g} s apart and the temperatures take {min(known) / 86_400:.2g} "
        "days for what a screw does within hours, which looks like milliseconds where seconds are expected; "
        "divide the column by 1000"
    )


def gaps_of(log: Log) -> Iterator[str]:
    """Yield a sentence where rows are missing for so long that the screw has changed meanwhile."""
    apart_s = np.diff(log.time_s)
    long = apart_s > max(GAP_S, GAP_ROWS * float(np.median(apart_s))) if len(apart_s) else np.zeros(0)
    if long.any():
        at = int(np.argmax(apart_s))
        one = f"there is no row for {_duration(apart_s[at])} after {log.time_s[at]:.6g} s"
        many = f", the longest of {int(long.sum())} such gaps" if long.sum() > 1 else ""
        yield (
            f"{one}{many}: what the machine did there is unknown, and what is found just after it is "
            "doubtful; give the parts as logs of their own"
        )


def _duration(time_s: float) -> str:
    """A length of time for people."""
    unit, size_s = ("h", 3600.0) if time_s >= 3600.0 else ("min", 60.0)
    return f"{time_s / size_s:.3g} {unit}"


def _scale_s(log: Log, reading_degC: FloatArray, least_K: float) -> float:
    """The time in which a reading changes by its own standard deviation, rms; NaN where it hardly varies."""
    there = np.isfinite(reading_degC)
    value, time_s = reading_degC[there], log.time_s[there]
    if len(value) < LEAST_VALUES or (sigma := float(np.std(value))) < least_K:
        return np.nan
    lag = 1
    while lag < len(value):
        if np.sqrt(np.mean((value[lag:] - value[:-lag]) ** 2)) >= sigma:
            return float(np.median(time_s[lag:] - time_s[:-lag]))
        lag = max(lag + 1, lag * 5 // 4)
    return float(time_s[-1] - time_s[0])
