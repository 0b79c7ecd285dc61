"""The linear plant run forward, for tests whose truth may be the model itself."""

import numpy as np

from observer.model.discretise import step_matrices
from tests.estimators.plants import AMBIENT_DEGC


def temperatures(plant, u, heat_W, seed=0, noise_K=0.05):
    """Sensor temperatures (K, s) under heats heat_W(time since start) (m,), from rest at the ambient's
    temperature.
    """
    rng = np.random.default_rng(seed)
    x = plant.uniform * AMBIENT_DEGC
    y = np.empty(u.y_degC.shape)
    for k in range(len(u)):
        step = step_matrices(plant, float(u.dt_s[k]))
        q = heat_W(u.time_s[k] - u.time_s[0])
        x = step.decay * x + step.hold * (plant.B @ q + plant.E @ u.z_start[k])
        x += step.ramp * (plant.E @ (u.z_end[k] - u.z_start[k]))
        y[k] = plant.rows.C[: plant.rows.sensors] @ x + plant.rows.F[: plant.rows.sensors] @ u.z_end[k]
    return y + noise_K * rng.normal(size=y.shape)
