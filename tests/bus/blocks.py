"""Estimates for the tests of publishing."""

import numpy as np

from observer.frames import EstimateBlock, Layout

LAYOUT = Layout(
    ("nut", "left_bearing"), np.array([0.0, 0.0125, 1 / 3]), ("t1", "t2"), True, ("sensor.t1.offset_K",)
)


def block(
    time_s: float = 1.8e9, *, seed: int = 0, quality: int = 0, layout: Layout = LAYOUT
) -> EstimateBlock:
    rng = np.random.default_rng(seed)
    m, g, s = len(layout.sources), len(layout.position_m), len(layout.sensors)
    e, learnt = g if layout.has_error else 0, len(layout.learned)
    return EstimateBlock(
        np.array([time_s]), rng.normal(50, 9, (1, m)), rng.uniform(1, 2, (1, m)), rng.normal(30, 3, (1, g)),
        rng.uniform(0, 1, (1, g)), rng.normal(5, 1, (1, e)), rng.uniform(0, 1, (1, e)),
        rng.normal(0, 0.1, (1, s)), np.zeros((1, s), np.int8), np.array([quality], np.int8),
        rng.uniform(0.05, 0.1, (1, s)), rng.normal(50, 9, (1, m)), rng.normal(0, 0.3, (1, learnt)),
        rng.uniform(0.1, 0.3, (1, learnt)), rng.uniform(3, 6, (1, m)), rng.uniform(1, 3, (1, g)),
        rng.uniform(1, 3, (1, e)),
    )  # fmt: skip
