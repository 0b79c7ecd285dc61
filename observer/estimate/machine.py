"""A machine: its configuration, and what follows from it for whoever runs it, live or replayed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from observer.align.aligner import AlignPlan
from observer.config import Config
from observer.estimate.pipeline import Pipeline
from observer.estimators import build_estimator
from observer.estimators.protocol import Estimator
from observer.estimators.selftest import SelfTest
from observer.estimators.tolerant import Tolerant
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.plant import Plant
from observer.model.realise import realise
from observer.quality.gap import GapWatch


@dataclass(frozen=True)
class Machine:
    """A configuration with the plant, the drive and the expectations of its channels that follow from it.

    Each part is built once, however often it is asked for; none of them holds a state.
    """

    config: Config
    plant: Plant
    drive: Drive
    plan: AlignPlan

    @classmethod
    def of(cls, config: Config, *, learns: bool = False) -> Machine:
        """Build the parts of a configuration; with `learns`, with what its estimator learns or allows for."""
        plant = build_plant(config, learns=learns and config.estimator.allows)
        return cls(config, plant, Drive(config, plant), AlignPlan.of(config))

    @cached_property
    def with_law(self) -> frozenset[str]:
        """The names of the sources whose heat has a law."""
        return frozenset(s.name for s in realise(self.config).config.source if s.law is not None)

    @cached_property
    def _tolerant(self) -> Tolerant | None:
        free = (
            n for n, is_free in zip(self.plant.source_names, self.plant.estimated, strict=True) if is_free
        )
        if not self.with_law.issuperset(free):
            return None
        return Tolerant(
            self.plant if self.plant.learning is not None else build_plant(self.config, learns=True)
        )

    @cached_property
    def _estimator(self) -> Estimator:
        integrity = self.config.integrity
        return build_estimator(self.plant, self.config.estimator, integrity if integrity.enabled else None)

    def estimator(self) -> Estimator:
        """The estimator as designed. Raises `UserError` where no gain to be trusted exists."""
        return self._estimator

    def self_test(self) -> SelfTest:
        """What holds the estimates against the model and the laws."""
        return SelfTest(self.plant, self.with_law)

    def gap(self) -> GapWatch | None:
        """What watches the prediction, None where a heat has no law to be predicted by."""
        return None if self._tolerant is None else GapWatch(self._tolerant, self.plant.layout.sensors)

    def pipeline(self, estimator: Estimator | None = None) -> Pipeline[Any]:
        """Frames in, estimates out, of the quality that they earn; by another estimator if one is given."""
        return Pipeline(self.drive, estimator or self.estimator(), self.self_test(), self.gap())
