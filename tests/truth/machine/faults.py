"""What real logs suffer from: gaps, uneven clocks, sensors that stick or fall silent."""

from __future__ import annotations

import numpy as np

from tests.truth.machine.physics import FloatArray

FAULTS = ("gaps", "uneven", "stuck", "missing", "minutes")
MINUTE_s = 60.0


def sample_times_s(
    duration_s: float, step_s: float, faults: tuple[str, ...], rng: np.random.Generator
) -> FloatArray:
    """When rows are written, (n,): every step or minute, unevenly, or with gaps of 1 to 10 minutes."""
    row_s = MINUTE_s if "minutes" in faults else step_s
    time_s = np.arange(1, round(duration_s / row_s) + 1) * row_s
    if "uneven" in faults:
        rows = len(time_s)
        interval_s = np.where(
            rng.random(rows) < 0.02,
            rng.uniform(2.0, 6.0, rows),
            rng.uniform(0.3, 1.1, rows),
        )
        time_s = np.round(np.cumsum(interval_s), 3)
        time_s = time_s[time_s <= duration_s]
    if "gaps" in faults:
        kept = np.ones(len(time_s), bool)
        for _ in range(int(rng.integers(2, 4))):
            from_s = rng.uniform(0.1, 0.85) * duration_s
            kept &= (time_s < from_s) | (time_s > from_s + rng.uniform(60.0, 600.0))
        time_s = time_s[kept]
    return np.asarray(time_s)


def spoil(values: FloatArray, faults: tuple[str, ...], rng: np.random.Generator) -> FloatArray:
    """The sensors' columns (n, 5) with one of them stuck, or silent for a while."""
    values = values.copy()
    n = len(values)
    if "stuck" in faults:
        from_row = int(rng.uniform(0.3, 0.7) * n)
        sensor = int(rng.integers(5))
        values[from_row:, sensor] = values[from_row, sensor]
    if "missing" in faults:
        from_row, rows = int(rng.uniform(0.2, 0.6) * n), int(rng.uniform(0.1, 0.3) * n)
        values[from_row : from_row + rows, int(rng.integers(5))] = np.nan
    return values
