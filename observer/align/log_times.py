"""The times of a log from another recorder: how often each channel has a value, and the unit of the times.

A recorder that reads slow or scanned sensors in turn writes a row for each reading, in which most cells are
empty. Such a cell is not a missing value; one that stays empty beyond the sensor's own interval is.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from observer.config.machine import Config
from observer.files.log_checks import duration_words
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
    """Return the time between the values of each channel of a log in s, (c,); NaN for one with a value in
    every row.

    Args:
        log: The log.
        channels: The channels of the configuration, (c,).
        given_s: The configured intervals in s, NaN where the interval is to be learnt, (c,).
    """
    interval_s = given_s.copy()
    for j in np.flatnonzero(np.isnan(given_s)):
        if channels[j] in log.channels:
            has_value = np.isfinite(log.values[:, log.channels.index(channels[j])])
            interval_s[j] = _learnt_s(log.time_s, has_value, joined=log.joined)
    return interval_s


def _learnt_s(time_s: FloatArray, has_value: BoolArray, *, joined: bool) -> float:
    """Return the usual time in s between values that are regularly rarer than the rows; NaN if they are not.

    Where rows of several clocks were joined, every channel has its own interval. For irregular values it is
    the time within which most of them come.
    """
    rows = np.flatnonzero(has_value)
    if len(rows) <= LEAST_VALUES or (not joined and np.median(np.diff(rows)) < 2):
        return np.nan
    apart_s = np.diff(time_s[rows])
    usual_s = float(np.median(apart_s))
    if joined:
        return max(usual_s, float(np.quantile(apart_s, MOST)) / OVERDUE)
    regular = float(np.mean(np.abs(apart_s - usual_s) <= 0.5 * usual_s)) >= REGULAR
    return usual_s if regular else np.nan


def expected_cells(time_s: FloatArray, has_value: BoolArray, interval_s: float) -> BoolArray:
    """Return which cells of a channel carry information: its values, and overdue ones, (n,).

    Args:
        time_s: The times of the rows, (n,).
        has_value: Marks the cells with a value, (n,).
        interval_s: The interval between values in s; NaN makes every cell one with information.
    """
    if np.isnan(interval_s):
        return np.ones(len(time_s), np.bool_)
    last = np.maximum.accumulate(np.where(has_value, np.arange(len(time_s)), -1))
    since_s = np.where(last >= 0, time_s - time_s[last], time_s - time_s[0])
    return np.asarray(has_value | (since_s > OVERDUE * interval_s))


def given_intervals_s(config: Config) -> FloatArray:
    """Return the interval that `[log] sensor_period_s` gives for each channel (c,) in s, NaN where it gives
    none.

    It is infinite for an occasional channel and for one that sends only on change, whose cells are never
    overdue.
    """
    period_s, of_channel = config.log.sensor_period_s, {s.channel: s for s in config.sensor}
    interval_s = np.full(len(config.channels), np.nan)
    for j, name in enumerate(config.channels):
        sensor = of_channel.get(name)
        if name in config.heartbeats_s or (sensor is not None and sensor.occasional):
            interval_s[j] = np.inf
        elif sensor is not None and period_s is not None:
            interval_s[j] = period_s if isinstance(period_s, float) else period_s.get(sensor.name, np.nan)
    return interval_s


def doubt_of_times(log: Log, config: Config) -> str | None:
    """Return a sentence if the times look like milliseconds read as seconds; else None.

    The rows are then far apart, and temperatures seem to take days for changes that take hours in a screw.
    """
    apart_s = float(np.median(np.diff(log.time_s))) if len(log) > 1 else 0.0
    if log.step is not None or apart_s < ROWS_FROM_S:
        return None
    scales_s = [
        _scale_s(log, log.values[:, log.channels.index(s.channel)], MOVED * s.noise_K)
        for s in config.sensor
        if s.channel in log.channels and s.kind == "temperature"
    ]
    finite_s = [scale_s for scale_s in scales_s if np.isfinite(scale_s)]
    if not finite_s or min(finite_s) < SLOWEST_S:
        return None
    return (
        f"by time_s the rows are {apart_s:.3g} s apart and the temperatures take "
        f"{min(finite_s) / 86_400:.2g} days for what a screw does within hours, which looks "
        "like milliseconds where seconds are expected; divide the column by 1000"
    )


def gaps_of(log: Log) -> Iterator[str]:
    """Yield a sentence if rows are missing for so long that the screw has changed meanwhile."""
    apart_s = np.diff(log.time_s)
    long = apart_s > max(GAP_S, GAP_ROWS * float(np.median(apart_s))) if len(apart_s) else np.zeros(0)
    if long.any():
        at = int(np.argmax(apart_s))
        sentence = f"there is no row for {duration_words(apart_s[at])} after {log.time_s[at]:.6g} s"
        others = f", the longest of {int(long.sum())} such gaps" if long.sum() > 1 else ""
        yield (
            f"{sentence}{others}: the machine's inputs there are unknown, and results just after it are "
            "doubtful; split the log there and give both parts"
        )


def _scale_s(log: Log, reading_degC: FloatArray, least_K: float) -> float:
    """Return the time in s in which a reading changes by its own standard deviation, rms; NaN if it hardly
    varies.
    """
    is_finite = np.isfinite(reading_degC)
    value, time_s = reading_degC[is_finite], log.time_s[is_finite]
    if len(value) < LEAST_VALUES or (sigma := float(np.std(value))) < least_K:
        return np.nan
    lag = 1
    while lag < len(value):
        if np.sqrt(np.mean((value[lag:] - value[:-lag]) ** 2)) >= sigma:
            return float(np.median(time_s[lag:] - time_s[:-lag]))
        lag = max(lag + 1, lag * 5 // 4)
    return float(time_s[-1] - time_s[0])
