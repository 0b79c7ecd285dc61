"""The candidates of a search: every effect of the library, at every target, in its possible shapes.

A shape is an effect at a typical strength. The change of the prediction with a shape is the effect's
signature. All properties of an effect are in its class; nothing here depends on a particular effect.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import groupby
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from observer.config.effects.base import EffectTable, Fitted, Shape
from observer.config.effects.catalogue import LIBRARY, effect_class
from observer.config.effects.terms import SensorOffset
from observer.config.machine import Config
from observer.config.sections import Description
from observer.discovery.workers import IN_PROCESS, WorkerPool
from observer.errors import ConfigError
from observer.fit.hypothesis import EffectParameter, Fit
from observer.fit.linear import unabsorbed
from observer.fit.problem import Problem, modelled_lags
from observer.frames import FloatArray
from observer.model.build import refuse_on_followed

PER_PARAMETER = 6.0
"""Drop of the deviance required for each parameter beyond the first."""


def score(drop: float, parameters: int) -> float:
    """Return a drop of the deviance less the drop required of its parameters.

    Args:
        drop: Fall of the deviance.
        parameters: Number of parameters of an effect or a log fault. Each beyond the first costs
            `PER_PARAMETER`.
    """
    return drop - PER_PARAMETER * (parameters - 1)


class Candidate(NamedTuple):
    """An effect at a target, to be fitted.

    Attributes:
        of: The effect's class.
        target: Source, sensor, end or node at which it acts; None for the whole screw.
        shapes: Typical values of its parameters, from which fits start.
        fitted: The parameters to fit, by key.
        fixed: Keys with fixed values.
    """

    of: type[EffectTable]
    target: str | None
    shapes: tuple[Shape, ...]
    fitted: Mapping[str, Fitted]
    fixed: Mapping[str, str | bool] = MappingProxyType({})

    @property
    def kind(self) -> str:
        """The effect's kind, as in `[[effect]] kind`."""
        return self.of.named()

    @property
    def name(self) -> str:
        """Kind and target, as reports print them."""
        return self.kind if self.target is None else f"{self.kind} at {self.target}"

    def effect(self, shape: Shape, strength: float = 1.0) -> EffectTable:
        """Return the effect in one of its shapes.

        Args:
            shape: Values of its parameters.
            strength: Factor on the distance of each strength from its neutral value; the result is clipped to
                the bounds.
        """
        values = dict(shape)
        for p, neutral in self._strong():
            values[p.key] = float(np.clip(neutral + strength * (shape[p.key] - neutral), p.low, p.high))
        target = {} if self.target is None else {"target": self.target}
        return self.of.model_validate({"kind": self.kind, **target, **self.fixed, **values})

    def strengths(self, shape: Shape) -> tuple[float, float]:
        """Return the smallest and the largest strength that the bounds of the effect allow in this shape."""
        low, high = -np.inf, np.inf
        for p, neutral in self._strong():
            ends = sorted((limit - neutral) / (shape[p.key] - neutral) for limit in (p.low, p.high))
            low, high = max(low, ends[0]), min(high, ends[1])
        return low, high

    def parameters(self, index: int) -> tuple[EffectParameter, ...]:
        """Return the fitted parameters of the effect, with bounds and scales.

        Args:
            index: Number of the effect in the configuration.
        """
        bounds = {key: self.of.bounds(key) for key in self.fitted}
        return tuple(
            EffectParameter(
                index, key, p.scale, max(bounds[key][0], p.low), min(bounds[key][1], p.high), p.open_above
            )
            for key, p in self.fitted.items()
        )  # fmt: skip

    def _strong(self) -> list[tuple[EffectParameter, float]]:
        """Return the parameters that a strength multiplies together, each with its neutral value."""
        fitted = zip(self.parameters(0), self.fitted.values(), strict=True)
        return [(p, info.neutral) for p, info in fitted if info.neutral is not None]


def library(
    machine: Description,
    free: Collection[str],
    without: Sequence[str] = (),
    also: Sequence[str] = (),
) -> tuple[Candidate, ...]:
    """Return the candidates of a machine: each effect at each target, in each form.

    Effects on a heat that is tied to those of other sources are left out, because no plant can model them.

    Args:
        machine: The machine.
        free: Keys of its free parameters. Effects that one of them covers are left out.
        without: Kinds that are not tried.
        also: Kinds from outside, as `module:Class` or the name of an entry point.

    Raises:
        ConfigError: If a kind in `also` cannot be loaded.
    """
    length_m = machine.screw.length_m
    candidates = (
        Candidate(
            effect, target, tuple({key: shape[key] for key in form} for shape in effect.shapes(machine)),
            {key: effect.parameters[key].on(length_m) for key in form}, effect.fixed_keys(machine),
        )
        for effect in (*LIBRARY, *map(effect_class, also))
        if effect.named() not in without
        for target in effect.places(machine, free)
        for form in effect.forms(machine, target, free)
    )  # fmt: skip
    return tuple(candidate for candidate in candidates if _is_possible(candidate, machine))


def _is_possible(candidate: Candidate, machine: Description) -> bool:
    """Whether the effect does not act on a heat that is tied to those of other sources, which no plant
    can model.
    """
    try:
        refuse_on_followed(machine, candidate.effect(candidate.shapes[0]).terms(machine))
    except ConfigError:
        return False
    return True


class Signature(NamedTuple):
    """The change of the prediction with one shape of a candidate.

    Attributes:
        candidate: The effect at its target.
        shape: Number of the shape.
        change: Whitened change, (n,).
    """

    candidate: Candidate
    shape: int
    change: FloatArray


class Promise(NamedTuple):
    """The expected benefit of a signature added to a fit.

    Attributes:
        signature: The signature.
        strength: Strength of the shape that explains most within the bounds.
        drop: Fall of the deviance with it.
        unabsorbed: Fraction of the signature that the free parameters cannot absorb, 0 to 1.
    """

    signature: Signature
    strength: float
    drop: float
    unabsorbed: float


def signatures(
    problem: Problem, config: Config, candidates: Sequence[Candidate], pool: WorkerPool = IN_PROCESS
) -> list[Signature]:
    """Return the signatures of all shapes that change a prediction.

    Args:
        problem: Data and free parameters.
        config: Configuration to which the effects are added one at a time.
        candidates: The effects to try.
        pool: Where predictions run; it does not change the result.
    """
    kinds = groupby(sorted(candidates, key=lambda c: c.kind), key=lambda c: c.kind)
    groups = [tuple(group) for _, group in kinds]
    changes_of_groups = pool.map(_changes, problem, [(config, group) for group in groups])
    changes = [
        (group[number], shape, change)
        for group, of_group in zip(groups, changes_of_groups, strict=True)
        for number, shape, change in of_group
    ]
    columns = problem.evidence.whitened(np.column_stack([change for _, _, change in changes]))
    return [
        Signature(candidate, shape, column)
        for (candidate, shape, _), column in zip(changes, columns.T, strict=True)
        if np.linalg.norm(column) > 1e-9
    ]


def promises(base: Fit, marks: Sequence[Signature], *, everywhere: bool = False) -> list[Promise]:
    """Return the promise of each signature added to a fit.

    The part of the signature that the free parameters can absorb is projected out. The drop follows from a
    linear fit of its strength.

    Args:
        base: The fit, linear about itself.
        marks: The signatures.
        everywhere: Whether all rows count, the proof too, instead of the fitted ones.

    Returns:
        Promises, grouped by the lags that the effects model, not in the order of `marks`.
    """
    promises: list[Promise] = []
    problem, used = base.problem, base.problem.evidence.used
    used = np.ones_like(used) if everywhere else used
    before = base.deviance_of_all if everywhere else base.deviance
    by_tolerance: dict[frozenset[str], list[Signature]] = {}
    for s in marks:
        effect = s.candidate.effect(s.candidate.shapes[s.shape])
        by_tolerance.setdefault(modelled_lags(base.config, effect), []).append(s)
    for lags, group in by_tolerance.items():
        marginal = problem.marginal(used, lags)
        columns = marginal(np.column_stack([base.residual, *(s.change for s in group)])[used])
        remaining = unabsorbed(marginal(base.jacobian[used]), columns)  # all free parameters refitted
        residual, changes = remaining[:, 0], remaining[:, 1:]
        price = before - float(np.sum(residual**2))
        length, left = np.linalg.norm(columns[:, 1:], axis=0), np.linalg.norm(changes, axis=0)
        along = changes.T @ residual
        for j, s in enumerate(group):
            low, high = s.candidate.strengths(s.candidate.shapes[s.shape])
            strength = min(max(float(along[j] / max(left[j] ** 2, 1e-12)), low), high)
            drop = price + strength * (2 * float(along[j]) - strength * float(left[j] ** 2))
            promises.append(Promise(s, strength, drop, float(left[j] / length[j])))
    return promises


def _offset_at_start(candidate: Candidate, config: Config) -> bool:
    """Whether an effect adds a constant to a sensor."""
    terms = candidate.effect(candidate.shapes[0]).terms(config)
    return any(isinstance(term, SensorOffset) and term.offset_K != 0.0 for term in terms)


def _changes(
    problem: Problem, config: Config, group: Sequence[Candidate]
) -> list[tuple[int, int, FloatArray]]:
    """Return the change (n,) of the prediction, K, with each shape of each candidate of one kind.

    Each item is (number of the candidate, number of the shape, change).
    """
    predicted = problem.predicted(config)

    def change(*effects: object) -> FloatArray:
        changed = config.model_copy(update={"effect": (*config.effect, *effects)})
        return problem.predicted(changed) - predicted

    changes = []
    # a lag or a drift changes its own sensor only: predict all at once; but an offset is there at the start
    # already, in the field that is read from all sensors
    if group[0].of.targets == "sensor" and not _offset_at_start(group[0], config):
        names = [s.name for s in config.sensor]
        for i in range(len(group[0].shapes)):
            whole = change(*(c.effect(c.shapes[i]) for c in group))
            used = [problem.evidence.sensor == names.index(str(c.target)) for c in group]
            changes += [(number, i, np.where(rows, whole, 0.0)) for number, rows in enumerate(used)]
        return changes
    for number, c in enumerate(group):
        sums = c.of.sums(c.shapes)
        parts = {j: change(c.effect(c.shapes[j])) for j in sorted({j for parts in sums for j in parts})}
        changes += [(number, i, np.sum([parts[j] for j in used], axis=0)) for i, used in enumerate(sums)]
    return changes
