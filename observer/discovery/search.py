"""Choose effects: screen the whole library by signatures, fit the best in earnest, add, and prune.

A signature is the change of the prediction with an effect at a typical strength. What of it the free
parameters could also do is projected out; what of the residual lies along the rest is the drop of the
deviance to be expected. The best few are then fitted with every parameter free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from observer.config import Config
from observer.discovery.candidates import Candidate
from observer.discovery.hypothesis import Fit, Parameter, Problem, fit_effects, with_effects
from observer.frames import BoolArray, FloatArray

MOST_EFFECTS = 3
FITTED = 7
"""How many candidates are fitted in earnest after each screening."""
ACCEPT = 40.0
"""The least drop of the deviance that names an effect; see `docs/discovery.md` for how it was found."""
MATERIAL = 0.06
"""The least part of the deviance on data held out that has to go."""
BLIND = 0.02
"""A signature of which less than this part remains cannot be told from the free parameters."""

Progress = Callable[[str, int], None]


@dataclass(frozen=True)
class Signature:
    """How the prediction of the used rows changes with a shape of a candidate.

    `rest` (n,) is the change, whitened, tolerances marginalised and free parameters projected out; `kept` the
    part of its length that this leaves.
    """

    candidate: Candidate
    shape: int
    rest: FloatArray
    kept: float


@dataclass(frozen=True)
class Trial:
    """A candidate added to a fit: what it explains, and how it stands on data held out."""

    candidate: Candidate
    fit: Fit
    drop: float
    held_out_drop: float

    @property
    def name(self) -> str:
        """The candidate's kind and target."""
        return self.candidate.name


def signatures(problem: Problem, base: Fit, candidates: Sequence[Candidate]) -> list[Signature]:
    """Return the signature of every shape of every candidate beside a fit; those without any are left out."""
    used = problem.evidence.used
    marginal = problem.marginal(used)
    Q, _ = np.linalg.qr(marginal(base.jacobian[used]))
    here = problem.predicted(base.config)
    shapes = [(c, i) for c in candidates for i in range(len(c.shapes))]
    changes = [problem.predicted(added(base.config, c, i)) - here for c, i in shapes]
    columns = marginal(problem.evidence.whitened(np.column_stack(changes))[used])
    rest = columns - Q @ (Q.T @ columns)
    rest = rest - Q @ (Q.T @ rest)  # twice is enough (Giraud, Langou & Rozložník 2005)
    length, left = np.linalg.norm(columns, axis=0), np.linalg.norm(rest, axis=0)
    return [
        Signature(c, i, rest[:, j], float(left[j] / length[j]))
        for j, (c, i) in enumerate(shapes)
        if length[j] > 1e-9
    ]


def added(config: Config, candidate: Candidate, shape: int) -> Config:
    """The configuration with one more effect."""
    return config.model_copy(update={"effect": (*config.effect, candidate.effect(candidate.shapes[shape]))})


def screened(base: Fit, found: Sequence[Signature]) -> list[tuple[float, Signature, float]]:
    """The expected drop, signature and strength (in shapes) of each candidate's best shape, best first."""
    best: dict[str, tuple[float, Signature, float]] = {}
    for s in found:
        if s.kept < BLIND:
            continue
        strength = float(s.rest @ base.remainder) / float(s.rest @ s.rest)
        strength = _allowed(s, strength)
        drop = strength * (2 * float(s.rest @ base.remainder) - strength * float(s.rest @ s.rest))
        if s.candidate.name not in best or drop > best[s.candidate.name][0]:
            best[s.candidate.name] = (drop, s, strength)
    return sorted(best.values(), key=lambda entry: -entry[0])


def _allowed(s: Signature, strength: float) -> float:
    """The strength of a shape that its bounds allow; the first parameter that scales carries it."""
    key = _carrier(s.candidate)
    if key is None:
        return max(strength, 0.0)
    value = s.candidate.shapes[s.shape][key]
    neutral = 1.0 if key == "exponent" else 0.0
    parameter = next(p for p in s.candidate.parameters(0) if p.key == key)
    low, high = (parameter.low - neutral) / (value - neutral), (parameter.high - neutral) / (value - neutral)
    return float(np.clip(strength, low, high))


def _carrier(candidate: Candidate) -> str | None:
    """The parameter in which an effect's strength is linear; none for a body."""
    if candidate.kind == "attached_mass":
        return None
    keys = [k for k in candidate.scales if k not in ("from_m", "to_m", "time_s", "position_m", "inlet_degC")]
    return keys[0]


def try_candidate(problem: Problem, base: Fit, s: Signature, strength: float) -> Trial:
    """Fit a candidate in earnest, from the screened strength on."""
    candidate, index = s.candidate, len(base.config.effect)
    config = added(base.config, candidate, s.shape)
    parameters = (*base.parameters, *candidate.parameters(index))
    key = _carrier(candidate)
    if key is not None:
        value, neutral = candidate.shapes[s.shape][key], 1.0 if key == "exponent" else 0.0
        start = neutral + strength * (value - neutral)
        own = next(p for p in candidate.parameters(index) if p.key == key)
        config = with_effects(config, [own], np.array([np.clip(start, own.low, own.high)]))
    fit = fit_effects(problem, config, parameters)
    return Trial(candidate, fit, base.deviance - fit.deviance, held_out(base) - held_out(fit))


def held_out(fit: Fit) -> float:
    """The deviance of every fold under the parameters that the other folds give, linear about the fit."""
    problem, total = fit.problem, 0.0
    fold = problem.evidence.fold
    for number in range(problem.evidence.folds):
        mine, others = fold == number, (fold >= 0) & (fold != number)
        step = _step(problem, fit, others)
        rest = fit.residual[mine] - fit.jacobian[mine] @ step
        total += float(np.sum(problem.marginal(mine)(rest) ** 2))
    return total


def _step(problem: Problem, fit: Fit, rows: BoolArray) -> FloatArray:
    """The Gauss-Newton step of all parameters on some rows, no longer than half of a parameter's scale."""
    marginal = problem.marginal(rows)
    A, b = marginal(fit.jacobian[rows]), marginal(fit.residual[rows])
    step = np.linalg.lstsq(A, b, rcond=1e-8)[0]
    return np.clip(step, -0.5, 0.5)


def without(problem: Problem, fit: Fit, effect: int) -> Fit:
    """Fit a hypothesis without one of its effects."""
    effects = [e for i, e in enumerate(fit.config.effect) if i != effect]
    kept = [p for p in fit.parameters if p.effect != effect]
    moved = [Parameter(p.effect - (p.effect > effect), p.key, p.scale, p.low, p.high) for p in kept]
    config = fit.config.model_copy(update={"effect": tuple(effects)})
    return fit_effects(problem, config, moved)
