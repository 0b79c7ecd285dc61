"""Choose effects: screen the library by signatures, fit the best in earnest, add, and prune.

What of a signature the free parameters could also do is projected out; what of the residual lies along the
rest is the drop of the deviance to be expected. The best few are then fitted with every parameter free, and
judged on data held out: what is fitted to all folds but one must also explain that one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from observer.discovery.candidates import Candidate, Promise, Signature, promises, signatures
from observer.discovery.workers import ALONE, Crew
from observer.effects.base import Fitted
from observer.fit.hypothesis import Fit, Parameter, fit_effects, fit_null
from observer.fit.problem import Problem
from observer.frames import BoolArray, FloatArray

MOST_EFFECTS = 3
FITTED, FITTED_LATER = 5, 4
"""How many candidates are fitted in earnest after the first screening, and after later ones."""
ACCEPT = 30.0
"""The least drop of the deviance that names an effect; see `docs/discovery.md` for how it was found."""
PER_PARAMETER = 6.0
"""What each parameter beyond the first has to earn."""
FORM = 0.01
"""Part of what is explained already that a further effect has to explain, for no form is quite right; more
beside effects that are `rough`."""
MATERIAL = 0.05
"""The least part of the deviance on data held out that has to go."""
SAME = 0.97
"""Part of the drop that a simple effect must bring to stand for a richer one of the same physics."""
STARTS = 2
"""Promised shapes from which an effect of several parameters is fitted, as long as none explains all."""
EXPLAINED = 1.1
"""So many times what noise does is about that: no other start can do better."""
PLAIN_TO_SEE = 10.0
"""A parameter is needed that is so many half widths of its 95 % interval from nothing."""
WEAK = 0.1
"""Part of the promised strength with which a fit begins where the whole leads astray."""
BLIND = 0.02
"""A signature of which less than this part remains cannot be told from the free parameters."""

Progress = Callable[[str, float], None]
Entry = TypeVar("Entry")


@dataclass(frozen=True)
class Trial:
    """A candidate added to a fit.

    `drop` of the deviance and the `least` that is asked; `held_out`, the part of the deviance on data held
    out that goes.
    """

    candidate: Candidate
    fit: Fit
    drop: float
    least: float
    held_out: float

    @property
    def score(self) -> float:
        """The drop of the deviance, less what its parameters have to earn."""
        return self.drop - PER_PARAMETER * (len(self.candidate.fitted) - 1)

    @property
    def accepted(self) -> bool:
        """Whether it explains enough, on data held out as well, within its bounds."""
        sound = not self.fit.at_bound and self.told and self.there
        return self.score >= self.least and self.held_out >= MATERIAL and sound

    @property
    def there(self) -> bool:
        """Whether the 95 % interval of every strength leaves out where there is no effect."""
        own = [
            (known.neutral, value, half)
            for known, _, value, half in self._own
            if not known.reciprocal  # the drop itself says that it is not nothing
        ]
        return all(neutral is None or abs(value - neutral) > half for neutral, value, half in own)

    @property
    def told(self) -> bool:
        """Whether the parameters without which the effect would be another one have an upper bound."""
        return all(value + half < p.high for known, p, value, half in self._own if known.bounded)

    @property
    def _own(self) -> Iterator[tuple[Fitted, Parameter, float, float]]:
        """Of the candidate's own parameters what is known, the parameter, its value and half its interval.

        Another effect of the kind at another target is not its own: it may have been fitted in another form.
        """
        each = zip(self.fit.parameters, self.fit.values, self.fit.half_width, strict=True)
        for p, value, half in each:
            effect = self.fit.config.effect[p.effect]
            if (
                isinstance(effect, self.candidate.of)
                and getattr(effect, "target", None) == self.candidate.target
            ):
                yield self.candidate.fitted[p.key], p, float(value), float(half)


class Search(NamedTuple):
    """What a search found.

    `null` is the fit without effects, `fit` the last accepted one; `chosen` its effects, each with the trials
    it won against (`rivals`, itself first, then the best) while the others stood; `ranking` the first round;
    `blind` the candidates that this test cannot tell from the free parameters; `signatures` those of the
    library.
    """

    null: Fit
    fit: Fit
    chosen: tuple[Trial, ...]
    rivals: tuple[tuple[Trial, ...], ...]
    ranking: tuple[Trial, ...]
    blind: tuple[Candidate, ...]
    signatures: tuple[Signature, ...] = ()


def search(
    problem: Problem,
    library: Sequence[Candidate],
    progress: Progress = lambda _text, _done: None,
    crew: Crew = ALONE,
) -> Search:
    """Find the effects that are missing from the configuration of a problem."""
    progress("calibrating without any effect", 0.0)
    null = fit_null(problem, problem.config)
    progress("signatures of the library", 0.15)
    found = signatures(null.problem, null.config, library, crew)
    blind = _blind(promises(null, found))
    fit = null
    chosen: list[Trial] = []
    ranking: tuple[Trial, ...] = ()
    while len(chosen) < MOST_EFFECTS:
        trials = tried(null, fit, found, [t.candidate for t in chosen], crew)
        ranking = ranking or trials
        progress(f"effects found: {len(chosen)}", 0.3 + 0.2 * len(chosen))
        best = _best(trials)
        if best is None:
            break
        chosen.append(best)
        fit = best.fit
    fit, chosen = _pruned(null, fit, chosen, crew)
    progress("rivals", 0.9)
    rivals: list[tuple[Trial, ...]] = []
    if len(chosen) == 1:
        alone = replace(chosen[0], fit=fit, drop=null.deviance - fit.deviance)
        rivals.append((alone, *(t for t in ranking if t.candidate.name != alone.candidate.name)))
    for i in range(len(chosen) if len(chosen) > 1 else 0):
        fit, chosen, trials = _exchanged(null, fit, chosen, i, found, crew)
        rivals.append(trials)
    return Search(null, fit, tuple(chosen), tuple(rivals), ranking, blind, tuple(found))


def _exchanged(
    null: Fit, fit: Fit, chosen: list[Trial], number: int, found: Sequence[Signature], crew: Crew
) -> tuple[Fit, list[Trial], tuple[Trial, ...]]:
    """Put the best in the place of a chosen effect while the others stand; give its rivals as well."""
    others = [t.candidate for j, t in enumerate(chosen) if j != number]
    problem = null.problem
    base = without(problem, fit, number)
    now = chosen[number]
    trials = tried(null, base, found, others, crew)
    own = [t for t in trials if t.candidate.name == now.candidate.name]
    if not own or own[0].fit.deviance > fit.deviance:  # begun elsewhere, it ended worse
        mine = replace(now, fit=fit, drop=base.deviance - fit.deviance)
        trials = tuple(_descending([mine, *(t for t in trials if t not in own)], lambda t: t.score))
    best = _best(trials) or trials[0]
    if best.candidate.name != now.candidate.name and best.accepted:
        chosen = [t for j, t in enumerate(chosen) if j != number]
        chosen.insert(number, best)
        fit = _in_order(best.fit, number, len(problem.config.effect))
    return fit, chosen, (best, *(t for t in trials if t is not best))


def _in_order(fit: Fit, number: int, before: int) -> Fit:
    """A fit with its last effect moved to the place of the one it replaces, refitted in no way."""
    effects, last = list(fit.config.effect), len(fit.config.effect) - 1
    effects.insert(before + number, effects.pop())
    order = {last: before + number} | {i: i + (i >= before + number) for i in range(last)}
    config = fit.config.model_copy(update={"effect": tuple(effects)})
    parameters = [replace(p, effect=order[p.effect]) for p in fit.parameters]
    return fit_effects(fit.problem, config, sorted(parameters, key=lambda p: p.effect))


def tried(
    null: Fit,
    base: Fit,
    found: Sequence[Signature],
    present: Sequence[Candidate],
    crew: Crew = ALONE,
) -> tuple[Trial, ...]:
    """Fit the most promising candidates beside a fit in earnest, two at a time; the best first."""
    least = max(ACCEPT, form_of(present) * (null.deviance - base.deviance))
    by_name: dict[str, list[Promise]] = {}
    for p in promises(base, [s for s in found if not _taken(s.candidate, present)]):
        if p.kept >= BLIND:
            by_name.setdefault(p.signature.candidate.name, []).append(p)
    each = [_descending(every, lambda p: p.drop) for every in by_name.values()]
    order = _descending(each, lambda every: every[0].drop)[: FITTED if not present else FITTED_LATER]
    worthwhile = [every for every in order if every[0].drop > 0.25 * least]
    trials: list[Trial] = []
    for pair in (worthwhile[i : i + 2] for i in range(0, len(worthwhile), 2)):
        rival = min([t.fit.deviance for t in trials], default=np.inf)
        tasks = [(base, tuple(every), least, rival) for every in pair]
        trials += [t for t in crew.each(_try, base.problem, tasks) if t is not None]
    return tuple(_descending(trials, lambda t: t.score))


def form_of(present: Sequence[Candidate]) -> float:
    """The part of what effects explain that their forms may leave: that of the roughest."""
    return max([FORM, *(c.of.rough for c in present)])


def _descending(every: Iterable[Entry], worth: Callable[[Entry], float]) -> list[Entry]:
    """Sort by worth, the best first; twins stay as they stood, whatever rounding makes of them."""
    return sorted(every, key=lambda entry: -round(worth(entry), 3))


def _taken(candidate: Candidate, present: Sequence[Candidate]) -> bool:
    """Whether a candidate is out of the question beside others: itself, or a second sensor at fault.

    Offsets of several sensors can mimic almost any steady field.
    """
    of_sensor = [c for c in (candidate, *present) if c.of.targets == "sensor"]
    return candidate.name in {c.name for c in present} or (candidate in of_sensor and len(of_sensor) > 1)


def _try(
    problem: Problem, base: Fit, promised: Sequence[Promise], least: float, rival: float
) -> Trial | None:
    """Fit a candidate in earnest, in its richest form from the shapes that promise most, and in as plain a
    form as does; None where no prediction is finite.
    """
    forms = sorted({len(p.signature.candidate.fitted): p.signature.candidate for p in promised}.items())
    candidate, fit = forms[-1][1], None
    for promise in promised[: STARTS if len(candidate.fitted) > 1 else 1]:
        if fit is not None and _explained(fit):
            break
        begun = _from(problem, base, candidate, promise, min(rival, np.inf if fit is None else fit.deviance))
        fit = begun if fit is None or not fit.deviance <= begun.deviance else fit
    if fit is None or not (np.isfinite(fit.residual).all() and np.isfinite(fit.jacobian).all()):
        return None
    for _, plain in forms[:-1]:
        plainer = _plainer(fit, plain, candidate)
        spare = max(ACCEPT, form_of([plain]) * (base.deviance - fit.deviance))
        if plainer is not None and plainer.deviance <= fit.deviance + spare:
            candidate, fit = plain, plainer
            break
    drop, share = base.deviance - fit.deviance, 1 - held_out(fit) / held_out(base)
    return Trial(candidate, fit, drop, least, share)


def _from(problem: Problem, base: Fit, candidate: Candidate, promise: Promise, rival: float) -> Fit:
    """Fit a candidate beside a fit from the promised shape and strength on."""
    index, of_shape = len(base.config.effect), promise.signature.candidate
    shape = of_shape.shapes[promise.signature.shape]
    effect = of_shape.effect(shape, promise.strength)
    as_given = problem.with_free(base.config, problem.free_values(problem.config))
    # a calibration without a strong effect may have gone far astray
    starts = [c.model_copy(update={"effect": (*c.effect, effect)}) for c in (base.config, as_given)]
    costs = [float(np.sum(problem.residual(c)[problem.evidence.used] ** 2)) for c in starts]
    parameters = (*base.parameters, *candidate.parameters(index))
    fit = fit_effects(problem, starts[int(np.argmin(costs))], parameters, rival)
    # if not, it led astray, for with next to nothing of the effect it is `base`
    if not fit.deviance <= base.deviance:
        weak = (*base.config.effect, of_shape.effect(shape, WEAK * promise.strength))
        fit = fit_effects(problem, base.config.model_copy(update={"effect": weak}), parameters, rival)
    return fit


def _explained(fit: Fit) -> bool:
    """Whether a fit leaves about what noise does."""
    return fit.deviance < EXPLAINED * fit.problem.evidence.expected * len(fit.remainder)


def _plainer(fit: Fit, plain: Candidate, rich: Candidate) -> Fit | None:
    """A fit of a candidate's last effect in a plainer form, begun from the richer one's; None where what it
    leaves out is plain to see.
    """
    index, gone = len(fit.config.effect) - 1, set(rich.fitted) - set(plain.fitted)
    own = zip(fit.parameters, fit.values, fit.half_width, strict=True)
    if any(p.effect == index and p.key in gone and abs(v) > PLAIN_TO_SEE * half for p, v, half in own):
        return None
    without = {key: rich.of.model_fields[key].default for key in gone}
    effects = (*fit.config.effect[:-1], fit.config.effect[-1].model_copy(update=without))
    kept = [p for p in fit.parameters if not (p.effect == index and p.key in gone)]
    return fit_effects(fit.problem, fit.config.model_copy(update={"effect": effects}), kept)


def held_out(fit: Fit) -> float:
    """The deviance of every fold under the parameters that the other folds give, linear about the fit."""
    problem, total = fit.problem, 0.0
    fold = problem.evidence.fold
    for number in range(problem.evidence.folds):
        mine, others = fold == number, (fold >= 0) & (fold != number)
        step = _step(fit, others)
        rest = fit.residual[mine] - fit.jacobian[mine] @ step
        total += float(np.sum(fit.marginal(mine)(rest) ** 2))
    return total


def _step(fit: Fit, rows: BoolArray) -> FloatArray:
    """The Gauss-Newton step of all parameters on some rows, no longer than half of a parameter's scale."""
    marginal = fit.marginal(rows)
    A, b = marginal(fit.jacobian[rows]), marginal(fit.residual[rows])
    step = np.linalg.lstsq(A, b, rcond=1e-8)[0]
    return np.clip(step, -0.5, 0.5)


def _best(trials: Sequence[Trial]) -> Trial | None:
    """The best accepted trial; one of fewer parameters in its place, where both come down to the same."""
    accepted = [t for t in trials if t.accepted]
    if not accepted:
        return None
    same = [t for t in accepted if same_physics(t, accepted[0])]
    return same[0] if same and same[0].drop > SAME * accepted[0].drop else accepted[0]


def same_physics(simple: Trial, rich: Trial) -> bool:
    """Whether a trial with more parameters comes down to a simple one: at an end, or over the whole screw."""
    config = rich.fit.config
    return config.effect[-1].comes_down_to(config.screw.length_m) == (
        simple.candidate.of,
        simple.candidate.target,
    )


def _pruned(null: Fit, fit: Fit, chosen: list[Trial], crew: Crew) -> tuple[Fit, list[Trial]]:
    """Leave out effects that the others have made needless, the least needed first."""
    while len(chosen) > 1:
        less = crew.each(without, null.problem, [(fit, i) for i in range(len(chosen))])
        costs = [
            f.deviance - fit.deviance - PER_PARAMETER * (len(t.candidate.fitted) - 1)
            for f, t in zip(less, chosen, strict=True)
        ]
        least = int(np.argmin(costs))
        form = form_of([t.candidate for t in chosen])
        if costs[least] >= max(ACCEPT, form * (null.deviance - less[least].deviance)):
            break
        fit, chosen = less[least], [t for i, t in enumerate(chosen) if i != least]
    return fit, chosen


def without(problem: Problem, fit: Fit, effect: int) -> Fit:
    """Fit a hypothesis without the effect that was added as number `effect`."""
    index = effect + len(problem.config.effect)
    effects = [e for i, e in enumerate(fit.config.effect) if i != index]
    kept = [p for p in fit.parameters if p.effect != index]
    moved = [replace(p, effect=p.effect - (p.effect > index)) for p in kept]
    return fit_effects(problem, fit.config.model_copy(update={"effect": tuple(effects)}), moved)


def _blind(found: Sequence[Promise]) -> tuple[Candidate, ...]:
    """The candidates all of whose signatures the free parameters can make up."""
    most: dict[str, tuple[float, Candidate]] = {}
    for p in found:
        candidate = p.signature.candidate
        most[candidate.name] = max(
            most.get(candidate.name, (0.0, candidate)), (p.kept, candidate), key=lambda e: e[0]
        )
    blind = [candidate for kept, candidate in most.values() if kept < BLIND]
    return tuple(sorted(blind, key=lambda c: c.of.confounded_with_scale))
