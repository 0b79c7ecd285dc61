"""Times of several pieces of work, taken in turn so that all see the same machine."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping


def medians_s(works: Mapping[str, Callable[[], object]], repetitions: int = 7) -> dict[str, float]:
    """Median seconds of each piece of work; each runs once unmeasured, then all in rotation."""
    for work in works.values():
        work()
    taken: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(repetitions):
        for name, work in works.items():
            start = time.perf_counter()
            work()
            taken[name].append(time.perf_counter() - start)
    return {name: statistics.median(times) for name, times in taken.items()}


def shown(seconds: float) -> str:
    """Seconds in the unit a reader expects."""
    for factor, unit in ((1.0, "s"), (1e3, "ms")):
        if seconds * factor >= 1.0:
            return f"{seconds * factor:.3g} {unit}"
    return f"{seconds * 1e6:.3g} µs"
