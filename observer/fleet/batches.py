"""Work in portions that are worth being sent to another process, each by one configuration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from observer.fleet.orders import Order

MOST_ORDERS = 32
MOST_BYTES = 16_000_000
"""Of the logs in a portion: so much takes seconds, which is long beside what sending it costs."""
PORTIONS_PER_WORKER = 4
"""At least, so that the last one to end keeps the others waiting for a quarter of their time at most."""


def batches(orders: Sequence[Order], workers: int) -> list[tuple[Order, ...]]:
    """Put work of the same configuration together: what is built for one log then serves the next.

    Work on all logs of a machine is a portion of its own. The largest portions come first.
    """
    by_config: dict[Path, list[Order]] = {}
    for order in orders:
        by_config.setdefault(order.config, []).append(order)
    most = min(MOST_ORDERS, max(1, math.ceil(len(orders) / (PORTIONS_PER_WORKER * workers))))
    found: list[tuple[int, tuple[Order, ...]]] = []
    for own in by_config.values():
        portion: list[Order] = []
        total = 0
        for order in own:
            size = bytes_of(order)
            single = len(order.logs) > 1
            if portion and (len(portion) >= most or total + size > MOST_BYTES or single):
                found.append((total, tuple(portion)))
                portion, total = [], 0
            portion.append(order)
            total += size
        found.append((total, tuple(portion)))
    found.sort(key=lambda entry: -entry[0])
    return [portion for _, portion in found]


def bytes_of(order: Order) -> int:
    """How large the logs are; nothing for those that are not there."""
    return sum(log.stat().st_size for log in order.logs if log.is_file())
