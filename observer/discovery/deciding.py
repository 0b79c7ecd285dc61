"""Which test would decide a doubtful answer: the answers it has to separate, and the cycle that does."""

from __future__ import annotations

from collections.abc import Sequence

from observer.config import Config
from observer.discovery.experiment import SEPARATES, Experiment, propose
from observer.discovery.search import FittedCandidate, Search
from observer.discovery.verdict import Partial, Verdict, proposable
from observer.discovery.workers import IN_PROCESS, WorkerPool
from observer.fit.hypothesis import Fit
from observer.fit.problem import Problem

MOST_ASKED = 5
"""Effects not identifiable from the logs for which a test is sought."""


def decisive_test(
    problem: Problem,
    search: Search,
    verdict: Verdict,
    with_one_less: Sequence[tuple[str, Fit]] = (),
    partial: Partial | None = None,
    pool: WorkerPool = IN_PROCESS,
) -> Experiment | None:
    """Return the test that would separate the answers, where there are several; none where logs are in doubt.

    `with_one_less`: each chosen effect with the fit of the others alone; `partial`: the effect that explains
    most of an unknown.
    """
    if verdict.suspected:
        return None
    if verdict.kind == "ambiguous":
        return propose(problem, [fit.config for fit in verdict.fits], pool)
    if verdict.kind == "not_identifiable":
        return _that_shows(problem, search, pool)
    if verdict.unproved:
        without = [fit.config for name, fit in with_one_less if name in verdict.unproved]
        return propose(problem, [search.fit.config, *without], pool)
    if verdict.kind == "unknown" and partial is not None:
        answers = [search.null.config, partial.trial.fit.config, *_next_best(proposable(search), partial)]
        return propose(problem, answers, pool)
    return None


def _that_shows(problem: Problem, search: Search, pool: WorkerPool) -> Experiment | None:
    """The first test that shows an effect to which the logs are blind."""
    config = search.fit.config
    for unseen in search.blind[:MOST_ASKED]:
        effects = (*config.effect, unseen.effect(unseen.shapes[0]))
        test = propose(problem, [config, config.model_copy(update={"effect": effects})], pool)
        if test.separation_sigma >= SEPARATES:
            return test
    return None


def _next_best(trials: Sequence[FittedCandidate], partial: Partial) -> list[Config]:
    """The effect that explains most of an unknown after the one that does, and after those of its family."""
    tied = () if partial.tie is None else partial.tie.members
    same = {partial.trial.candidate.name, *(member.name for member in tied)}
    others = [t for t in trials if t.candidate.name not in same]
    return [max(others, key=lambda t: t.drop).fit.config] if others else []
