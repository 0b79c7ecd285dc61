"""The goals of the campaign, frozen on 28 November 2026, before the judged machines were drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

DEVELOPMENT, JUDGED = (*range(1, 7), *range(101, 125), *range(301, 325)), range(401, 425)
"""Machines to develop with, and those that count: 24, half of them horizontal."""
LONG = (401, 402)
"""Of the judged machines those that also work a whole day."""
HOURS, DAY_HOURS = 1.0, 8.0
MONTH_H = 720.0
Row = Mapping[str, str]


class Promise(NamedTuple):
    """One goal: its words, its figure from the rows, and the largest figure allowed, or the least."""

    words: str
    figure: Callable[[Sequence[Row]], float]
    limit: float
    least: bool = False

    @property
    def goal(self) -> str:
        """The limit in words."""
        return f"{'≥' if self.least else '≤'} {self.limit:g}"

    def met(self, rows: Sequence[Row]) -> bool:
        """Return whether the rows reach the goal; NaN does not."""
        value = self.figure(rows)
        return value >= self.limit if self.least else value <= self.limit


def total(rows: Sequence[Row], column: str) -> float:
    """Return the sum of a column; empty cells count nothing."""
    return sum(float(row[column]) for row in rows if row[column])


def share(rows: Sequence[Row], column: str, of: str) -> float:
    """Return a column's sum relative to another's, in percent; NaN of nothing."""
    whole = total(rows, of)
    return 100.0 * total(rows, column) / whole if whole else float("nan")


def worst(rows: Sequence[Row], column: str) -> float:
    """Return the largest of a column; infinite where a cell is empty."""
    return max(float(row[column]) if row[column] else float("inf") for row in rows)


def wideness(rows: Sequence[Row]) -> float:
    """Return the mean σ of the good thermal error over its rms error, at the far end of travel."""
    squares_um2, good = total(rows, "squares_um2"), total(rows, "good")
    return (
        float(total(rows, "sigmas_um") / good / (squares_um2 / good) ** 0.5) if squares_um2 else float("nan")
    )


def bound_width(rows: Sequence[Row]) -> float:
    """Return the mean published bound over the mean 95 % half width of the same steps; 0 where none is."""
    half_um = total(rows, "bounded_half_um")
    return total(rows, "bounds_um") / half_um if half_um else 0.0


def monthly(rows: Sequence[Row], column: str) -> float:
    """Return how often something happened in 720 h."""
    return total(rows, column) / total(rows, "hours") * MONTH_H


PROMISES = (
    Promise(
        "error first good after a cold start, s, slowest machine", lambda r: worst(r, "first_good_s"), 300.0
    ),
    Promise("machines whose very first estimate is good", lambda r: total(r, "good_at_once"), 0.0),
    Promise("steps after it whose error is good, %", lambda r: share(r, "good", "steps"), 95.0, least=True),
    Promise(
        "good steps with an error beyond 3 σ anywhere, %", lambda r: share(r, "beyond_3_sigma", "good"), 1.0
    ),
    Promise("mean σ of the error over its rms", wideness, 3.0),
    Promise("published bound over the 95 % half width", bound_width, 3.0),
    Promise("false jumps of the nut a month", lambda r: monthly(r, "jumps"), 0.0),
    Promise("false exclusions a month", lambda r: monthly(r, "exclusions"), 1.0),
    Promise("machines that cannot be armed with the defaults", lambda r: total(r, "not_armed"), 0.0),
)
