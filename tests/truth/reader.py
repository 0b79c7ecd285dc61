"""Reads a finite-volume field between its cells."""

from __future__ import annotations

import numpy as np

from tests.truth.bar import Bar, End, FloatArray, Mesh


class Reader:
    """Reads temperature and its integral anywhere from cell means: faces by a parabola, linear in between."""

    def __init__(self, bar: Bar, mesh: Mesh, ends: tuple[End, End], position_m: FloatArray) -> None:
        self._bar, self._mesh, self._ends, self.position_m = bar, mesh, ends, position_m
        nodes = np.concatenate([[0.0], mesh.centres_m, [mesh.length_m]])
        self._low = np.clip(np.searchsorted(nodes, position_m, side="right") - 1, 0, mesh.cells)
        self._part = ((position_m - nodes[self._low]) / np.diff(nodes)[self._low])[:, None]
        self._cell = np.clip((position_m / mesh.width_m).astype(int), 0, mesh.cells - 1)
        self._into_m = (position_m - self._cell * mesh.width_m)[:, None]

    def read(
        self, field: FloatArray, outside: FloatArray, flux_W: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Temperature and integral (P, R).

        `field` (cells, R): cell means; `outside`: [left, right, ambient]; `flux_W` (2, R): the face heats.
        """
        left = self._face(field[:2], 0, outside, flux_W[0])
        right = self._face(field[:-3:-1], 1, outside, flux_W[1])
        nodes = np.concatenate([left[None], field, right[None]])
        temperature = nodes[self._low] * (1.0 - self._part) + nodes[self._low + 1] * self._part
        whole = np.zeros((len(field) + 1, field.shape[1]))
        np.cumsum(field * self._mesh.width_m, axis=0, out=whole[1:])
        return temperature, whole[self._cell] + field[self._cell] * self._into_m

    def _face(self, pair: FloatArray, side: int, outside: FloatArray, flux_W: FloatArray) -> FloatArray:
        """Face temperature (R,) by a parabola: the means of two cells, outermost first, and the slope."""
        end, dx = self._ends[side], self._mesh.width_m
        if end.kind == "prescribed":
            return np.full(pair.shape[1], outside[side])
        # face = (7 T_0 − T_1)/6 − s dx/3 with s = dT/dn into the bar = (h A (face − T_amb) − q)/(k A)
        lever = dx / 3.0 / self._bar.conductance_Wm_K
        film = end.coefficient_W_m2K * self._bar.area_m2 if end.kind == "convective" else 0.0
        plain = (7.0 * pair[0] - pair[1]) / 6.0
        return (plain + lever * (film * outside[2] + flux_W)) / (1.0 + lever * film)
