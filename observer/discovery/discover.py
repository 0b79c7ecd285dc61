"""Find the physical effect missing from a model, and prove on held-out data that adding it removes the error.

The steps are: calibrate within every hypothesis, search, test whether the logs rather than the model are at
fault, open the proof once, and decide. An uncertain answer comes with the event that remains unexplained, or
with the test that would settle it. This is pure: logs come in as frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from observer.config.machine import Config
from observer.discovery.candidates import Candidate, library
from observer.discovery.deciding import decisive_test
from observer.discovery.displacement import AGAINST, DisplacementFindings, displacements_of
from observer.discovery.experiment import Experiment
from observer.discovery.family import Tie, ties
from observer.discovery.localise import ErrorLocation, Event, courses_of, event, localised, missing_excitation
from observer.discovery.nut_path import NUTS_WAY, needs_path, sparse_paths
from observer.discovery.proof import Proof, prove
from observer.discovery.search import Progress, Search, search, without
from observer.discovery.suspects import Suspect, about_the_air, suspects, unlikely_offset
from observer.discovery.verdict import Partial, Verdict, decide, partial_of, under_suspicion
from observer.discovery.workers import IN_PROCESS, WorkerPool
from observer.discovery.worth import Worth, worth_of
from observer.errors import ConfigError, LogError
from observer.fit.hypothesis import Fit
from observer.fit.parameters import free_keys, lawless, thermal_only
from observer.fit.problem import Problem
from observer.fit.runs import prepare_all, refuse_short
from observer.frames import FrameBlock


@dataclass(frozen=True)
class Discovery:
    """All results of a discovery; see the modules of each part.

    Attributes:
        problem: Data and free parameters.
        search: Fits, ranking and rivals.
        verdict: The conclusion.
        proof: Error on held-out data, without and with the effects.
        locations: Where the calibrated model without effects is wrong, the worst first.
        event: Largest unexplained heat of an unknown cause, else None.
        experiment: Test that would decide, None if none is needed.
        ties: For an ambiguous answer whose sets differ only within families, the members of each position.
        partial: The effect that explains most of an unknown, else None.
        suspects: Faults of the logs; those corrected before the search come first.
        worth: Gain in thermal error by the effects, or by the calibration if none was added.
        displacements: Findings of the displacement sensors, None without any.
    """

    problem: Problem
    search: Search
    verdict: Verdict
    proof: Proof
    locations: tuple[ErrorLocation, ...]
    event: Event | None
    experiment: Experiment | None
    ties: tuple[Tie, ...] = ()
    partial: Partial | None = None
    suspects: tuple[Suspect, ...] = ()
    worth: Worth | None = None
    displacements: DisplacementFindings | None = None


def discover(
    config: Config,
    runs: Sequence[Sequence[FrameBlock]],
    progress: Progress = lambda _text, _share: None,
    pool: WorkerPool = IN_PROCESS,
    corrected: Sequence[Suspect] = (),
) -> Discovery:
    """Return the effect that a configuration lacks, from one or more runs of its machine.

    The search uses temperatures only. Displacements then support or contradict the named effect, and show
    causes that move the axis without heat.

    Args:
        config: The machine. `[calibrate] free` are the parameters that every hypothesis fits.
        runs: Frames of each log; the last one, or the end of a single one, becomes the proof.
        progress: Called as `progress(text, fraction)` during the work.
        pool: Where predictions run; it does not change the result.
        corrected: Faults of the logs that have been corrected in the runs.

    Raises:
        ConfigError: If no heat has a law, if a key is wrong, or if nothing is free.
        LogError: If the logs are too short, or hold no usable reading to fit or to prove on.
    """
    complete_config, config = config, thermal_only(config)
    problem = _problem_of(config, runs)
    prepared = [run.run for run in problem.forward.runs]
    sparse = sparse_paths(config, prepared)
    result = search(problem, _candidates(problem, paths_known=not sparse), progress, pool)
    progress("suspects among the logs", 0.91)
    wrong = sparse or suspects(result.null, result.ranking, result.signatures)
    progress("opening the proof", 0.94)
    with_one_less = _with_one_less(result, pool)
    proof = prove(result.null, result.fit, with_one_less)
    verdict = decide(result, proof, missing_excitation(config, prepared, courses_of(problem)))
    if verdict.kind in ("none", "not_identifiable"):
        wrong = wrong or unlikely_offset(result.null, result.ranking)
    verdict = under_suspicion(verdict, [s.text for s in wrong if _counts(s, verdict)])
    progress("what displacements say", 0.95)
    displacements = displacements_of(complete_config, runs, verdict, result.null)
    if displacements is not None and displacements.supports is False:
        verdict = under_suspicion(verdict, [AGAINST])
    before = result.null.config if result.chosen else config
    missing = verdict.kind == "unknown" and not verdict.suspected  # otherwise the logs are at fault
    partial = partial_of(result) if missing else None
    return Discovery(
        problem=problem,
        search=result,
        verdict=verdict,
        proof=proof,
        locations=localised(result.null),
        event=event(result.fit) if missing else None,
        experiment=decisive_test(result, verdict, with_one_less, partial, pool),
        ties=ties(verdict.sets, verdict.fits) if verdict.kind == "ambiguous" else (),
        partial=partial,
        suspects=(*corrected, *wrong),
        worth=worth_of(problem, before, verdict.fit.config),
        displacements=displacements,
    )


def _problem_of(config: Config, runs: Sequence[Sequence[FrameBlock]]) -> Problem:
    """Return the problem of some runs; raises as `discover` does."""
    keys = free_keys(config)
    if all(source.law is None for source in config.source):
        raise ConfigError(f"source: {lawless(config)}")
    prepared = prepare_all(config, runs)
    refuse_short(prepared, "a search")
    problem = Problem.of(config, keys, prepared)
    if not problem.evidence.proof.any():
        raise LogError(
            "the last log, or the end of a single one, is kept as proof and holds no usable reading; "
            "make the last log one with readings within [limits]"
        )
    return problem


def _candidates(problem: Problem, *, paths_known: bool) -> tuple[Candidate, ...]:
    """Return the candidates of a problem, without those that need the paths of nuts if these are unknown."""
    config = problem.config
    candidates = library(config, problem.keys, config.discover.without, config.discover.also)
    if paths_known and not any(run.coarse for run in problem.forward.runs):
        return candidates
    return tuple(candidate for candidate in candidates if not needs_path(candidate, config))


def _counts(suspect: Suspect, verdict: Verdict) -> bool:
    """Whether a suspect contradicts a verdict.

    A suspect about the air does not if only effects of the air are named. Beside other effects it does,
    because those make up for air that drifts unevenly or differs between logs. A nut's path that no log shows
    does not contradict effects that were named without it.
    """
    if suspect.what == NUTS_WAY:
        return not verdict.sets
    return suspect.what != "ambient" or not (verdict.sets and about_the_air(verdict.fit))


def _with_one_less(result: Search, pool: WorkerPool) -> list[tuple[str, Fit]]:
    """Return each chosen effect with the fit of the others alone."""
    if len(result.chosen) == 1:
        return [(result.chosen[0].candidate.name, result.null)]
    tasks = [(result.fit, i) for i in range(len(result.chosen))]
    fits = pool.map(without, result.null.problem, tasks)
    return [(t.candidate.name, fit) for t, fit in zip(result.chosen, fits, strict=True)]
