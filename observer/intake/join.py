"""Channels with different clocks, joined to the rows of one log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.frames import BoolArray, FloatArray

SAME_S = 2e-6
"""Times closer than this count as equal: a double of seconds since 1970 resolves no finer."""


@dataclass(frozen=True, slots=True, eq=False)
class ChannelSamples:
    """The samples of a channel.

    Attributes:
        channel: Its name.
        time_s: Increasing times (n,).
        values: Values (n,) in the channel's unit.
        is_held: Whether each value holds until the next one; if not, rows between them have no value.
    """

    channel: str
    time_s: FloatArray
    values: FloatArray
    is_held: bool = False


def joined(parts: Sequence[ChannelSamples]) -> tuple[FloatArray, FloatArray, bool]:
    """Return the rows at which any channel has a sample.

    Times that differ by less than 2 µs share a row.

    Args:
        parts: Channels; those with one clock share the array of times.

    Returns:
        The times (n,), the values (n, c), and whether the clocks differ. A value is NaN where a channel has
            no sample in the row and does not hold its last one.
    """
    clocks = {id(part.time_s): part.time_s for part in parts}
    if len(clocks) == 1:
        return parts[0].time_s, np.column_stack([part.values for part in parts]), False
    every_s = np.sort(np.concatenate(list(clocks.values())))
    time_s = every_s[np.concatenate([[True], np.diff(every_s) > SAME_S])]
    values = np.full((len(time_s), len(parts)), np.nan)
    places = {key: np.searchsorted(time_s, own_s + SAME_S, side="right") - 1 for key, own_s in clocks.items()}
    for j, part in enumerate(parts):
        values[places[id(part.time_s)], j] = part.values
        if part.is_held:
            newest = np.searchsorted(part.time_s, time_s + SAME_S, side="right") - 1
            values[:, j] = np.where(newest >= 0, part.values[np.maximum(newest, 0)], np.nan)
    return time_s, values, any(len(own_s) != len(time_s) for own_s in clocks.values())


def with_steps(time_s: FloatArray, values: FloatArray, inputs: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return rows with one inserted just before each change of an input, so that the inputs change in
    steps.

    Args:
        time_s: Increasing times (n,).
        values: Values (n, c).
        inputs: True for the channels that hold their value until the next row, (c,).

    Returns:
        The times and values of all rows. In an inserted row the inputs keep their values, the others are NaN.
    """
    if len(time_s) < 2 or not inputs.any():
        return time_s, values
    before, after = values[:-1, inputs], values[1:, inputs]
    changes = np.flatnonzero(((before != after) & np.isfinite(before) & np.isfinite(after)).any(axis=1)) + 1
    extra = np.full((len(changes), values.shape[1]), np.nan)
    extra[:, inputs] = values[changes - 1][:, inputs]
    just_s = np.minimum(np.nextafter(time_s[changes], -np.inf), time_s[changes] - SAME_S / 2.0)
    just_s = np.maximum(just_s, np.nextafter(time_s[changes - 1], np.inf))
    return np.insert(time_s, changes, just_s), np.insert(values, changes, extra, axis=0)
