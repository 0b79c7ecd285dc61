"""The search for sets of sensors on the front of cost and score; the score is the remaining uncertainty.

All sets are tried if they are few. Otherwise the search tries all sets that differ by one sensor from a set
on the front, until no step extends the front (Pareto local search: Paquete, Chiarandini and Stützle 2004).
With equal costs this adds the best sensor each time, and exchanges one for another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from observer.estimators.design.spread import SensorSet
from observer.frames import FloatArray

MOST_SETS = 800
"""Up to this number all sets are tried, in about a quarter of a minute."""
MOST_TRIED = 4000
"""A search by steps ends after this number of sets."""
_DIGITS = 6
"""Scores that agree to so many digits are the same, as at the two ends of a symmetric screw."""

Score = Callable[[Sequence[SensorSet]], FloatArray]
"""From sets (v) to their scores (v,), the smaller the better."""


class Front(NamedTuple):
    """The sets on the front of cost and score.

    Attributes:
        sets: Sets that no other tried set beats in both, the cheapest first.
        exhaustive: Whether all permitted sets were tried.
        tried: Number of sets tried.
    """

    sets: tuple[SensorSet, ...]
    exhaustive: bool
    tried: int


class SetLimits(NamedTuple):
    """Limits of a set of sensors, each given by its number 0 … n-1.

    Attributes:
        costs: Costs of all sensors, (n,), in any unit.
        free: Sensors that may be chosen.
        most: Largest number of added sensors.
        budget: Largest cost of added sensors, in the unit of `costs`.
        required: Sensors that every set contains, at no cost.
        one_of: Sensors of which every set contains at least one.
    """

    costs: FloatArray
    free: tuple[int, ...]
    most: int
    budget: float
    required: SensorSet
    one_of: frozenset[int]

    def cost(self, sensors: SensorSet) -> float:
        """Return the cost of a set without the required sensors."""
        return float(sum(self.costs[i] for i in sensors if i not in self.required))

    def allow(self, sensors: SensorSet) -> bool:
        """Return whether a set is within all limits."""
        fits = len(sensors) <= self.most + len(self.required) and not self.one_of.isdisjoint(sensors)
        return fits and self.affords(sensors)

    def affords(self, sensors: SensorSet) -> bool:
        """Return whether a set is within the budget; a relative excess of 1e-9 is rounding."""
        return self.cost(sensors) <= self.budget * (1 + 1e-9)


def best_sets(score: Score, limits: SetLimits) -> Front:
    """Return the front of sets within limits.

    Scores that agree to six digits of their logarithm count as equal, and the cheaper or smaller set wins.

    Args:
        score: Returns the scores (v,) of v sets, positive, the smaller the better. It is called with many
            sets at once.
        limits: The permitted sets.

    Returns:
        The front. It is not exhaustive where more than `MOST_SETS` sets are possible.
    """
    tried: dict[SensorSet, float] = {}

    def attempt(sets: Iterator[SensorSet]) -> None:
        new = [sensors for sensors in dict.fromkeys(sets) if sensors not in tried and limits.allow(sensors)]
        if new:
            tried.update(zip(new, np.round(np.log(score(new)), _DIGITS).tolist(), strict=True))

    additions = _all_additions(limits)
    if additions is not None:
        attempt(_with(limits.required, extra) for extra in additions)
    else:
        attempt(iter([limits.required]))
        attempt(_neighbours(limits.required, limits))
        left: set[SensorSet] = set()
        while len(tried) < MOST_TRIED and (new := [s for s in _front(tried, limits) if s not in left]):
            left.add(new[0])  # the cheapest first, for what it leads to may replace the others
            attempt(_neighbours(new[0], limits))
    return Front(_front(tried, limits), additions is not None, len(tried))


def _all_additions(limits: SetLimits) -> list[SensorSet] | None:
    """Return all additions within number and budget, the smallest first; None if they are too many to try."""
    layer: list[SensorSet] = [()]
    additions = list(layer)
    for _ in range(min(limits.most, len(limits.free))):
        wider = ((*s, i) for s in layer for i in limits.free if not s or i > s[-1])
        layer = [s for s in wider if limits.affords(s)]
        additions += layer
        if len(additions) > MOST_SETS:
            return None
    return additions


def _neighbours(chosen: SensorSet, limits: SetLimits) -> Iterator[SensorSet]:
    """Yield the sets with one sensor more, one less, or one exchanged for another."""
    candidates = [i for i in limits.free if i not in chosen]
    yield from (_with(chosen, (i,)) for i in candidates)
    for out in chosen:
        if out not in limits.required:
            reduced = tuple(j for j in chosen if j != out)
            yield reduced
            yield from (_with(reduced, (i,)) for i in candidates)


def _with(sensors: SensorSet, extra: Sequence[int]) -> SensorSet:
    return tuple(sorted((*sensors, *extra)))


def _front(tried: dict[SensorSet, float], limits: SetLimits) -> tuple[SensorSet, ...]:
    front: list[SensorSet] = []
    for sensors in sorted(tried, key=lambda s: (limits.cost(s), tried[s], len(s), s)):
        if not front or tried[sensors] < tried[front[-1]]:
            front.append(sensors)
    return tuple(front)
