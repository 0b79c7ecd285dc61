"""The search for sets of sensors: which are worth their cost, by a score that sums up what remains unknown.

All sets, where there are few; else those that differ by one sensor from one that is worth its cost so far,
until no such step leads to a further one (Pareto local search: Paquete, Chiarandini and Stützle 2004). Where
all sensors cost the same that is the best sensor more each time, with exchanges of one for another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from observer.estimators.design.sensor_sets import SensorSet
from observer.frames import FloatArray

MOST_SETS = 800
"""So many sets are all tried: about a quarter of a minute."""
MOST_TRIED = 4000
"""After so many a search by steps ends."""
_DIGITS = 6
"""Scores that agree to so many digits are the same, as at the two ends of a symmetric screw."""

Score = Callable[[Sequence[SensorSet]], FloatArray]
"""From sets (v) to their scores (v,), the smaller the better."""


class Front(NamedTuple):
    """The sets of which none is both cheaper and better, the cheapest first; whether all sets were tried, and
    how many were.
    """

    sets: tuple[SensorSet, ...]
    exhaustive: bool
    tried: int


class SetLimits(NamedTuple):
    """What a set may be: the `costs` (n,) of all sensors, those that are `free` to be chosen, the `most` of
    them that may be added to those that are `kept` in every set, the `budget` for all that is added, and the
    sensors of which every set has one at least.
    """

    costs: FloatArray
    free: tuple[int, ...]
    most: int
    budget: float
    kept: SensorSet
    one_of: frozenset[int]

    def cost(self, sensors: SensorSet) -> float:
        """What a set costs beside what is kept."""
        return float(sum(self.costs[i] for i in sensors if i not in self.kept))

    def allow(self, sensors: SensorSet) -> bool:
        """Whether a set has what it needs, and is small and cheap enough."""
        fits = len(sensors) <= self.most + len(self.kept) and not self.one_of.isdisjoint(sensors)
        return fits and self.affords(sensors)

    def affords(self, sensors: SensorSet) -> bool:
        """Whether a set is within the budget."""
        return self.cost(sensors) <= self.budget * (1 + 1e-9)


def best_sets(score: Score, limits: SetLimits) -> Front:
    """Return the front of sets within limits."""
    tried: dict[SensorSet, float] = {}

    def attempt(sets: Iterator[SensorSet]) -> None:
        new = [each for each in dict.fromkeys(sets) if each not in tried and limits.allow(each)]
        if new:
            tried.update(zip(new, np.round(np.log(score(new)), _DIGITS).tolist(), strict=True))

    every = _every(limits)
    if every is not None:
        attempt(_with(limits.kept, more) for more in every)
    else:
        attempt(iter([limits.kept]))
        attempt(_beside(limits.kept, limits))
        left: set[SensorSet] = set()
        while len(tried) < MOST_TRIED and (new := [s for s in _front(tried, limits) if s not in left]):
            left.add(new[0])  # the cheapest first, for what it leads to may replace the others
            attempt(_beside(new[0], limits))
    return Front(_front(tried, limits), every is not None, len(tried))


def _every(limits: SetLimits) -> list[SensorSet] | None:
    """All that may be added within number and budget, the fewest first; None if that is too many to try."""
    layer: list[SensorSet] = [()]
    found = list(layer)
    for _ in range(min(limits.most, len(limits.free))):
        wider = ((*s, i) for s in layer for i in limits.free if not s or i > s[-1])
        layer = [s for s in wider if limits.affords(s)]
        found += layer
        if len(found) > MOST_SETS:
            return None
    return found


def _beside(chosen: SensorSet, limits: SetLimits) -> Iterator[SensorSet]:
    """The sets with one sensor more, one less, or one exchanged for another."""
    more = [i for i in limits.free if i not in chosen]
    yield from (_with(chosen, (i,)) for i in more)
    for out in chosen:
        if out not in limits.kept:
            rest = tuple(j for j in chosen if j != out)
            yield rest
            yield from (_with(rest, (i,)) for i in more)


def _with(sensors: SensorSet, more: Sequence[int]) -> SensorSet:
    return tuple(sorted((*sensors, *more)))


def _front(tried: dict[SensorSet, float], limits: SetLimits) -> tuple[SensorSet, ...]:
    front: list[SensorSet] = []
    for each in sorted(tried, key=lambda s: (limits.cost(s), tried[s], len(s), s)):
        if not front or tried[each] < tried[front[-1]]:
            front.append(each)
    return tuple(front)
