"""The most likely field, given the prior and the thermocouples of one moment."""

from __future__ import annotations

import numpy as np

from observer.config.machine import EstimatorSettings
from observer.estimators import packing
from observer.estimators.protocol import EstimatorState
from observer.frames import BoolArray, EstimateBlock, EstimateQuality, FloatArray, Inputs, Layout
from observer.model.plant import Plant


class SnapshotEstimator:
    """x = x₀ + G (y - C x₀ - F z) with G = P Cᵀ (C P Cᵀ + R)⁻¹, P the prior's covariance and x₀ a screw at
    the sensors' mean temperature. Heats are not identifiable this way and are NaN.
    """

    def __init__(self, plant: Plant, _settings: EstimatorSettings) -> None:
        """Keep the plant; no setting is needed."""
        self._plant = plant

    @property
    def layout(self) -> Layout:
        """Return the meaning of the estimates' columns."""
        return self._plant.layout

    def initial(self) -> EstimatorState:
        """Return the state before the first measurement; `run` leaves it unchanged."""
        return packing.initial_state(self._plant)

    def run(self, state: EstimatorState, inputs: Inputs) -> tuple[EstimatorState, EstimateBlock]:
        """Estimate K steps, each independent of the others."""
        rows, K = self._plant.rows, len(inputs)
        value, sigma = np.empty((K, len(rows.C))), np.empty((K, len(rows.C)))
        for k in range(K):
            value[k], sigma[k] = self._moment(inputs.y_degC[k], inputs.usable[k], inputs.z_end[k])
        heat_W = np.full((K, len(self.layout.sources)), np.nan)
        error_um, error_sigma_um = value[:, rows.error_slice], sigma[:, rows.error_slice]
        some = inputs.usable.any(axis=1)
        return state, EstimateBlock(
            time_s=inputs.time_s,
            heat_W=heat_W,
            heat_sigma_W=heat_W,
            field_degC=value[:, rows.field_slice],
            field_sigma_K=sigma[:, rows.field_slice],
            error_um=error_um,
            error_sigma_um=error_sigma_um,
            innovation_K=np.where(inputs.usable, inputs.y_degC - value[:, rows.sensor_slice], np.nan),
            sensor_quality=inputs.quality,
            quality=np.where(some, EstimateQuality.DEGRADED, EstimateQuality.INVALID).astype(np.int8),
            innovation_sigma_K=np.where(inputs.usable, sigma[:, rows.sensor_slice], np.nan),
            law_W=inputs.law_W[:, self._plant.estimated],
        )

    def _moment(self, y_degC: FloatArray, good: BoolArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return value and standard deviation of every output row, (R,), given the good sensors."""
        plant, rows = self._plant, self._plant.rows
        if not good.any():
            return np.full((2, len(rows.C)), np.nan)
        P = plant.prior_P
        C, F, R = rows.C[rows.sensor_slice][good], rows.F[rows.sensor_slice][good], plant.noise_R_K2[good]
        start = plant.uniform * y_degC[good].mean()
        G = np.linalg.solve(C @ P @ C.T + np.diag(R), C @ P).T
        x_hat = start + G @ (y_degC[good] - C @ start - F @ z)
        left = P - G @ C @ P
        variance = np.einsum("ri,ij,rj->r", rows.C, left, rows.C)
        return rows.C @ x_hat + rows.F @ z, np.sqrt(np.maximum(variance, 0.0))
