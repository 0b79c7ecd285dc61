"""What dropping modes costs right after a heat step, before the dropped ones have settled."""

from __future__ import annotations

import numpy as np

from observer.config import Config
from observer.frames import FloatArray, Inputs
from observer.model.build import build_plant
from observer.model.plant import Plant
from observer.model.simulate import simulate, start

REFERENCE_MODES = 400


def transient_error_K_W(config: Config, plant: Plant, times_s: tuple[float, ...]) -> FloatArray:
    """Return the largest field error per W of a heat step at each time after it, over sources, (t,), K/W.

    The reference is the same screw with 400 modes; nuts stand still, spread over their stroke.
    """
    more = config.model.model_copy(update={"modes": REFERENCE_MODES, "static_correction": True})
    reference = build_plant(config.model_copy(update={"model": more}))
    worst = np.zeros(len(times_s))
    for source in range(len(plant.source_names)):
        gap = _step_response(plant, source, times_s) - _step_response(reference, source, times_s)
        worst = np.maximum(worst, np.abs(gap).max(axis=1))
    return worst


def _step_response(plant: Plant, source: int, times_s: tuple[float, ...]) -> FloatArray:
    """The field (t, g) after 1 W of one source has been switched on at 0 K."""
    K, m, p = len(times_s), len(plant.source_names), len(plant.known_names)
    law_W = np.zeros((K, m))
    law_W[:, source] = 1.0
    s, M = plant.rows.sensors, len(plant.moving)
    inputs = Inputs(
        time_s=np.array(times_s),
        dt_s=np.diff(times_s, prepend=0.0),
        y_degC=np.zeros((K, s)),
        usable=np.zeros((K, s), dtype=bool),
        quality=np.zeros((K, s), dtype=np.int8),
        law_W=law_W,
        law_jump_W=np.zeros((K, m)),
        z_start=np.zeros((K, p)),
        z_end=np.zeros((K, p)),
        moving_B=np.array([[plant.B[:, x.index] for x in plant.moving]] * K).reshape(
            K, M, len(plant.decay_1_s)
        ),
        moving_C=np.array([[x.table.mean_C for x in plant.moving]] * K).reshape(K, M, len(plant.rows.C)),
        degraded=np.zeros(K, dtype=bool),
        loss_1_s=np.zeros(K),
        loss_degC=np.zeros(K),
    )
    rows = simulate(plant, start(plant, 0.0, np.zeros(m)), inputs)[1]
    return rows[:, plant.rows.field_slice]
