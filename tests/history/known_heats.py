"""Logs of small plants under known heats, for the methods that find them."""

import numpy as np

from tests.logs.inputs import inputs, temperatures
from tests.logs.plants import AMBIENT_DEGC, rod

DT_S = 6.0


def heat_at(t_s):
    """The three heats at a time, one that decays between two that are even."""
    return np.array([12.0, 30.0 * np.exp(-t_s / 300.0), 6.0])


def logged(steps=120, missing=0.2, noise_K=0.05, **plant_):
    """A plant and a log of it under known heats; the heats (K, 3) too."""
    plant = rod(**({"walk_W_sqrt_s": 0.3, "law_uncertainty": 0.0} | plant_))
    u = inputs(plant, steps=steps, dt_s=DT_S, missing=missing, law_steps=False)
    u.z_start[:], u.z_end[:] = AMBIENT_DEGC, AMBIENT_DEGC
    u.y_degC[:] = temperatures(plant, u, heat_at, noise_K=noise_K)
    u.y_degC[~u.usable] = np.nan
    return plant, u, np.array([heat_at(t - u.time_s[0]) for t in u.time_s])
