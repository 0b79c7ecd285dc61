"""CAN recordings (.asc, .blf, …) as logs: their frames through the live decoding, with ticks in between."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np

from observer.errors import ConfigError, LogError
from observer.files.logs import Log
from observer.frames import Reading
from observer.installation import Installation
from observer.record.recorder import flags_of

SUFFIXES = (".asc", ".blf", ".trc", ".log", ".mf4", ".db")
"""What `observer replay` takes for a CAN recording; `.csv` is always a log of channels."""


def is_can_recording(path: Path) -> bool:
    """Whether a path names a CAN recording, compressed or not."""
    return path.with_suffix("").suffix in SUFFIXES if path.suffix == ".gz" else path.suffix in SUFFIXES


def read_can_log(path: Path, config: Installation) -> Log:
    """Decode a recording by the configuration's CAN drivers, with a tick at each period.

    Raises `LogError` where it cannot be read, was cut off or goes back in time, `ConfigError` where no CAN
    driver is configured.
    """
    decoded = [driver.decodes(path, name) for name, driver in config.drivers.items()]
    buses = [readings for readings in decoded if readings is not None]
    if not buses:
        raise ConfigError(f'{path}: a CAN recording needs a [drivers.…] table with kind = "can" to decode it')
    if not path.exists():
        raise LogError(f"{path}: no such file; give the path of a log")
    readings = [reading for readings in buses for reading in readings]
    if len(buses) == 1 and any(b.time_s < a.time_s for a, b in itertools.pairwise(readings)):
        raise LogError(f"{path}: time goes backwards; sort the recording by time")
    readings.sort(key=lambda reading: reading.time_s)
    if not readings:
        raise LogError(f"{path}: no frame that the configured DBC files describe; check the bus and the DBC")
    return _with_ticks(path, readings, config.channels, config.estimator.period_s)


def _with_ticks(path: Path, readings: list[Reading], channels: tuple[str, ...], period_s: float) -> Log:
    """The rows of a recording of the service: readings as they came, ticks at whole periods."""
    first = math.floor(readings[0].time_s / period_s) + 1
    last = math.floor(readings[-1].time_s / period_s)
    ticks = np.arange(first, last + 1) * period_s
    times = np.array([r.time_s for r in readings])
    for i in range(1, len(times)):
        times[i] = max(times[i], math.nextafter(times[i - 1], math.inf))
    values = np.array([[r.values.get(c, math.nan) for c in channels] for r in readings])
    flags = [flags_of(r, channels) for r in readings]
    nothing = np.full((len(ticks), len(channels)), math.nan)
    ticks = np.where(np.isin(ticks, times), np.nextafter(ticks, math.inf), ticks)
    order = np.argsort(np.concatenate([times, ticks]), kind="stable")
    return Log(
        path,
        np.concatenate([times, ticks])[order],
        channels,
        np.concatenate([values, nothing])[order],
        np.concatenate([np.zeros(len(times), np.bool_), np.ones(len(ticks), np.bool_)])[order],
        tuple([*flags, *[None] * len(ticks)][i] for i in order),
    )
