"""The verdict of a search: named, none, unknown, ambiguous, or not identifiable, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from observer.discovery.candidates import Candidate
from observer.discovery.proof import Proof
from observer.discovery.search import Search, form_of, same_physics
from observer.fit.hypothesis import Fit

Kind = Literal["named", "none", "unknown", "ambiguous", "not_identifiable"]

UNFIT = 0.12
"""Mean squared whitened error beyond that of noise, from which on something is left unexplained."""
PROOF_UNFIT = 0.3
"""The same on data held back, which the parameters were not fitted to."""
WITHIN_REACH = 9.0
"""A rival whose score is no further below the winner's cannot be told from it: three standard deviations."""
WITHIN_SHARE, WITHIN_UNFIT = 0.02, 4.0
"""The same as a part of the winner's own drop, for its form may be a little wrong, but at most so many times
what it leaves unexplained beyond noise: it owes no more of its lead to that.
"""


@dataclass(frozen=True)
class Verdict:
    """What a search comes to.

    `fit` is what may be written back, or what remains to be explained; `sets` the sets of effects that
    explain the logs equally well, the best first, and `fits` their fits; `remains` where an error is left
    that nothing explains; `lacking` what the logs do not hold, a clause for each; `suspected` what is wrong
    with the logs, a sentence for each without its full stop, where nothing is claimed because of it, or was.
    """

    kind: Kind
    fit: Fit
    sets: tuple[tuple[Candidate, ...], ...] = ()
    fits: tuple[Fit, ...] = ()
    remains: Literal["in what was fitted", "on data held back"] | None = None
    lacking: tuple[str, ...] = ()
    suspected: tuple[str, ...] = ()

    @property
    def reason(self) -> str:
        """Why, in a sentence without its full stop."""
        if self.suspected:
            nothing = "no effect is missing that shows, but " if self.kind == "none" else ""
            return f"{nothing}the logs themselves are in doubt: {'; '.join(self.suspected)}"
        names = [" and ".join(c.name for c in each) for each in self.sets]
        return {
            "named": f"missing: {''.join(names[:1])}",
            "none": "the calibrated model explains the logs; nothing is missing that shows",
            "unknown": f"an error remains {self.remains} that no effect of the library, nor three together, "
            "explains",
            "ambiguous": f"these logs cannot tell {' from '.join(names)}",
            "not_identifiable": f"nothing is missing that shows, but {'; '.join(self.lacking)}",
        }[self.kind]


def decide(search: Search, proof: Proof, lacking: Sequence[str]) -> Verdict:
    """Weigh a search; `lacking` says what the logs do not hold."""
    fit = search.fit
    form = form_of([t.candidate for t in search.chosen]) * (goodness(search.null) - goodness(fit))
    noise = proof.expected
    if goodness(fit) > noise + UNFIT + form:
        return Verdict("unknown", fit, remains="in what was fitted")
    unproved = proof.worse or proof.grown or proof.grown_on or proof.unproved
    if proof.whole.after > noise + PROOF_UNFIT + 2 * form or unproved:
        return Verdict("unknown", fit, remains="on data held back")
    if not search.chosen:
        return Verdict("not_identifiable" if lacking else "none", fit, lacking=tuple(lacking))
    sets, fits = alternatives(search, noise)
    return Verdict("ambiguous" if len(sets) > 1 else "named", fit, sets, fits)


def under_suspicion(verdict: Verdict, suspected: Sequence[str]) -> Verdict:
    """Take back what a verdict claims where the logs explain it: an effect, or of *none* that the model
    explains them.
    """
    if not suspected or verdict.kind == "not_identifiable":
        return verdict
    if verdict.kind == "none":
        return replace(verdict, suspected=tuple(suspected))
    return replace(verdict, kind="unknown", sets=(), fits=(), suspected=tuple(suspected))


def goodness(fit: Fit) -> float:
    """The mean squared whitened error of what was used, tolerances marginalised; a quarter is usual."""
    return fit.deviance / max(len(fit.remainder), 1)


def alternatives(search: Search, noise: float) -> tuple[tuple[tuple[Candidate, ...], ...], tuple[Fit, ...]]:
    """The sets of effects within reach of each other, and their fits: the chosen one, and it with one effect
    exchanged. `noise` is the mean squared whitened error that noise alone makes.
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
