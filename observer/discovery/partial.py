"""What of the unknown an effect explains: the one that explains most, how much of it, and what remains.

Only effects the interval of whose strength leaves out nothing at all are told.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.discovery.family import Member, Tie, tie_of
from observer.discovery.localise import localised
from observer.discovery.search import Search, Trial
from observer.discovery.verdict import WITHIN_REACH, WITHIN_SHARE
from observer.frames import FloatArray


@dataclass(frozen=True)
class Partial:
    """The effect that alone explains most of the fitted logs.

    `share`: the part of the misfit that goes with it. `remains_rms_K`: what it leaves, as measured and
    `beyond_tolerances_rms_K`; `most_on`: the sensor with most of that, and the `phase` in which it has
    most, where any is long enough to tell.
    `tie`: the effects that explain as much, itself first, where they are one family.
    """

    trial: Trial
    share: float
    remains_rms_K: float
    beyond_tolerances_rms_K: float
    most_on: str
    phase: str | None
    tie: Tie | None


def partial_of(search: Search) -> Partial | None:
    """Return what an effect explains of what is left of the null hypothesis; None where none does any."""
    trials = [t for t in search.ranking if t.drop > 0.0 and t.there]
    if not trials:
        return None
    best = max(trials, key=lambda t: t.drop)
    problem, used = best.fit.problem, best.fit.problem.evidence.used
    left_K = problem.evidence.measured_degC - problem.predicted(best.fit.config)
    of_sensor = {
        s.name: _rms(left_K[used & (problem.evidence.sensor == i)])
        for i, s in enumerate(problem.config.sensor)
    }
    worst = max(of_sensor, key=lambda name: of_sensor[name])
    phases = [place.phase for place in localised(best.fit, used) if place.sensor == worst]
    return Partial(
        trial=best,
        share=best.drop / search.null.deviance,
        remains_rms_K=_rms(left_K[used]),
        beyond_tolerances_rms_K=_rms((left_K - best.fit.within_tolerances_K)[used]),
        most_on=worst,
        phase=phases[0] if phases else None,
        tie=_alike(best, trials),
    )


def _alike(best: Trial, trials: list[Trial]) -> Tie | None:
    """The best and all that explain as much, where they are one family."""
    reach = max(WITHIN_REACH, WITHIN_SHARE * best.drop)
    near = [t for t in trials if best.drop - t.drop <= reach and not t.fit.at_bound]
    if best not in near:
        return None
    tie = tie_of([Member.of(t.candidate, t.fit) for t in near])
    alone = len(near) == 1 and tie is not None and tie.family is not None and tie.family.against == "own"
    return None if alone else tie


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
