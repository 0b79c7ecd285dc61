"""Whether a gain that is designed for a nut spread over its stroke holds where the nut stands still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import eigvals

from observer.estimators.design.gains import closed_loop
from observer.frames import FloatArray
from observer.model.discretise import StepMatrices
from observer.model.plant import Plant
from observer.model.rod.moving import columns_at

_PLACES = 13


def standing_growth_1_s(plant: Plant, step: StepMatrices, K: FloatArray) -> float:
    """Return the fastest growth, 1/s, of the estimate's error with one nut standing at any place of its
    screw; negative where it decays at each, and without nuts -inf.

    Neither what the machine is nor what it does enters this: error's own motion is e⁺ = (I - K C) Ad e with
    the model's C and Ad, of the place. The others are spread over their strokes.
    """
    fastest = 0.0
    for nut in plant.moving:
        half_m = 0.5 * nut.table.nut_m
        for place_m in np.linspace(half_m, nut.table.screw_m - half_m, _PLACES):
            B, C = plant.B.copy(), plant.rows.C.copy()
            B[:, nut.index], C[:, plant.modes + nut.index] = columns_at(nut.table, [float(place_m)])
            here = replace(plant, B=B, rows=replace(plant.rows, C=C))
            fastest = max(fastest, float(np.abs(eigvals(closed_loop(here, step, K))).max()))
    return float(np.log(fastest) / step.dt_s) if fastest > 0.0 else -np.inf
