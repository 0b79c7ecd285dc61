"""The shown part of an estimate: every estimated heat, and those that follow another as a fraction of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.frames import EstimateBlock, FloatArray, Layout
from observer.model.plant import Plant


class ShownHeats(NamedTuple):
    """The heats shown, in the order of the configuration: their `names`, the column of the estimate that each
    is a `part` of, and which of the columns shown are the estimate's `own`.
    """

    names: tuple[str, ...]
    column: NDArray[np.int64]
    part: FloatArray
    own: NDArray[np.int64]

    @classmethod
    def of(cls, plant: Plant) -> ShownHeats:
        """Those of a plant."""
        estimated = np.flatnonzero(plant.estimated).tolist()
        parts = {index: (index, 1.0) for index in estimated}
        parts |= {f.source: (f.owner, f.part) for f in plant.following}
        shown = sorted(parts)
        return cls(
            tuple(plant.source_names[i] for i in shown),
            np.array([estimated.index(parts[i][0]) for i in shown], np.int64),
            np.array([parts[i][1] for i in shown]),
            np.array([shown.index(i) for i in estimated], np.int64),
        )

    @property
    def changes(self) -> bool:
        """Whether more is shown than is estimated."""
        return len(self.names) > len(self.own)

    def heats(self, heat_W: FloatArray) -> FloatArray:
        """Heats or their σ (K, m_e) as they are shown."""
        return np.asarray(heat_W[:, self.column] * self.part)

    def layout(self, layout: Layout) -> Layout:
        """What the columns of the estimates shown are."""
        return replace(layout, sources=self.names) if self.changes else layout

    def block(self, block: EstimateBlock) -> EstimateBlock:
        """Estimates as they are shown."""
        if not self.changes:
            return block
        return _with_heats(block, self.heats)

    def estimated(self, block: EstimateBlock) -> EstimateBlock:
        """Estimates that are shown as the estimator gave them."""
        if not self.changes:
            return block
        return _with_heats(block, lambda heats: heats[:, self.own])


def _with_heats(block: EstimateBlock, of: Callable[[FloatArray], FloatArray]) -> EstimateBlock:
    """Estimates with all columns of heats rebuilt."""
    return replace(
        block,
        heat_W=of(block.heat_W),
        heat_sigma_W=of(block.heat_sigma_W),
        law_W=of(block.law_W),
        heat_bound_W=of(block.heat_bound_W),
    )
