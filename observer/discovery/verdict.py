"""The verdict of a search: named, none, unknown, ambiguous, or not identifiable, with the reason.

For *unknown* it includes the effect that explains most, its share, and the remaining error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from observer.discovery.candidates import Candidate
from observer.discovery.family import Member, Tie, tie_of
from observer.discovery.localise import localised
from observer.discovery.proof import FALLS, Proof, rms
from observer.discovery.search import FittedCandidate, Search, form_of, same_physics
from observer.discovery.worth import Worth, worth_of
from observer.fit.hypothesis import Fit

VerdictKind = Literal["named", "none", "unknown", "ambiguous", "not_identifiable"]

UNFIT = 0.12
"""Mean squared whitened error beyond that of noise at which something is left unexplained."""
PROOF_UNFIT = 0.3
"""The same on held-out data, to which the parameters were not fitted."""
WITHIN_REACH = 9.0
"""A rival whose score is within this of the winner's cannot be distinguished from it: three standard
deviations.
"""
UNLIKELY = 3.0
"""Standard deviations of a tolerance that are worth a word."""
WITHIN_SHARE, WITHIN_UNFIT = 0.02, 4.0
"""The same as a part of the winner's own drop, since its form may be slightly wrong, but at most so many
times what it leaves unexplained beyond noise.
"""


@dataclass(frozen=True)
class Verdict:
    """The conclusion of a search.

    Attributes:
        kind: The verdict.
        fit: The fit to write back, or the one that leaves an error unexplained.
        sets: Sets of effects that explain the logs equally well, the best first; empty unless named or
            ambiguous.
        fits: Their fits.
        remains: Where an unexplained error is left; None for other verdicts.
        unproved: Effects that explain the fitted data but do not prove themselves.
        stretch: σ of tolerances that would explain as much as these.
        lacking: Excitation that the logs lack, a clause for each.
        suspected: Faults of the logs that withdraw or qualify the verdict, sentences without full stop.
    """

    kind: VerdictKind
    fit: Fit
    sets: tuple[tuple[Candidate, ...], ...] = ()
    fits: tuple[Fit, ...] = ()
    remains: Literal["in what was fitted", "on data held back"] | None = None
    unproved: tuple[str, ...] = ()
    stretch: float = 0.0
    lacking: tuple[str, ...] = ()
    suspected: tuple[str, ...] = ()

    @property
    def reason(self) -> str:
        """The reason, as a sentence without its full stop."""
        if self.suspected:
            prefix = "no missing effect is found, but " if self.kind == "none" else ""
            return f"{prefix}the logs themselves are in doubt: {'; '.join(self.suspected)}"
        if self.unproved:
            return (
                f"{' and '.join(self.unproved)} would explain what was fitted, but on data held back the gap "
                f"beyond tolerances does not fall by {100 * FALLS:.0f} % and more than noise with it"
            ) + self._other
        names = [" and ".join(c.name for c in candidates) for candidates in self.sets]
        return {
            "named": f"missing: {''.join(names[:1])}",
            "none": "the calibrated model explains the logs; no missing effect is found",
            "unknown": f"an error remains {self.remains} that no effect of the library, nor three of them "
            "together, explains",
            "ambiguous": f"these logs cannot distinguish {' from '.join(names)}",
            "not_identifiable": f"no missing effect is found, but {'; '.join(self.lacking)}",
        }[self.kind]

    @property
    def _other(self) -> str:
        """A clause about unlikely tolerances that would explain the logs equally well; empty if they are
        likely.
        """
        if self.stretch < UNLIKELY:
            return ""
        return f": tolerances of which one is off by {self.stretch:.0f} standard deviations leave as little"


def decide(search: Search, proof: Proof, lacking: Sequence[str]) -> Verdict:
    """Return the verdict on a search.

    Limits are mean squared whitened errors beyond that of noise, enlarged by the form error of the chosen
    effects.

    Args:
        search: The search.
        proof: Its error on held-out data.
        lacking: Excitation that the logs lack; with any, *none* becomes *not identifiable*.
    """
    fit = search.fit
    form = form_of([t.candidate for t in search.chosen]) * (goodness(search.null) - goodness(fit))
    noise = proof.expected
    if goodness(fit) > noise + UNFIT + form:
        return Verdict("unknown", fit, remains="in what was fitted")
    if proof.whole.after > noise + PROOF_UNFIT + 2 * form or proof.worse or proof.grown_on:
        return Verdict("unknown", fit, remains="on data held back")
    if proof.unproved:
        return Verdict("unknown", fit, unproved=proof.unproved, stretch=proof.stretch)
    if not search.chosen:
        return Verdict("not_identifiable" if lacking else "none", fit, lacking=tuple(lacking))
    sets, fits = alternatives(search, noise)
    return Verdict("ambiguous" if len(sets) > 1 else "named", fit, sets, fits)


def under_suspicion(verdict: Verdict, suspected: Sequence[str]) -> Verdict:
    """Return the verdict withdrawn if a fault of the logs explains them.

    A named effect becomes *unknown*. A verdict of *none* stays and lists the faults. *Not identifiable* stays
    as it is.

    Args:
        verdict: The verdict on the search.
        suspected: Faults of the logs as sentences without full stop; without any nothing changes.
    """
    if not suspected or verdict.kind == "not_identifiable":
        return verdict
    if verdict.kind == "none":
        return replace(verdict, suspected=tuple(suspected))
    return replace(verdict, kind="unknown", sets=(), fits=(), suspected=tuple(suspected))


def goodness(fit: Fit) -> float:
    """Return the mean squared whitened error of the used rows, tolerances marginalised.

    A quarter is usual, because the whitening includes the form error of a model.
    """
    return fit.deviance / max(len(fit.remainder), 1)


def alternatives(search: Search, noise: float) -> tuple[tuple[tuple[Candidate, ...], ...], tuple[Fit, ...]]:
    """Return the sets of effects that cannot be distinguished, and their fits, the chosen set first.

    The others have one effect exchanged for a rival of nearly the same score.

    Args:
        search: The search.
        noise: Mean squared whitened error of noise alone.
    """
    chosen = tuple(t.candidate for t in search.chosen)
    sets, fits = [chosen], [search.fit]
    unfit = max(goodness(search.fit) - noise, 0.0) * len(search.fit.remainder)
    for i, (winner, *trials) in enumerate(search.rivals):
        reach = max(WITHIN_REACH, min(WITHIN_SHARE * winner.drop, WITHIN_UNFIT * unfit))
        for rival in trials:
            near = winner.score - rival.score <= reach and rival.accepted
            if near and not same_physics(winner, rival):
                sets.append(tuple(rival.candidate if j == i else c for j, c in enumerate(chosen)))
                fits.append(rival.fit)
    return tuple(sets), tuple(fits)


@dataclass(frozen=True)
class Partial:
    """The effect that alone explains most of the fitted logs; its strength differs significantly from zero.

    Attributes:
        trial: The effect with its fit.
        share: Fraction of the misfit that it explains.
        remains_rms_K: Remaining error, K.
        beyond_tolerances_rms_K: The same beyond tolerances, K.
        most_on: Sensor with the largest remaining error.
        phase: Phase in which that is largest, None if none is long enough.
        tie: Effects that explain as much, itself first, if they form one family.
        log: Run in which that is largest, from 0.
        proof_K: Error on the proof, before and after, K.
        worth: Gain in thermal error on the proof, None without an expansion coefficient.
    """

    trial: FittedCandidate
    share: float
    remains_rms_K: float
    beyond_tolerances_rms_K: float
    most_on: str
    phase: str | None
    tie: Tie | None
    log: int
    proof_K: tuple[float, float]
    worth: Worth | None


def proposable(search: Search) -> list[FittedCandidate]:
    """Return the trials of the first round that are significant and possible on this machine."""
    config = search.null.problem.config
    trials = (t for t in search.ranking if t.drop > 0.0 and t.significant)
    return [t for t in trials if t.candidate.of.can_exist(config)]


def partial_of(search: Search) -> Partial | None:
    """Return the effect that explains most of the null hypothesis's misfit.

    Args:
        search: The search, of which the first round counts.

    Returns:
        The effect, or None if no trial is significant and possible.
    """
    trials = proposable(search)
    if not trials:
        return None
    best = max(trials, key=lambda t: t.drop)
    problem, used = best.fit.problem, best.fit.problem.evidence.used
    left_K = problem.error_K(best.fit.config)
    of_sensor = {
        s.name: rms(left_K[used & (problem.evidence.sensor == i)])
        for i, s in enumerate(problem.config.sensor)
    }
    worst = max(of_sensor, key=lambda name: of_sensor[name])
    phases = [place.phase for place in localised(best.fit) if place.sensor == worst]
    of_worst = used & (problem.evidence.sensor == [s.name for s in problem.config.sensor].index(worst))
    of_run = {
        int(r): rms(left_K[of_worst & (problem.evidence.run == r)])
        for r in set(problem.evidence.run[of_worst])
    }
    before_K, proof = problem.error_K(search.null.config), problem.evidence.proof
    return Partial(
        trial=best,
        share=best.drop / search.null.deviance,
        remains_rms_K=rms(left_K[used]),
        beyond_tolerances_rms_K=rms((left_K - best.fit.within_tolerances_K())[used]),
        most_on=worst,
        phase=phases[0] if phases else None,
        tie=_alike(best, trials),
        log=max(of_run, key=lambda run: of_run[run]),
        proof_K=(rms(before_K[proof]), rms(left_K[proof])),
        worth=worth_of(problem, search.null.config, best.fit.config),
    )


def _alike(best: FittedCandidate, trials: list[FittedCandidate]) -> Tie | None:
    """Return the best trial and all that explain as much, if they form one family; else None."""
    reach = max(WITHIN_REACH, WITHIN_SHARE * best.drop)
    near = [t for t in trials if best.drop - t.drop <= reach and not t.fit.at_bound]
    if best not in near:
        return None
    tie = tie_of([Member.of(t.candidate, t.fit) for t in near])
    is_single = len(near) == 1 and tie is not None and tie.family is not None and tie.family.against == "own"
    return None if is_single else tie
