"""A plant as dense matrices, for the peers."""

from __future__ import annotations

import numpy as np

from observer.frames import FloatArray
from observer.model.discretise import augmented, step_matrices
from observer.model.plant import Plant


def dense(plant: Plant, dt_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ad, Qd (n, n) and the sensors' rows (s, n) of the augmented pair, for the peers."""
    Ad, Qd = augmented(plant, step_matrices(plant, dt_s))
    H = np.zeros((plant.rows.sensors, len(Ad)))
    H[:, : len(plant.decay_1_s)] = plant.rows.C[plant.rows.sensor_slice]
    return Ad, Qd, H
