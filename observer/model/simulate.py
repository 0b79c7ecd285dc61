"""Open-loop prediction: the plant driven by its heat laws alone, with nothing measured to correct it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.compiled import cached_loop
from observer.frames import FloatArray, Inputs
from observer.model.coupling import couple, faded, swept
from observer.model.discretise import hold, ramp
from observer.model.plant import Plant

_CHUNK = 256
"""Steps worked on at a time: few enough that they stay in the cache."""


@dataclass(frozen=True, slots=True)
class SimulationState:
    """The plant's state (n_x,) between two blocks of a simulation."""

    x: FloatArray


def start(plant: Plant, temperature_degC: float, law_W: FloatArray) -> SimulationState:
    """Return the state of a screw at one temperature, its lags settled at the heats (m,) of the moment."""
    x = plant.uniform * temperature_degC
    x[plant.lag_slice] = law_W
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
    PC = plant.smooth_P @ C.T
    prior_S = C @ PC
    widen = max(1.0, float(np.ptp(y) ** 2 / np.max(np.diag(prior_S))))
    gain = np.linalg.solve(widen * prior_S + np.diag(noise_R_K2[seen]), widen * PC.T).T
    return SimulationState(x + gain @ (y - C @ x - plant.rows.F[seen] @ z))


def simulate(
    plant: Plant, state: SimulationState, inputs: Inputs, sweep: FloatArray | None = None
) -> tuple[SimulationState, FloatArray]:
    """Return the state after K steps and the output rows (K, R) at their ends, in °C and µm.

    Exact for heats constant and known inputs linear over each step; where states are coupled, of second
    order in the step (see `coupling`). `sweep` (K, M, e, N) are shapes of which the squares
    add up to the covariance of each moving source's input column over the step, where that is known.
    """
    sweep = np.zeros((len(inputs), len(plant.moving), 0, plant.modes)) if sweep is None else sweep
    B, C = plant.B.copy(), plant.rows.C.copy()
    for source in plant.moving:
        if not plant.coupling.active:
            B[:, source.index] = 0.0
        C[:, plant.modes + source.index] = 0.0
    x, rows = state.x.copy(), np.empty((len(inputs), len(C)))
    moving = np.array([s.index for s in plant.moving], dtype=np.int64)
    for begin in range(0, len(inputs), _CHUNK):
        u = inputs.part(begin, begin + _CHUNK)
        states = np.empty((len(u), len(x)))
        known, rise = u.z_start @ plant.E.T, (u.z_end - u.z_start) @ plant.E.T
        if plant.coupling.active:
            _march_coupled(
                plant.coupling, x, states, plant.decay_1_s, u.dt_s, known, rise, u.z_start, u.z_end, u.law_W,
                u.loss_1_s, u.loss_degC, np.ascontiguousarray(B.T), moving, u.moving_B,
                sweep[begin : begin + _CHUNK], np.empty((len(x), 0)), np.empty((3, len(x))),
            )  # fmt: skip
        else:
            known += u.law_W @ B.T
            for i, source in enumerate(plant.moving):
                known += u.law_W[:, source.index, None] * u.moving_B[:, i]
            _march(x, states, plant.decay_1_s, u.dt_s, known, rise, np.empty((3, len(x))))
        seen = rows[begin : begin + _CHUNK]
        np.matmul(states, C.T, out=seen)
        seen += u.z_end @ plant.rows.F.T
        for i, source in enumerate(plant.moving):
            seen += states[:, plant.modes + source.index, None] * u.moving_C[:, i]
    return SimulationState(x), rows


@cached_loop
def _march(x, states, decay, dt_s, rate, rise, work):  # type: ignore[no-untyped-def]
    """March x in place under `rate` (K, n_x), which grows by `rise` (K, n_x) over each step; `work` (3, n_x)
    is scratch.
    """
    n_x = len(x)
    keep, held, ramped = work[0], work[1], work[2]
    dt_known = -1.0
    for k in range(len(dt_s)):
        if dt_s[k] != dt_known:
            dt_known = dt_s[k]
            for i in range(n_x):
                keep[i] = np.exp(-decay[i] * dt_known)
                held[i], ramped[i] = hold(decay[i], dt_known), ramp(decay[i], dt_known)
        for i in range(n_x):
            x[i] = keep[i] * x[i] + held[i] * rate[k, i] + ramped[i] * rise[k, i]
            states[k, i] = x[i]


@cached_loop
def _march_coupled(  # type: ignore[no-untyped-def]
    c, x, states, decay, dt_s, known, rise, z_start, z_end, law_W, loss_1_s, loss_degC, B, moving, moving_B,
    sweep, none, work,
):  # fmt: skip
    """March x in place under known inputs (K, n_x) and laws (K, m) with half a coupling before and after;
    `none` (n_x, 0) has no columns, `work` (3, n_x) is scratch.
    """
    n_x = len(x)
    keep, held, ramped = work[0], work[1], work[2]
    dt_known = -1.0
    for k in range(len(dt_s)):
        if dt_s[k] != dt_known:
            dt_known = dt_s[k]
            for i in range(n_x):
                keep[i] = np.exp(-decay[i] * dt_known)
                held[i], ramped[i] = hold(decay[i], dt_known), ramp(decay[i], dt_known)
        for i in range(len(moving)):
            for a in range(n_x):
                B[moving[i], a] = moving_B[k, i, a]
        half_s = 0.5 * dt_known
        couple(c, loss_1_s[k], loss_degC[k], z_start[k], B, half_s, x, none, x)
        for i in range(len(moving)):
            swept(c, moving[i], sweep[k, i], half_s, x, 1)
        for j in range(B.shape[0]):
            law = law_W[k, j] * faded(c, j, z_start[k], B, x)
            for a in range(n_x):
                known[k, a] += law * B[j, a]
        for a in range(n_x):
            x[a] = keep[a] * x[a] + held[a] * known[k, a] + ramped[a] * rise[k, a]
        for i in range(len(moving) - 1, -1, -1):
            swept(c, moving[i], sweep[k, i], half_s, x, -1)
        couple(c, loss_1_s[k], loss_degC[k], z_end[k], B, half_s, x, none, x)
        for a in range(n_x):
            states[k, a] = x[a]
