"""Choose effects: screen the library by signatures, fit the best, add, and prune.

The part of a signature that the free parameters could absorb is projected out. The projection of the residual
on the remaining part gives the expected drop of the deviance. The best few are then fitted with every
parameter free and cross-validated: a fit to all folds but one must also explain that one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from observer.config.effects.base import Fitted
from observer.discovery.candidates import Candidate, Promise, Signature, promises, score, signatures
from observer.discovery.workers import IN_PROCESS, WorkerPool
from observer.fit.hypothesis import MOST_STEP, EffectParameter, Fit, fit_effects, fit_null, refitted
from observer.fit.problem import Problem

MOST_EFFECTS = 3
FITTED, FITTED_LATER = 5, 4
"""How many candidates are fitted after the first screening, and after later ones."""
ACCEPT = 30.0
"""The least drop of the deviance that names an effect; see `docs/discovery.md` for how it was found."""
FORM = 0.01
"""Part of the deviance already explained that a further effect has to explain as well, since no form is
exact; larger beside effects that are `rough`.
"""
MATERIAL = 0.05
"""Least part of the held-out deviance that has to be explained."""
SAME = 0.97
"""Part of the drop that a simple effect must reach to replace a richer one of the same physics."""
STARTS = 2
"""Starting shapes for an effect of several parameters, as long as none explains everything."""
EXPLAINED = 1.1
"""A deviance below this multiple of that of noise: no other start can do better."""
PLAIN_TO_SEE = 10.0
"""A parameter this many half widths of its 95 % interval from zero is needed."""
WEAK = 0.1
"""Part of the promised strength with which a fit starts again if it diverged from the whole."""
BLIND = 0.02
"""A signature of which less than this part remains is confounded with the free parameters."""

Progress = Callable[[str, float], None]
Entry = TypeVar("Entry")


@dataclass(frozen=True)
class FittedCandidate:
    """A candidate added to a fit.

    Attributes:
        candidate: The effect at its target, in the form that was kept.
        fit: The fit with it.
        drop: Fall of the deviance.
        least: Required score.
        held_out: Fraction of the held-out deviance that it explains; negative if it predicts worse.
    """

    candidate: Candidate
    fit: Fit
    drop: float
    least: float
    held_out: float

    @property
    def score(self) -> float:
        """The drop of the deviance, less the drop required for its parameters."""
        return score(self.drop, len(self.candidate.fitted))

    @property
    def accepted(self) -> bool:
        """Whether it explains enough, also of the held-out data, within its bounds and with significant
        strengths.
        """
        sound = not self.fit.at_bound and self.bounded and self.significant
        return self.score >= self.least and self.held_out >= MATERIAL and sound

    @property
    def significant(self) -> bool:
        """Whether the 95 % interval of every strength excludes its neutral value.

        Parameters that enter by their reciprocal do not count: the drop shows that they are significant.
        """
        strengths = [
            (info.neutral, value, half)
            for info, _, value, half in self._own_parameters
            if not info.reciprocal  # the drop itself shows that it is significant
        ]
        return all(neutral is None or abs(value - neutral) > half for neutral, value, half in strengths)

    @property
    def bounded(self) -> bool:
        """Whether the intervals of the parameters that define the effect lie below their upper bounds."""
        return all(value + half < p.high for info, p, value, half in self._own_parameters if info.bounded)

    @property
    def _own_parameters(self) -> Iterator[tuple[Fitted, EffectParameter, float, float]]:
        """Prior knowledge, parameter, value and half interval of each of the candidate's own parameters.

        An effect of the same kind at another target is excluded, because it may have been fitted in another
        form.
        """
        columns = zip(self.fit.parameters, self.fit.values, self.fit.half_width, strict=True)
        for p, value, half in columns:
            effect = self.fit.config.effect[p.effect]
            if (
                isinstance(effect, self.candidate.of)
                and getattr(effect, "target", None) == self.candidate.target
            ):
                yield self.candidate.fitted[p.key], p, float(value), float(half)


class Search(NamedTuple):
    """The result of a search.

    Attributes:
        null: The fit without effects.
        fit: The last accepted fit. For bodies of nuts and for coarse rows it is refitted with its own
            tolerances.
        chosen: Its effects, none to three.
        rivals: For each of these, the trials it won against with the others present: itself, then the best.
        ranking: Trials of the first round, the best first.
        blind: Candidates confounded with the free parameters.
        signatures: Signatures of the library at the null hypothesis.
    """

    null: Fit
    fit: Fit
    chosen: tuple[FittedCandidate, ...]
    rivals: tuple[tuple[FittedCandidate, ...], ...]
    ranking: tuple[FittedCandidate, ...]
    blind: tuple[Candidate, ...]
    signatures: tuple[Signature, ...] = ()


def search(
    problem: Problem,
    library: Sequence[Candidate],
    progress: Progress = lambda _text, _share: None,
    pool: WorkerPool = IN_PROCESS,
) -> Search:
    """Return the effects missing from the configuration of a problem.

    Effects are added one at a time, up to three. Then redundant ones are removed, and each is exchanged for a
    better rival if there is one.

    Args:
        problem: Data and free parameters.
        library: Candidates to try.
        progress: Called as `progress(text, fraction)`, from 0 to 0.9.
        pool: Where predictions and fits run; it does not change the result.
    """
    progress("calibrating without any effect", 0.0)
    null = fit_null(problem, problem.config)
    progress("signatures of the library", 0.15)
    marks = signatures(null.problem, null.config, library, pool)
    blind = _blind(promises(null, marks))
    fit = null
    chosen: list[FittedCandidate] = []
    ranking: tuple[FittedCandidate, ...] = ()
    while len(chosen) < MOST_EFFECTS:
        progress(f"round {len(chosen) + 1} of candidates", 0.3 + 0.2 * len(chosen))
        trials = tried(null, fit, marks, [t.candidate for t in chosen], pool)
        ranking = ranking or trials
        best = _best(trials)
        if best is None:
            break
        chosen.append(best)
        fit = best.fit
    fit, chosen = _pruned(null, fit, chosen, pool)
    progress("rivals of what was found", 0.9)
    rivals: list[tuple[FittedCandidate, ...]] = []
    if len(chosen) == 1:
        single = replace(chosen[0], fit=fit, drop=null.deviance - fit.deviance)
        rivals.append((single, *(t for t in ranking if t.candidate.name != single.candidate.name)))
    for i in range(len(chosen) if len(chosen) > 1 else 0):
        fit, chosen, trials = _exchanged(null, fit, chosen, i, marks, pool)
        rivals.append(trials)
    coarse = any(run.coarse for run in problem.forward.runs)
    nuts = {source.name for source in problem.config.source if source.shape == "nut"}
    if any(coarse or (t.candidate.of.rough > FORM and t.candidate.target in nuts) for t in chosen):
        fit = refitted(fit)
    return Search(null, fit, tuple(chosen), tuple(rivals), ranking, blind, tuple(marks))


def _exchanged(
    null: Fit,
    fit: Fit,
    chosen: list[FittedCandidate],
    number: int,
    marks: Sequence[Signature],
    pool: WorkerPool,
) -> tuple[Fit, list[FittedCandidate], tuple[FittedCandidate, ...]]:
    """Replace a chosen effect by the best while the others stay; return its rivals too."""
    others = [t.candidate for j, t in enumerate(chosen) if j != number]
    problem = null.problem
    base = without(problem, fit, number)
    now = chosen[number]
    trials = tried(null, base, marks, others, pool)
    refits = [t for t in trials if t.candidate.name == now.candidate.name]
    if not refits or refits[0].fit.deviance > fit.deviance:  # started elsewhere, it ended worse
        as_fitted = replace(now, fit=fit, drop=base.deviance - fit.deviance)
        trials = tuple(_descending([as_fitted, *(t for t in trials if t not in refits)], lambda t: t.score))
    best = _best(trials) or trials[0]
    if best.candidate.name != now.candidate.name and best.accepted:
        chosen = [t for j, t in enumerate(chosen) if j != number]
        chosen.insert(number, best)
        fit = _in_order(best.fit, number, len(problem.config.effect))
    return fit, chosen, (best, *(t for t in trials if t is not best))


def _in_order(fit: Fit, number: int, before: int) -> Fit:
    """Return a fit with its last effect moved to the position of the one it replaces."""
    effects, last = list(fit.config.effect), len(fit.config.effect) - 1
    effects.insert(before + number, effects.pop())
    order = {last: before + number} | {i: i + (i >= before + number) for i in range(last)}
    config = fit.config.model_copy(update={"effect": tuple(effects)})
    parameters = [replace(p, effect=order[p.effect]) for p in fit.parameters]
    return fit_effects(fit.problem, config, sorted(parameters, key=lambda p: p.effect))


def tried(
    null: Fit,
    base: Fit,
    marks: Sequence[Signature],
    present: Sequence[Candidate],
    pool: WorkerPool = IN_PROCESS,
) -> tuple[FittedCandidate, ...]:
    """Fit the most promising candidates in addition to a fit, two at a time.

    Five are fitted without other effects, four beside some. Candidates that promise less than a quarter of
    the required drop are not fitted.

    Args:
        null: The fit without effects.
        base: The fit to which they are added.
        marks: Signatures of the library.
        present: Effects of `base`. They are not tried again, and with an effect of a sensor no other sensor's
            is tried.
        pool: Where fits run.

    Returns:
        The fitted candidates, the best score first.
    """
    least = max(ACCEPT, form_of(present) * (null.deviance - base.deviance))
    by_name: dict[str, list[Promise]] = {}
    for p in promises(base, [s for s in marks if not _taken(s.candidate, present)]):
        if p.unabsorbed >= BLIND:
            by_name.setdefault(p.signature.candidate.name, []).append(p)
    sorted_by_drop = [_descending(ranked, lambda p: p.drop) for ranked in by_name.values()]
    order = _descending(sorted_by_drop, lambda ranked: ranked[0].drop)[
        : FITTED if not present else FITTED_LATER
    ]
    worthwhile = [ranked for ranked in order if ranked[0].drop > 0.25 * least]
    trials: list[FittedCandidate] = []
    for pair in (worthwhile[i : i + 2] for i in range(0, len(worthwhile), 2)):
        rival = min([t.fit.deviance for t in trials], default=np.inf)
        tasks = [(base, tuple(ranked), least, rival) for ranked in pair]
        trials += [t for t in pool.map(_try, base.problem, tasks) if t is not None]
    return tuple(_descending(trials, lambda t: t.score))


def form_of(present: Sequence[Candidate]) -> float:
    """Return the largest form error among effects, as a fraction of the deviance that they explain.

    Args:
        present: The effects; without any it is `FORM`.
    """
    return max([FORM, *(c.of.rough for c in present)])


def _descending(entries: Iterable[Entry], worth: Callable[[Entry], float]) -> list[Entry]:
    """Return entries sorted by worth, the best first; worths are rounded, so that equal ones keep their
    order.
    """
    return sorted(entries, key=lambda entry: -round(worth(entry), 3))


def _taken(candidate: Candidate, present: Sequence[Candidate]) -> bool:
    """Whether a candidate is excluded by the present ones: it is among them, or is a second sensor fault.

    Offsets of several sensors can reproduce almost any steady field.
    """
    of_sensor = [c for c in (candidate, *present) if c.of.targets == "sensor"]
    return candidate.name in {c.name for c in present} or (candidate in of_sensor and len(of_sensor) > 1)


def _try(
    problem: Problem, base: Fit, promised: Sequence[Promise], least: float, rival: float
) -> FittedCandidate | None:
    """Fit a candidate in its richest form from the most promising shapes, then keep the simplest equivalent
    form.

    Return None if no prediction is finite.
    """
    forms = sorted({len(p.signature.candidate.fitted): p.signature.candidate for p in promised}.items())
    candidate, fit = forms[-1][1], None
    for promise in promised[: STARTS if len(candidate.fitted) > 1 else 1]:
        if fit is not None and _explained(fit):
            break
        best = rival if fit is None else min(rival, fit.deviance)
        started = _from(problem, base, candidate, promise, best)
        fit = started if fit is None or not fit.deviance <= started.deviance else fit
    if fit is None or not (np.isfinite(fit.residual).all() and np.isfinite(fit.jacobian).all()):
        return None
    for _, plain in forms[:-1]:
        plainer = _plainer(fit, plain, candidate)
        spare = max(ACCEPT, form_of([plain]) * (base.deviance - fit.deviance))
        if plainer is not None and plainer.deviance <= fit.deviance + spare:
            candidate, fit = plain, plainer
            break
    drop, share = base.deviance - fit.deviance, 1 - held_out(fit) / held_out(base)
    return FittedCandidate(candidate, fit, drop, least, share)


def _from(problem: Problem, base: Fit, candidate: Candidate, promise: Promise, rival: float) -> Fit:
    """Fit a candidate in addition to a fit, starting from the promised shape and strength."""
    index, of_shape = len(base.config.effect), promise.signature.candidate
    shape = of_shape.shapes[promise.signature.shape]
    effect = of_shape.effect(shape, promise.strength)
    as_given = problem.with_free(base.config, problem.free_values(problem.config))
    # a calibration without a strong effect may be far off
    starts = [c.model_copy(update={"effect": (*c.effect, effect)}) for c in (base.config, as_given)]
    costs = [float(np.sum(problem.residual(c)[problem.evidence.used] ** 2)) for c in starts]
    parameters = (*base.parameters, *candidate.parameters(index))
    fit = fit_effects(problem, starts[int(np.argmin(costs))], parameters, rival)
    # it diverged: with almost nothing of the effect, it would equal `base`
    if not fit.deviance <= base.deviance:
        weak = (*base.config.effect, of_shape.effect(shape, WEAK * promise.strength))
        fit = fit_effects(problem, base.config.model_copy(update={"effect": weak}), parameters, rival)
    return fit


def _explained(fit: Fit) -> bool:
    """Whether a fit explains everything but noise."""
    return fit.deviance < EXPLAINED * fit.problem.evidence.expected * len(fit.remainder)


def _plainer(fit: Fit, plain: Candidate, rich: Candidate) -> Fit | None:
    """Return a fit of a candidate's last effect in a simpler form, started from the richer one.

    None if the parameters that it drops are clearly needed.
    """
    index, dropped = len(fit.config.effect) - 1, set(rich.fitted) - set(plain.fitted)
    columns = zip(fit.parameters, fit.values, fit.half_width, strict=True)
    if any(p.effect == index and p.key in dropped and abs(v) > PLAIN_TO_SEE * half for p, v, half in columns):
        return None
    without = {key: rich.of.model_fields[key].default for key in dropped}
    effects = (*fit.config.effect[:-1], fit.config.effect[-1].model_copy(update=without))
    parameters = [p for p in fit.parameters if not (p.effect == index and p.key in dropped)]
    return fit_effects(fit.problem, fit.config.model_copy(update={"effect": effects}), parameters)


def held_out(fit: Fit) -> float:
    """Return the deviance of all folds, each with the parameters fitted to the other folds.

    The fits are linear about the given one, with steps of at most half a scale.
    """
    problem, total = fit.problem, 0.0
    fold = problem.evidence.fold
    for number in range(problem.evidence.folds):
        in_fold, others = fold == number, (fold >= 0) & (fold != number)
        step = np.clip(fit.linear(others).step, -MOST_STEP, MOST_STEP)
        residual = fit.residual[in_fold] - fit.jacobian[in_fold] @ step
        total += float(np.sum(fit.marginal(in_fold)(residual) ** 2))
    return total


def _best(trials: Sequence[FittedCandidate]) -> FittedCandidate | None:
    """Return the best accepted candidate, or one of fewer parameters to which it reduces; None if none is
    accepted.
    """
    accepted = [t for t in trials if t.accepted]
    if not accepted:
        return None
    same = [t for t in accepted if same_physics(t, accepted[0])]
    return same[0] if same and same[0].drop > SAME * accepted[0].drop else accepted[0]


def same_physics(simple: FittedCandidate, rich: FittedCandidate) -> bool:
    """Return whether a candidate with more parameters reduces to a simple one, at an end or over the whole
    screw.

    Args:
        simple: The candidate with fewer parameters.
        rich: The fitted candidate; its fitted position decides.
    """
    config = rich.fit.config
    return config.effect[-1].comes_down_to(config.screw.length_m) == (
        simple.candidate.of,
        simple.candidate.target,
    )


def _pruned(
    null: Fit, fit: Fit, chosen: list[FittedCandidate], pool: WorkerPool
) -> tuple[Fit, list[FittedCandidate]]:
    """Remove effects that the others have made redundant, the least needed first."""
    while len(chosen) > 1:
        smaller_fits = pool.map(without, null.problem, [(fit, i) for i in range(len(chosen))])
        costs = [
            score(f.deviance - fit.deviance, len(t.candidate.fitted))
            for f, t in zip(smaller_fits, chosen, strict=True)
        ]
        cheapest = int(np.argmin(costs))
        form = form_of([t.candidate for t in chosen])
        if costs[cheapest] >= max(ACCEPT, form * (null.deviance - smaller_fits[cheapest].deviance)):
            break
        fit, chosen = smaller_fits[cheapest], [t for i, t in enumerate(chosen) if i != cheapest]
    return fit, chosen


def without(problem: Problem, fit: Fit, effect: int) -> Fit:
    """Return a hypothesis refitted without one of its effects.

    Args:
        problem: Data and shared derivatives.
        fit: The hypothesis, from which the fit starts.
        effect: Number of the effect among those that the fit has added, from 0.
    """
    index = effect + len(problem.config.effect)
    effects = [e for i, e in enumerate(fit.config.effect) if i != index]
    remaining = [p for p in fit.parameters if p.effect != index]
    moved = [replace(p, effect=p.effect - (p.effect > index)) for p in remaining]
    return fit_effects(problem, fit.config.model_copy(update={"effect": tuple(effects)}), moved)


def _blind(all_promises: Sequence[Promise]) -> tuple[Candidate, ...]:
    """Return the candidates whose signatures the free parameters can all absorb."""
    most: dict[str, tuple[float, Candidate]] = {}
    for p in all_promises:
        candidate = p.signature.candidate
        most[candidate.name] = max(
            most.get(candidate.name, (0.0, candidate)), (p.unabsorbed, candidate), key=lambda e: e[0]
        )
    blind = [candidate for share, candidate in most.values() if share < BLIND]
    return tuple(sorted(blind, key=lambda c: c.of.confounded_with_scale))
