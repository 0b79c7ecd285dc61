"""Open-loop prediction: the plant driven by its heat laws alone, with nothing measured to correct it."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from observer.frames import FloatArray, Inputs
from observer.model.discretise import _hold, _ramp
from observer.model.plant import Plant


@dataclass(frozen=True, slots=True)
class SimulationState:
    """The plant's state (n_x,) between two blocks of a simulation."""

    x: FloatArray


def start(plant: Plant, temperature_degC: float, law_W: FloatArray) -> SimulationState:
    """Return the state of a screw at one temperature, its lags settled at the heats (m,) of the moment."""
    x = plant.uniform * temperature_degC
    x[plant.modes :] = law_W
    return SimulationState(x)


def start_from_sensors(
    plant: Plant, y_degC: FloatArray, noise_R_K2: FloatArray, law_W: FloatArray, z: FloatArray
) -> SimulationState:
    """Return the most probable state of a screw whose sensors read `y_degC`, its lags settled at the heats.

    x = x̄ + P Cᵀ (C P Cᵀ + R)⁻¹ (y − C x̄ − F z), with x̄ the screw at the sensors' mean and P the prior of a
    smooth unknown field, widened where the sensors spread further than the prior expects (Rasmussen &
    Williams 2006, eq. 2.25).

    Takes `y_degC`, `noise_R_K2` (s,), a sensor without a value as NaN; `law_W` (m,); `z` (p,). Raises
    `ValueError` where no sensor has a value.
    """
    seen = np.flatnonzero(np.isfinite(y_degC))
    if len(seen) == 0:
        raise ValueError("no sensor has a value to start from")
    C, y = plant.rows.C[seen], y_degC[seen]
    x = start(plant, float(np.mean(y)), law_W).x
    PC = plant.prior_P @ C.T
    prior_S = C @ PC
    widen = max(1.0, float(np.ptp(y) ** 2 / np.max(np.diag(prior_S))))
    gain = np.linalg.solve(widen * prior_S + np.diag(noise_R_K2[seen]), widen * PC.T).T
    return SimulationState(x + gain @ (y - C @ x - plant.rows.F[seen] @ z))


def simulate(plant: Plant, state: SimulationState, inputs: Inputs) -> tuple[SimulationState, FloatArray]:
    """Return the state after K steps and the output rows (K, R) at their ends, in °C and µm."""
    x = state.x.copy()
    rows = np.empty((len(inputs), len(plant.rows.C)))
    moving = np.array([s.index for s in plant.moving], dtype=np.int64)
    _run(
        x, rows, plant.decay_1_s, plant.B.copy(), plant.E, plant.rows.C.copy(), plant.rows.F, plant.modes,
        inputs.dt_s, inputs.law_W, inputs.z_start, inputs.z_end, moving, inputs.moving_B, inputs.moving_C,
    )  # fmt: skip
    return SimulationState(x), rows


@numba.njit(cache=True)
def _run(  # type: ignore[no-untyped-def]
    x, rows, decay, B, E, C, F, modes, dt_s, law_W, z_start, z_end, moving, moving_B, moving_C,
):  # fmt: skip
    """March x in place: exact for heats constant and known inputs linear over each step."""
    n_x, m = B.shape
    p = E.shape[1]
    hold, ramp, keep = np.empty(n_x), np.empty(n_x), np.empty(n_x)
    dt_known = -1.0
    for k in range(len(dt_s)):
        dt = dt_s[k]
        if dt != dt_known:
            for i in range(n_x):
                keep[i] = np.exp(-decay[i] * dt)
                hold[i], ramp[i] = _hold(decay[i], dt), _ramp(decay[i], dt)
            dt_known = dt
        for i in range(len(moving)):
            B[:, moving[i]] = moving_B[k, i]
            C[:, modes + moving[i]] = moving_C[k, i]
        for i in range(n_x):
            rate_start, rate_end = 0.0, 0.0
            for j in range(p):
                rate_start += E[i, j] * z_start[k, j]
                rate_end += E[i, j] * z_end[k, j]
            for j in range(m):
                rate_start += B[i, j] * law_W[k, j]
                rate_end += B[i, j] * law_W[k, j]
            x[i] = keep[i] * x[i] + (hold[i] - ramp[i]) * rate_start + ramp[i] * rate_end
        for r in range(len(C)):
            value = 0.0
            for i in range(n_x):
                value += C[r, i] * x[i]
            for j in range(p):
                value += F[r, j] * z_end[k, j]
            rows[k, r] = value
