"""Samples for a picture, from a stream of blocks whose length nobody knows beforehand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.config import Config
from observer.frames import EstimateBlock, FloatArray, Inputs, Layout
from observer.model.build import grid_of
from observer.model.plant import Rows

MOST = 2000
IntArray = NDArray[np.int64]


class Decimator:
    """Keeps at most `most` evenly spaced rows of a stream, and the extremes of what lies between them.

    Rows fall into buckets of a fixed number of rows. When there are too many buckets, neighbours merge in
    pairs and the buckets hold twice as many rows from then on. Of each bucket the last row is kept, and each
    column's smallest and largest value (NaN only where the bucket holds nothing else).
    """

    def __init__(self, most: int = MOST) -> None:
        """Start empty."""
        self.rows = 0
        self._most = most
        self._stride = 1
        self._kept: dict[str, tuple[FloatArray, FloatArray, FloatArray]] = {}

    def add(self, columns: Mapping[str, FloatArray]) -> None:
        """Take a block: arrays (K,) or (K, c), the same names in every block."""
        length = len(next(iter(columns.values())))
        if length == 0:
            return
        bucket = (self.rows + np.arange(length)) // self._stride
        first = np.flatnonzero(np.diff(bucket, prepend=-1))
        last = np.append(first[1:], length) - 1
        joins = self.rows % self._stride > 0
        for name, values in columns.items():
            new = (values[last], np.fmin.reduceat(values, first), np.fmax.reduceat(values, first))
            self._kept[name] = _appended(self._kept[name], new, joins) if self.rows else new
        self.rows += length
        while -(-self.rows // self._stride) > self._most:
            self._kept = {name: _halved(kept) for name, kept in self._kept.items()}
            self._stride *= 2

    def last(self, name: str) -> FloatArray:
        """The rows kept of a column."""
        return self._kept[name][0]

    def low(self, name: str) -> FloatArray:
        """The smallest value in each bucket."""
        return self._kept[name][1]

    def high(self, name: str) -> FloatArray:
        """The largest value in each bucket."""
        return self._kept[name][2]


def _appended(
    old: tuple[FloatArray, ...], new: tuple[FloatArray, ...], joins: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Old and new buckets in a row; if `joins`, the first new one continues the last old one."""
    (a, a_low, a_high), (b, b_low, b_high) = old, new
    if joins:
        b_low[0] = np.fmin(a_low[-1], b_low[0])
        b_high[0] = np.fmax(a_high[-1], b_high[0])
        a, a_low, a_high = a[:-1], a_low[:-1], a_high[:-1]
    return np.concatenate([a, b]), np.concatenate([a_low, b_low]), np.concatenate([a_high, b_high])


def _halved(kept: tuple[FloatArray, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Neighbouring buckets merged; an odd one at the end stays, half full."""
    values, low, high = kept
    first = np.arange(0, len(values), 2)
    last = np.minimum(first + 1, len(values) - 1)
    return values[last], np.fmin.reduceat(low, first), np.fmax.reduceat(high, first)


@dataclass(frozen=True, slots=True)
class EstimateSamples:
    """What the overview of a replay shows; n samples of `steps` steps.

    `time_s` (n,); `heat_W`, `heat_low_W`, `heat_high_W`, `heat_sigma_W`, `law_W` (n, m_e); `field_degC`,
    `field_sigma_K` (n, g); `error_um`, `error_sigma_um` (n, g) or (n, 0); `surprise_low`, `surprise_high`
    (n, s), the extremes of innovation / σ; `sensor_quality` (n, s) and `quality` (n,), the worst of each
    bucket; `good` the share of the steps of good quality.
    """

    layout: Layout
    steps: int
    good: float
    time_s: FloatArray
    heat_W: FloatArray
    heat_low_W: FloatArray
    heat_high_W: FloatArray
    heat_sigma_W: FloatArray
    law_W: FloatArray
    field_degC: FloatArray
    field_sigma_K: FloatArray
    error_um: FloatArray
    error_sigma_um: FloatArray
    surprise_low: FloatArray
    surprise_high: FloatArray
    sensor_quality: IntArray
    quality: IntArray


class Collector:
    """Takes the blocks of a replay as they come and keeps what its overview shows."""

    def __init__(self, config: Config) -> None:
        """Fix which columns are kept."""
        self._layout = Layout(
            tuple(s.name for s in config.source if s.estimate),
            grid_of(config),
            tuple(s.name for s in config.sensor),
            config.screw.expansion_1_K is not None,
        )
        self._estimated = np.flatnonzero([s.estimate for s in config.source])
        self._sensor_m = np.array([np.nan if s.position_m is None else s.position_m for s in config.sensor])
        self._noise_K = np.array([s.noise_K for s in config.sensor])
        self._rows = Decimator()
        self._good = 0

    def add(self, inputs: Inputs, estimates: EstimateBlock) -> None:
        """Take one block of inputs and the estimates made of them."""
        self._good += int(np.count_nonzero(estimates.quality == 0))
        self._rows.add(
            {
                "time_s": estimates.time_s,
                "heat_W": estimates.heat_W,
                "heat_sigma_W": estimates.heat_sigma_W,
                "law_W": inputs.law_W[:, self._estimated],
                "field_degC": estimates.field_degC,
                "field_sigma_K": estimates.field_sigma_K,
                "error_um": estimates.error_um,
                "error_sigma_um": estimates.error_sigma_um,
                "surprise": estimates.innovation_K / self._innovation_sigma_K(estimates),
                "sensor_quality": estimates.sensor_quality.astype(float),
                "quality": estimates.quality.astype(float),
            }
        )

    def _innovation_sigma_K(self, estimates: EstimateBlock) -> FloatArray:
        """σ of the innovations (K, s) by the sensors' noise and the field's σ around them; that of a sensor
        beside the screw by its noise alone.
        """
        grid_m = self._layout.position_m
        right = np.clip(np.searchsorted(grid_m, self._sensor_m), 1, len(grid_m) - 1)
        share = (self._sensor_m - grid_m[right - 1]) / (grid_m[right] - grid_m[right - 1])
        share, beside = np.clip(share, 0.0, 1.0), np.isnan(self._sensor_m)
        sigma_K = (
            estimates.field_sigma_K[:, right - 1] * (1 - share) + estimates.field_sigma_K[:, right] * share
        )
        return np.asarray(np.sqrt(np.where(beside, 0.0, sigma_K) ** 2 + self._noise_K**2))

    def samples(self) -> EstimateSamples:
        """Return what was kept."""
        rows = self._rows
        return EstimateSamples(
            layout=self._layout,
            steps=rows.rows,
            good=self._good / max(rows.rows, 1),
            heat_low_W=rows.low("heat_W"),
            heat_high_W=rows.high("heat_W"),
            surprise_low=rows.low("surprise"),
            surprise_high=rows.high("surprise"),
            sensor_quality=rows.high("sensor_quality").astype(np.int64),
            quality=rows.high("quality").astype(np.int64),
            **{name: rows.last(name) for name in _ESTIMATE_COLUMNS},
        )


_ESTIMATE_COLUMNS = (
    "time_s", "heat_W", "heat_sigma_W", "law_W", "field_degC", "field_sigma_K", "error_um", "error_sigma_um",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class SimulationSamples:
    """What the overview of a simulation shows; n samples of `steps` steps.

    `time_s` (n,); `law_W` (n, m) of every source; `field_degC` (n, g); `error_um` (n, g) or (n, 0);
    `predicted_degC` and `measured_degC` (n, s), the latter NaN where the program has no such channel.
    """

    position_m: FloatArray
    steps: int
    time_s: FloatArray
    law_W: FloatArray
    field_degC: FloatArray
    error_um: FloatArray
    predicted_degC: FloatArray
    measured_degC: FloatArray


class SimulationCollector:
    """Takes the blocks of a simulation as they come and keeps what its overview shows."""

    def __init__(self, config: Config) -> None:
        """Start empty."""
        self._grid_m = grid_of(config)
        self._rows = Decimator()

    def add(self, inputs: Inputs, rows: FloatArray, meaning: Rows) -> None:
        """Take one block of inputs and the output rows (K, R) predicted from them."""
        self._rows.add(
            {
                "time_s": inputs.time_s,
                "law_W": inputs.law_W,
                "field_degC": rows[:, meaning.field_slice],
                "error_um": meaning.error_um(rows),
                "predicted_degC": rows[:, meaning.sensor_slice],
                "measured_degC": np.where(inputs.usable, inputs.y_degC, np.nan),
            }
        )

    def samples(self) -> SimulationSamples:
        """Return what was kept."""
        rows = self._rows
        columns = ("time_s", "law_W", "field_degC", "error_um", "predicted_degC", "measured_degC")
        return SimulationSamples(self._grid_m, rows.rows, **{name: rows.last(name) for name in columns})
