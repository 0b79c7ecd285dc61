"""The map from heats to readings over a log, as the plant's own step: Z = H Q without the matrix H.

H times a history is one sweep of the plant forward, its transpose one sweep back (`observer.kernels.sweep`).
The nut is at its position in each step, steps have any length, and states may be coupled. Source: Li et al.
(2022), equations 28 to 31, in modes and step by step.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from observer.errors import UserError
from observer.estimators import packing
from observer.estimators.steps import chunks
from observer.frames import FloatArray, Inputs
from observer.history.prior import HeldSteps, independent, jumps_W
from observer.kernels import record, run_sweep, run_sweep_back
from observer.model.plant import Plant
from observer.model.simulate import simulate

_NEGLIGIBLE = 1e-10
_POWERS = 8


class Readings(NamedTuple):
    """The readings of K rows minus those expected by the heat laws, from the first row with a measurement on.

    Attributes:
        first: That row of the log.
        inputs: Inputs of the K rows.
        rise_K: Z, K, (K, s), 0 without a measurement.
        weight_1_K: One over the noise, 1/K, (K, s), 0 without a measurement.
    """

    first: int
    inputs: Inputs
    rise_K: FloatArray
    weight_1_K: FloatArray

    @property
    def measurements(self) -> int:
        """Number of values; with the correct heats the sum of the weighted squares is about this."""
        return int(np.count_nonzero(self.weight_1_K))

    def unexplained(self, rows_K: FloatArray) -> FloatArray:
        """Return Z minus rows (K, s) in K, NaN without a measurement."""
        return np.where(self.weight_1_K > 0.0, self.rise_K - rows_K, np.nan)


def readings(plant: Plant, blocks: Sequence[Inputs], order: int) -> Readings:
    """Return the readings of a log minus those that the prior expects.

    The expected ones start from a screw of one temperature, the median of the first readings.

    Args:
        plant: The model.
        blocks: Consecutive blocks of inputs.
        order: Order of the prior, 0 or 1.

    Raises:
        UserError: If fewer than three steps remain from the first one with a measurement.
    """
    if order == 0:
        blocks = independent(plant, blocks).blocks
    plant = plant.sensors_only()
    s = plant.rows.sensors
    inputs = Inputs.joined(blocks).sensors_only(s)
    complete = np.isfinite(inputs.z_end).all(axis=1) & np.isfinite(inputs.z_start).all(axis=1)
    usable = inputs.usable & np.isfinite(inputs.y_degC)
    ready = np.flatnonzero(complete & usable.any(axis=1))
    if not len(ready) or ready[0] > len(inputs) - 3:
        raise UserError("the log holds fewer than three steps with a measurement; record for longer")
    first = int(ready[0])
    inputs, usable = inputs.part(first), usable[first:]
    x = _start_mean(plant, inputs, usable[0])
    expected = np.vstack([_rows_at(plant, inputs, x), simulate(plant, x, inputs.part(1))[1]])
    rise = np.where(usable, inputs.y_degC - expected, 0.0)
    return Readings(first, inputs, rise, np.where(usable, 1.0 / np.sqrt(plant.noise_R_K2), 0.0))


class _Stretch(NamedTuple):
    """Some rows of a log in the form that kernels take, and whether the log begins with them."""

    rows: slice
    batch: Any
    begins: bool


class Sweeps:
    """H S over a log, with c histories at once; S makes heats from numbers of variance 1 by a prior.

    A history is a column of V (r + K m_e, c). The first r numbers are the uncertain field at the start, none
    in order 0. The others are one for each heat's jump at the start of each row's step.

    Attributes:
        start: r.
        rows: K.
        heats: m_e.
        sensors: Number s of sensors.
    """

    def __init__(self, plant: Plant, inputs: Inputs, order: int, *, start_known: bool | None = None) -> None:
        """Prepare the sweeps.

        Args:
            plant: The model.
            inputs: K steps of the log.
            order: Order of the prior, 0 or 1.
            start_known: Whether the field at the start is known. None: it is in order 0.
        """
        plant = plant.sensors_only()
        arrays = packing.pack_plant(plant)
        plant_record, self._work = record(arrays), record(packing.scratch(arrays))
        self._states, self._n_x = packing.states_of(plant), len(plant.decay_1_s)
        self._scale, _ = jumps_W(plant, inputs, order)
        self._stretches = [
            _Stretch(
                c.part, record(packing.Batch(plant_record, c.table, c.inputs, c.step)), c.part.start == 0
            )
            for c in chunks(HeldSteps(plant, keeps=order == 1), inputs)
        ]
        is_known = order == 0 if start_known is None else start_known
        self._root = _square_root(plant.prior_P)[:, : 0 if is_known else None]
        self.start, (self.rows, self.heats) = self._root.shape[1], self._scale.shape
        self.sensors = plant.rows.sensors

    @property
    def unknowns(self) -> int:
        """Number of entries of a history, r + K m_e."""
        return int(self.start + self.rows * self.heats)

    def forward(self, V: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the heats and readings of c histories by one sweep over the log.

        Args:
            V: The histories, (r + K m_e, c).

        Returns:
            Heats beyond their laws, W, (K, m_e, c), and readings beyond the expected ones, K, (K, s, c).
        """
        c = V.shape[1]
        X = np.zeros((self._states, c))
        X[: self._n_x] = self._root @ V[: self.start]
        unit = V[self.start :].reshape(self.rows, self.heats, c)
        w = np.multiply(self._scale[:, :, None], unit, order="C")
        heat, rows = np.zeros((self.rows, self.heats, c)), np.zeros((self.rows, self.sensors, c))
        for s in self._stretches:
            run_sweep(s.batch, self._work, X, s.begins, w[s.rows], heat[s.rows], rows[s.rows])
        heat[0] = heat[1]
        return heat, rows

    def adjoint(self, rows: FloatArray) -> FloatArray:
        """Return (H S)ᵀ times readings by one sweep back, exact to rounding.

        Args:
            rows: Readings, (K, s, c).

        Returns:
            Histories, (r + K m_e, c).
        """
        c = rows.shape[2]
        R, w = np.zeros((self._states, c)), np.zeros((self.rows, self.heats, c))
        for s in reversed(self._stretches):
            run_sweep_back(s.batch, self._work, R, s.begins, rows[s.rows], w[s.rows])
        w *= self._scale[:, :, None]
        return np.vstack([self._root.T @ R[: self._n_x], w.reshape(-1, c)])

    def largest(self, weight_1_K: FloatArray) -> float:
        """Return approximately the largest eigenvalue of (H S)ᵀ R⁻¹ H S, by eight powers of it.

        Args:
            weight_1_K: One over the noise, 1/K, (K, s), 0 without a measurement.
        """
        V = np.random.default_rng(0).standard_normal((self.unknowns, 1))
        size = 1.0
        for _ in range(_POWERS):
            V = self.adjoint(weight_1_K[:, :, None] ** 2 * self.forward(V / np.linalg.norm(V))[1])
            size = float(np.linalg.norm(V))
        return size


def _start_mean(plant: Plant, inputs: Inputs, usable: FloatArray) -> FloatArray:
    """Return the state (n_x,) from which the Kalman filter starts, before its first correction.

    It is a screw of one temperature, the median of the usable sensors (s,), with its lags at rest under their
    laws.
    """
    x = inputs.law_W[0] @ plant.lags
    of_uniform = _rows_at(plant, inputs, plant.uniform) - plant.rows.F @ inputs.z_end[0]
    level = inputs.y_degC[0].copy()
    by_modes = of_uniform > 0.5
    level[by_modes] = (inputs.y_degC[0] - _rows_at(plant, inputs, x))[by_modes] / of_uniform[by_modes]
    return np.asarray(x + plant.uniform * np.median(level[usable]))


def _rows_at(plant: Plant, inputs: Inputs, x: FloatArray) -> FloatArray:
    """Return the readings (s,) of the sensors for the state x in the first row, °C."""
    C = plant.rows.C.copy()
    for i, source in enumerate(plant.moving):
        C[:, plant.modes + source.index] = inputs.moving_C[0, i]
    return np.asarray(C @ x + plant.rows.F @ inputs.z_end[0])


def _square_root(P: FloatArray) -> FloatArray:
    """Return columns (n, r) whose squares add up to the covariance P."""
    values, vectors = np.linalg.eigh(P)
    positive = values > _NEGLIGIBLE * max(float(values[-1]), 1e-300)
    return np.asarray(vectors[:, positive] * np.sqrt(values[positive]))
