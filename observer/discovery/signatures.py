"""How the prediction changes with each candidate: the signature it would leave in the measurements."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.discovery.candidates import Candidate
from observer.discovery.crew import ALONE, Crew
from observer.discovery.mistakes import deviance
from observer.fit.hypothesis import Fit
from observer.fit.problem import Problem, told_lags
from observer.frames import FloatArray


class Signature(NamedTuple):
    """The whitened change (n,) of the prediction with one shape of a candidate."""

    candidate: Candidate
    shape: int
    change: FloatArray


class Promise(NamedTuple):
    """What a signature promises beside a fit.

    `strength` is that of the shape which explains most within the bounds, `drop` the fall of the deviance it
    would bring; `kept` is the part of the signature that the free parameters cannot make up.
    """

    signature: Signature
    strength: float
    drop: float
    kept: float


def signatures(
    problem: Problem, config: Config, candidates: Sequence[Candidate], crew: Crew = ALONE
) -> list[Signature]:
    """Return the signatures of all shapes; those that move nothing are left out."""
    kinds = groupby(sorted(candidates, key=lambda c: c.kind), key=lambda c: c.kind)
    groups = [tuple(group) for _, group in kinds]
    found = crew.each(_changes, problem, [(config, group) for group in groups])
    changes = [
        (group[number], shape, change)
        for group, own in zip(groups, found, strict=True)
        for number, shape, change in own
    ]
    columns = problem.evidence.whitened(np.column_stack([change for _, _, change in changes]))
    return [
        Signature(candidate, shape, column)
        for (candidate, shape, _), column in zip(changes, columns.T, strict=True)
        if np.linalg.norm(column) > 1e-9
    ]


def promises(base: Fit, found: Sequence[Signature], *, everywhere: bool = False) -> list[Promise]:
    """Return what each signature promises beside a fit: on the rows that were fitted, or on all of them."""
    out: list[Promise] = []
    problem, used = base.problem, base.problem.evidence.used
    used = np.ones_like(used) if everywhere else used
    before = deviance(base) if everywhere else base.deviance
    by_tolerance: dict[frozenset[str], list[Signature]] = {}
    for s in found:
        effect = s.candidate.effect(s.candidate.shapes[s.shape])
        by_tolerance.setdefault(told_lags(base.config, effect), []).append(s)
    for told, group in by_tolerance.items():
        marginal = problem.marginal(used, told)
        Q, _ = np.linalg.qr(marginal(base.jacobian[used]))
        remainder = marginal(base.residual[used])
        remainder = remainder - Q @ (Q.T @ remainder)  # the free parameters fitted to these tolerances
        price = before - float(np.sum(remainder**2))
        columns = marginal(np.column_stack([s.change for s in group])[used])
        rest = columns - Q @ (Q.T @ columns)
        rest = rest - Q @ (Q.T @ rest)  # twice is enough (Giraud, Langou & Rozložník 2005)
        length, left = np.linalg.norm(columns, axis=0), np.linalg.norm(rest, axis=0)
        along = rest.T @ remainder
        for j, s in enumerate(group):
            low, high = s.candidate.strengths(s.candidate.shapes[s.shape])
            strength = min(max(float(along[j] / max(left[j] ** 2, 1e-12)), low), high)
            drop = price + strength * (2 * float(along[j]) - strength * float(left[j] ** 2))
            out.append(Promise(s, strength, drop, float(left[j] / length[j])))
    return out


def _changes(
    problem: Problem, config: Config, group: Sequence[Candidate]
) -> list[tuple[int, int, FloatArray]]:
    """Of each candidate of one kind, by its number, and of each of its shapes, by its number, the change (n,)
    in K of the prediction.
    """
    here = problem.predicted(config)

    def change(*effects: object) -> FloatArray:
        more = config.model_copy(update={"effect": (*config.effect, *effects)})
        return problem.predicted(more) - here

    changes = []
    if group[0].of.targets == "sensor":  # each moves its own sensor only: all at once
        names = [s.name for s in config.sensor]
        for i in range(len(group[0].shapes)):
            whole = change(*(c.effect(c.shapes[i]) for c in group))
            own = [problem.evidence.sensor == names.index(str(c.target)) for c in group]
            changes += [(number, i, np.where(rows, whole, 0.0)) for number, rows in enumerate(own)]
        return changes
    for number, c in enumerate(group):
        sums = c.of.sums(c.shapes)
        parts = {j: change(c.effect(c.shapes[j])) for j in sorted({j for parts in sums for j in parts})}
        changes += [(number, i, np.sum([parts[j] for j in own], axis=0)) for i, own in enumerate(sums)]
    return changes
