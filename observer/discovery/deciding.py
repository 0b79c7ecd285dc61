"""The test that would decide a doubtful answer: the answers to separate, and the cycle that separates
them.
"""

from __future__ import annotations

from collections.abc import Sequence

from observer.config.machine import Config
from observer.discovery.experiment import SEPARATES, Experiment, propose
from observer.discovery.search import FittedCandidate, Search
from observer.discovery.verdict import Partial, Verdict, proposable
from observer.discovery.workers import IN_PROCESS, WorkerPool
from observer.fit.hypothesis import Fit

MOST_ASKED = 5
"""Effects not identifiable from the logs for which a test is sought."""


def decisive_test(
    search: Search,
    verdict: Verdict,
    with_one_less: Sequence[tuple[str, Fit]] = (),
    partial: Partial | None = None,
    pool: WorkerPool = IN_PROCESS,
) -> Experiment | None:
    """Return the test that would separate several answers.

    Args:
        search: Result of the search.
        verdict: Its verdict.
        with_one_less: Each chosen effect with the fit of the others alone.
        partial: The effect that explains most of an unknown, or None.
        pool: Where predictions run.

    Returns:
        The test. None if there is one answer, or if the logs are in doubt.
    """
    if verdict.suspected:
        return None
    problem = search.null.problem
    if verdict.kind == "ambiguous":
        return propose(problem, [fit.config for fit in verdict.fits], pool)
    if verdict.kind == "not_identifiable":
        return _that_shows(search, pool)
    if verdict.unproved:
        without = [fit.config for name, fit in with_one_less if name in verdict.unproved]
        return propose(problem, [search.fit.config, *without], pool)
    if verdict.kind == "unknown" and partial is not None:
        answers = [search.null.config, partial.trial.fit.config, *_next_best(proposable(search), partial)]
        return propose(problem, answers, pool)
    return None


def _that_shows(search: Search, pool: WorkerPool) -> Experiment | None:
    """Return the first test that shows an effect which these logs cannot show; None if no test does."""
    config = search.fit.config
    for unseen in search.blind[:MOST_ASKED]:
        effects = (*config.effect, unseen.effect(unseen.shapes[0]))
        test = propose(search.null.problem, [config, config.model_copy(update={"effect": effects})], pool)
        if test.separation_sigma >= SEPARATES:
            return test
    return None


def _next_best(trials: Sequence[FittedCandidate], partial: Partial) -> list[Config]:
    """Return the effect that explains most of an unknown after the best one and its family, as a list of
    at most one.
    """
    tied = () if partial.tie is None else partial.tie.members
    same = {partial.trial.candidate.name, *(member.name for member in tied)}
    others = [t for t in trials if t.candidate.name not in same]
    return [max(others, key=lambda t: t.drop).fit.config] if others else []
