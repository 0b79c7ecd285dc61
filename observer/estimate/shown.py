"""The shown heats: every estimated heat, and those that follow another one as a fraction of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.frames import EstimateBlock, FloatArray, Layout
from observer.model.plant import Plant


class ShownHeats(NamedTuple):
    """The shown heats, in the order of the configuration.

    Attributes:
        names: The names of the sources.
        column: The column of the estimate from which each comes, (shown,).
        part: The fraction of that column, (shown,).
        estimated_columns: The shown columns that are the estimated heats, (m_e,).
    """

    names: tuple[str, ...]
    column: NDArray[np.int64]
    part: FloatArray
    estimated_columns: NDArray[np.int64]

    @classmethod
    def of(cls, plant: Plant) -> ShownHeats:
        """Return the shown heats of a plant."""
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
        """Whether more heats are shown than estimated."""
        return len(self.names) > len(self.estimated_columns)

    def heats(self, heat_W: FloatArray) -> FloatArray:
        """Return shown heats or their σ in W, (K, shown), from those of the estimate, (K, m_e)."""
        return np.asarray(heat_W[:, self.column] * self.part)

    def layout(self, layout: Layout) -> Layout:
        """Return the columns of the shown estimates."""
        return replace(layout, sources=self.names) if self.changes else layout

    def block(self, block: EstimateBlock) -> EstimateBlock:
        """Return the shown estimates of a block of the estimator."""
        if not self.changes:
            return block
        return _with_heats(block, self.heats)

    def estimated(self, block: EstimateBlock) -> EstimateBlock:
        """Return the estimator's block of shown estimates: the inverse of `block`."""
        if not self.changes:
            return block
        return _with_heats(block, lambda heats: heats[:, self.estimated_columns])


def _with_heats(block: EstimateBlock, of: Callable[[FloatArray], FloatArray]) -> EstimateBlock:
    """Return estimates with all columns of heats rebuilt."""
    return replace(
        block,
        heat_W=of(block.heat_W),
        heat_sigma_W=of(block.heat_sigma_W),
        law_W=of(block.law_W),
        heat_bound_W=of(block.heat_bound_W),
    )
