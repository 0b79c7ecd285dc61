"""Samples for a picture, from a stream of blocks of unknown length."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from observer.config.machine import Config
from observer.frames import EstimateBlock, FloatArray, Inputs, Layout
from observer.model.plant import OutputRows

MOST = 2000


class Decimator:
    """Keeps at most `most` evenly spaced rows of a stream, and the extremes of the rows between them.

    Rows fall into buckets of a fixed number of rows. When there are too many buckets, neighbours merge in
    pairs and the buckets hold twice as many rows from then on. The last row of each bucket is kept, and each
    column's smallest and largest value (NaN only where the bucket holds nothing else). So memory is bounded,
    however long the stream is, and no peak is lost.

    Attributes:
        rows: Number of rows taken so far.
    """

    def __init__(self, most: int = MOST) -> None:
        self.rows = 0
        self._most = most
        self._stride = 1
        self._kept: dict[str, FloatArray] = {}  # last, low and high values, (3, n) or (3, n, c)

    def add(self, columns: Mapping[str, FloatArray]) -> None:
        """Take a block.

        Args:
            columns: Arrays (K,) or (K, c), with the same names and c in every block; K may be 0.
        """
        length = len(next(iter(columns.values())))
        if length == 0:
            return
        bucket = (self.rows + np.arange(length)) // self._stride
        first = np.flatnonzero(np.diff(bucket, prepend=-1))
        joins = self.rows % self._stride > 0  # the block begins within the last bucket
        for name, values in columns.items():
            new = _extremes(np.stack([values] * 3), first)
            if self.rows:
                both = np.concatenate([self._kept[name], new], axis=1)
                old = self._kept[name].shape[1]
                new = _extremes(both, np.delete(np.arange(both.shape[1]), [old] if joins else []))
            self._kept[name] = new
        self.rows += length
        while -(-self.rows // self._stride) > self._most:
            self._kept = {
                k: _extremes(column, np.arange(0, column.shape[1], 2)) for k, column in self._kept.items()
            }
            self._stride *= 2

    def last(self, name: str) -> FloatArray:
        """Return the last row of each bucket of a column, (n,) or (n, c)."""
        return np.asarray(self._kept[name][0])

    def low(self, name: str) -> FloatArray:
        """Return the smallest value in each bucket of a column, (n,) or (n, c)."""
        return np.asarray(self._kept[name][1])

    def high(self, name: str) -> FloatArray:
        """Return the largest value in each bucket of a column, (n,) or (n, c)."""
        return np.asarray(self._kept[name][2])


def _extremes(buckets: FloatArray, first: NDArray[np.int64]) -> FloatArray:
    """The last, the smallest and the largest value of each bucket that begins at `first` among last, least
    and largest.
    """
    ends = np.append(first[1:], buckets.shape[1]) - 1
    low, high = np.fmin.reduceat(buckets[1], first), np.fmax.reduceat(buckets[2], first)
    return np.stack([buckets[0][ends], low, high])


class ReplaySamples(Decimator):
    """The data of a replay's overview, collected from its blocks as they come.

    With m_e estimated sources, g grid points and s sensors, the columns are `time_s` (n,); `heat_W`,
    `heat_sigma_W`, `law_W` (n, m_e); `field_degC`, `field_sigma_K` (n, g); `error_um`, `error_sigma_um` (n,
    g) or (n, 0); `innovation_K` and `sensor_quality` (n, s); `quality` (n,).

    Attributes:
        layout: Names and places of the estimates.
    """

    def __init__(self, config: Config, layout: Layout) -> None:
        super().__init__()
        self.layout = layout
        self._estimated = np.flatnonzero([s.estimate for s in config.source])
        self._good = 0

    @property
    def good(self) -> float:
        """The share of the steps of good quality, 0 to 1; 0 before the first step."""
        return self._good / max(self.rows, 1)

    def take(self, inputs: Inputs, estimates: EstimateBlock) -> None:
        """Take one block of inputs and the estimates made of them, with the same K rows."""
        self._good += int(np.count_nonzero(estimates.quality == 0))
        columns = {name: getattr(estimates, name) for name in _OF_ESTIMATES}
        columns["law_W"] = inputs.law_W[:, self._estimated]
        columns["sensor_quality"] = estimates.sensor_quality.astype(float)
        columns["quality"] = estimates.quality.astype(float)
        self.add(columns)


_OF_ESTIMATES = (
    "time_s", "heat_W", "heat_sigma_W", "field_degC", "field_sigma_K", "error_um", "error_sigma_um",
    "innovation_K",
)  # fmt: skip


def simulated(inputs: Inputs, rows: FloatArray, meaning: OutputRows) -> dict[str, FloatArray]:
    """Return the data of a simulation's overview from one block.

    Args:
        inputs: Inputs of K steps.
        rows: Predicted output rows (K, R).
        meaning: The slices of these rows.

    Returns:
        `time_s` (K,); `law_W` (K, m) of every source; `field_degC` (K, g); `error_um` (K, g) or (K, 0);
            `predicted_degC` and `measured_degC` (K, s), the latter NaN where the program has no such channel.
    """
    return {
        "time_s": inputs.time_s,
        "law_W": inputs.law_W,
        "field_degC": rows[:, meaning.field_slice],
        "error_um": meaning.error_um(rows),
        "predicted_degC": rows[:, meaning.sensor_slice],
        "measured_degC": np.where(inputs.usable, inputs.y_degC, np.nan),
    }
