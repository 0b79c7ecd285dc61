"""Find what physical effect a model lacks, and prove on data held back that adding it closes the gap.

The order of work: calibrate within every hypothesis, search, ask whether the logs rather than the model are
at fault, open the proof once, decide, and where the answer is a doubt say what characterises it: the event
that remains, or the test that would tell. Pure: logs come in as frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.config import Config
from observer.discovery.candidates import library
from observer.discovery.experiment import SEPARATES, Experiment, propose
from observer.discovery.family import Tie, ties
from observer.discovery.localise import Event, Place, event, localised
from observer.discovery.phases import courses_of, lacking
from observer.discovery.proof import Proof, prove
from observer.discovery.search import Progress, Search, search, without
from observer.discovery.suspects import Suspect, about_the_air, suspects
from observer.discovery.verdict import Partial, Verdict, decide, partial_of, under_suspicion
from observer.discovery.workers import ALONE, Crew
from observer.errors import LogError
from observer.fit.evidence import gather
from observer.fit.forward import Forward
from observer.fit.hypothesis import Fit
from observer.fit.parameters import free_keys
from observer.fit.problem import Problem
from observer.fit.runs import LEAST_S, prepare
from observer.frames import FrameBlock

MOST_ASKED = 5
"""Effects that the logs cannot show and for which a test is sought."""


@dataclass(frozen=True)
class Discovery:
    """Everything a discovery found: see the modules of each part.

    `ties`: of an ambiguous answer whose sets differ within families only, what stands in each place of them.
    `suspects`: what is wrong with the logs, those first that were put right before the search.
    """

    problem: Problem
    search: Search
    verdict: Verdict
    proof: Proof
    where: tuple[Place, ...]
    event: Event | None
    experiment: Experiment | None
    ties: tuple[Tie, ...] = ()
    partial: Partial | None = None
    suspects: tuple[Suspect, ...] = ()


def discover(
    config: Config,
    runs: Sequence[Sequence[FrameBlock]],
    progress: Progress = lambda _text, _done: None,
    crew: Crew = ALONE,
    righted: Sequence[Suspect] = (),
) -> Discovery:
    """Return what is missing from a configuration, by one or more runs of its machine.

    `progress(what, part done)` is called as the work goes on; the `crew` does not change what comes out.
    `righted` are mistakes of the logs that the runs no longer have.
    Raises `ConfigError` where nothing may be calibrated, `LogError` where the logs hold nothing to compare.
    """
    keys = free_keys(config)
    prepared = [prepare(config, blocks, f"log {i + 1}") for i, blocks in enumerate(runs)]
    if max(run.duration_s for run in prepared) < LEAST_S:
        raise LogError(f"the logs are shorter than {LEAST_S:.0f} s; record a longer one")
    forward = Forward(config, prepared)
    evidence = gather(forward.runs, np.array([s.noise_K for s in config.sensor]))
    if not evidence.proof.any():
        raise LogError(
            "the last log, or the end of a single one, is kept as proof and holds no usable reading; "
            "end with a log whose readings are there and within [limits]"
        )
    problem = Problem(config, keys, forward, evidence)
    coarse = any(run.coarse for run in forward.runs)
    known = library(config, keys, config.discover.without, coarse=coarse)
    found = search(problem, known, progress, crew)
    progress("suspects among the logs", 0.91)
    wrong = suspects(found.null, found.ranking, found.signatures)
    progress("opening the proof", 0.94)
    proof = prove(found.null, found.fit, _with_one_less(found, crew))
    verdict = decide(found, proof, lacking(config, prepared, courses_of(problem)))
    told = [s.text for s in wrong if s.what != "ambient" or not about_the_air(verdict.fit)]
    verdict = under_suspicion(verdict, told)
    where = localised(found.null, problem.evidence.used)
    missing = verdict.kind == "unknown" and not verdict.suspected  # else it is told of logs that are wrong
    return Discovery(
        problem,
        found,
        verdict,
        proof,
        where,
        event(found.fit) if missing else None,
        _experiment(found.null.problem, found, verdict, crew),
        ties(verdict.sets, verdict.fits) if verdict.kind == "ambiguous" else (),
        partial_of(found) if missing else None,
        (*righted, *wrong),
    )


def _with_one_less(found: Search, crew: Crew) -> list[tuple[str, Fit]]:
    """Each of several chosen effects, and the fit of the others alone."""
    if len(found.chosen) < 2:
        return []
    tasks = [(found.fit, i) for i in range(len(found.chosen))]
    fits = crew.each(without, found.null.problem, tasks)
    return [(t.candidate.name, fit) for t, fit in zip(found.chosen, fits, strict=True)]


def _experiment(problem: Problem, found: Search, verdict: Verdict, crew: Crew) -> Experiment | None:
    """The test that would tell the answers apart, where there are several."""
    if verdict.kind == "ambiguous":
        return propose(problem, [fit.config for fit in verdict.fits], crew)
    if verdict.kind == "not_identifiable":
        config = found.fit.config
        for unseen in found.blind[:MOST_ASKED]:
            more = (*config.effect, unseen.effect(unseen.shapes[0]))
            test = propose(problem, [config, config.model_copy(update={"effect": more})], crew)
            if test.separation_sigma >= SEPARATES:
                return test
    return None
