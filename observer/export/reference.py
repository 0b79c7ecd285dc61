"""A log through the reduced observer as a controller receives it: the newest values at each period."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.errors import LogError
from observer.export.fmu import variables
from observer.export.form import Form, FormRunner
from observer.files.logs import Log
from observer.frames import BoolArray, FloatArray

_MOST_STEPS = 1_000_000


class Samples(NamedTuple):
    """The samples before each of K steps, of c channels.

    Attributes:
        time_s: The time of each step, (K,), in the log's clock.
        reading: The newest value of each channel in its own unit, (K, c); 0 before the first.
        fresh: Whether the channel had a value since the step before, (K, c).
    """

    time_s: FloatArray
    reading: FloatArray
    fresh: BoolArray


def sampled(log: Log, channels: tuple[str, ...], period_s: float) -> Samples:
    """Return the newest value of each channel since the last step, at an even period from the first row on.

    A channel that the log lacks is never fresh.

    Args:
        log: The log.
        channels: The names (c,) in the order of the form's input `reading`.
        period_s: The interval of the steps, in s.

    Raises:
        LogError: If this makes more than a million steps.
    """
    count = int((log.time_s[-1] - log.time_s[0]) / period_s) + 1
    if count > _MOST_STEPS:
        raise LogError(f"{log.path}: makes {count} steps of {period_s:g} s; give a part of it")
    time_s = log.time_s[0] + period_s * np.arange(count)
    # a row at a step's time belongs to it, whatever the rounding
    end = np.searchsorted(log.time_s, time_s + 1e-3 * period_s, side="right")
    begin = np.concatenate([[0], end[:-1]])
    reading, fresh = np.zeros((count, len(channels))), np.zeros((count, len(channels)), np.bool_)
    for j, name in enumerate(channels):
        if name not in log.channels:
            continue
        column = log.values[:, log.channels.index(name)]
        last = np.maximum.accumulate(np.where(np.isfinite(column), np.arange(len(column)), -1))
        newest = last[end - 1]
        fresh[:, j] = newest >= begin
        reading[:, j] = np.where(newest >= 0, column[newest], 0.0)
    return Samples(time_s, reading, fresh)


def run(form: Form, samples: Samples) -> dict[str, NDArray[Any]]:
    """Run the reference over samples, with the compensation armed as soon as the quality is good.

    Args:
        form: The observer's form.
        samples: The inputs of K steps.

    Returns:
        Each output by its name, (K,) or (K, …) with the output's shape.
    """
    runner, rows, armed = FormRunner(form), [], False
    commands = {slot.name for slot in form.of("input")}
    for k, (reading, fresh) in enumerate(zip(samples.reading, samples.fresh, strict=True)):
        inputs: dict[str, Any] = {"reading": reading.tolist(), "fresh": fresh.tolist()}
        if "enable" in commands:
            inputs |= {"enable": armed, "heartbeat": k % 1000}
        rows.append(runner.step(inputs))
        armed = rows[-1]["quality"] == 0
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def columns_of(form: Form, samples: Samples, outputs: dict[str, NDArray[Any]]) -> dict[str, FloatArray]:
    """Return inputs and outputs of a run as columns (K,) by name, NaN where an input had no new value.

    Names are those of the FMU and of `estimates.csv`.

    Args:
        form: The observer's form.
        samples: The inputs of K steps.
        outputs: What `run` returned for them.
    """
    slots = {slot.name: slot for slot in form.slots}
    columns = {
        label: np.where(samples.fresh[:, j], samples.reading[:, j], np.nan)
        for j, label in enumerate(slots["reading"].labels)
    }
    for place in variables(form):
        if place.slot.role == "output":
            values = outputs[place.slot.name]
            columns[place.name] = values[:, place.at] if place.slot.shape else values
    return columns
