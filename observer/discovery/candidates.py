"""Where a search begins: every effect of the library, at every target, in the shapes it may take.

A shape is an effect at a typical strength; how the prediction changes with it is the effect's signature. What
is known of an effect stands in its class; nothing here knows one by its name.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from observer.effects.base import EffectTable, Fitted, Shape
from observer.effects.catalogue import LIBRARY
from observer.fit.hypothesis import Parameter
from observer.tables.sections import Description


class Candidate(NamedTuple):
    """An effect at a target: the shapes to try, and what is fitted on the machine in question."""

    of: type[EffectTable]
    target: str | None
    shapes: tuple[Shape, ...]
    fitted: Mapping[str, Fitted]

    @property
    def kind(self) -> str:
        """The effect's kind."""
        return self.of.named()

    @property
    def name(self) -> str:
        """Kind and target."""
        return self.kind if self.target is None else f"{self.kind} at {self.target}"

    def effect(self, shape: Shape, strength: float = 1.0) -> EffectTable:
        """Return the effect in one of its shapes, so many times as strong."""
        values = dict(shape)
        for p, neutral in self._strong():
            values[p.key] = float(np.clip(neutral + strength * (shape[p.key] - neutral), p.low, p.high))
        target = {} if self.target is None else {"target": self.target}
        return self.of.model_validate({"kind": self.kind, **target, **values})

    def strengths(self, shape: Shape) -> tuple[float, float]:
        """The range of strengths that the bounds of the effect allow."""
        low, high = -np.inf, np.inf
        for p, neutral in self._strong():
            ends = sorted((limit - neutral) / (shape[p.key] - neutral) for limit in (p.low, p.high))
            low, high = max(low, ends[0]), min(high, ends[1])
        return low, high

    def parameters(self, index: int) -> tuple[Parameter, ...]:
        """What is fitted where the effect is number `index` of the configuration."""
        bounds = {key: self.of.bounds(key) for key in self.fitted}
        return tuple(
            Parameter(
                index, key, p.scale, max(bounds[key][0], p.low), min(bounds[key][1], p.high), p.open_above
            )
            for key, p in self.fitted.items()
        )  # fmt: skip

    def _strong(self) -> list[tuple[Parameter, float]]:
        """The parameters that a strength multiplies, all together, each with its neutral value."""
        every = zip(self.parameters(0), self.fitted.values(), strict=True)
        return [(p, known.neutral) for p, known in every if known.neutral is not None]


def library(
    machine: Description, free: Collection[str], without: Sequence[str] = (), *, coarse: bool = False
) -> tuple[Candidate, ...]:
    """Return the candidates of a machine whose free parameters are `free`, but for some kinds; and for those
    of a nut's way where the rows of some log are too `coarse` to tell it.
    """
    length_m = machine.screw.length_m
    return tuple(
        Candidate(
            effect, target, tuple({key: shape[key] for key in form} for shape in effect.shapes(machine)),
            {key: effect.parameters[key].on(length_m) for key in form},
        )
        for effect in LIBRARY
        if effect.named() not in without and not (coarse and effect.on_the_way)
        for target in effect.places(machine, free)
        for form in effect.forms(machine, target, free)
    )  # fmt: skip
