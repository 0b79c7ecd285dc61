"""The compiled step of an observer whose covariance has settled: nothing but the state moves.

Everything that is constant is laid out once as padded columns, so that a step is a few sweeps over whole
vector registers: x_pred = e∘x + Σ columns · inputs, ν = y - C x_pred, x⁺ = x_pred + Σ K_i ν_i.
"""

# numba compiles these functions: their types are those of the arrays they get.
# mypy: disable-error-code="no-untyped-def, misc"

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.compiled import inlined, rarely
from observer.estimators.compiled.allowing import (
    allow,
    allow_for_readings,
    correct_allowed,
    finish_allowing,
    widen,
)
from observer.estimators.compiled.judging import (
    GOOD,
    NUT_LOST,
    find_usable,
    invalidate,
    judge,
    move_rows,
    step_is_finite,
)
from observer.estimators.compiled.packing import PlantArrays, padded_width
from observer.frames import FloatArray
from observer.model.advance import add_scaled, move_columns

# A law's jump that adds less than this share to a heat's σ² leaves the covariance settled.
_QUIET_JUMP = 1e-3


class Columns(NamedTuple):
    """The steady step, laid out in padded rows: W ≥ n and W_s ≥ s.

    `decay`, `x`, `x_pred` (W,); `inputs` (c, W) and `weights` (c,), what drives the states and how much at a
    step: laws, known inputs at its start and at its end, heats; `gain` (s, W); the sensors' rows as columns,
    `sensors` (n_x, W_s), `sensors_F` (p, W_s); `expected`, `nu` (W_s,), `nu_sigma` (s,).
    """

    decay: FloatArray
    x: FloatArray
    x_pred: FloatArray
    inputs: FloatArray
    weights: FloatArray
    gain: FloatArray
    sensors: FloatArray
    sensors_F: FloatArray
    expected: FloatArray
    nu: FloatArray
    nu_sigma: FloatArray


def columns(arrays: PlantArrays) -> Columns:
    """Allocate the layout of a plant's steady step."""
    (m, n_x), p, m_e, s = arrays.B.shape, len(arrays.E), len(arrays.source), len(arrays.R_K2)
    width, of_sensors, inputs = padded_width(n_x + m_e), padded_width(s), m + 2 * p + m_e
    shapes = [(width,), (width,), (width,), (inputs, width), (inputs,), (s, width)]
    shapes += [(n_x, of_sensors), (p, of_sensors), (of_sensors,), (of_sensors,), (s,)]
    return Columns(*(np.zeros(shape) for shape in shapes))


@rarely
def lay_out(p, t, d, B, C, K, S, c):
    """Fill in the columns for step length d, the input and output columns in force, a gain (n, s) and the
    variances S (s,) of the innovations.
    """
    (m, n_x), (known, _), s = B.shape, p.E.shape, len(S)
    for a in range(len(c.decay)):
        c.decay[a] = t.decay[d, a]
    for a in range(n_x):
        for j in range(m):
            c.inputs[j, a] = t.hold[d, a] * B[j, a]
        for q in range(known):
            c.inputs[m + q, a] = (t.hold[d, a] - t.ramp[d, a]) * p.E[q, a]
            c.inputs[m + known + q, a] = t.ramp[d, a] * p.E[q, a]
        for j in range(len(p.source)):
            c.inputs[m + 2 * known + j, a] = t.couple[d, j, a] * B[p.source[j], a]
        for i in range(s):
            c.sensors[a, i] = C[i, a]
    for i in range(s):
        c.nu_sigma[i] = np.sqrt(S[i])
        for q in range(known):
            c.sensors_F[q, i] = p.F[i, q]
        for a in range(K.shape[0]):
            c.gain[i, a] = K[a, i]


@inlined
def is_regular(p, rungs, u, d, k, usable, state, gains, settled):
    """Whether step k leaves the covariance settled: exact length, no jump σ would notice, all its sensors
    there.
    """
    s, n_x = len(usable), len(p.uniform)
    rung = rungs.rung[d]
    regular = rungs.exact[d] and step_is_finite(u, k) and u.degraded[k] < NUT_LOST
    for i in range(s):
        present = (gains.key[settled] >> i) & 1 == 1
        good = u.quality[k, i] == GOOD and state.suspect[i] == 0.0
        regular = regular and present == good and present == usable[i]
    for j in range(len(p.source)):
        jump = p.law_uncertainty[j] * u.law_jump_W[k, p.source[j]]
        regular = regular and jump * jump <= _QUIET_JUMP * gains.P[settled, n_x + j, n_x + j]
    return regular and gains.key[settled] >> s == rung


@inlined
def step_state(p, u, k, usable, gate_sigma, variance, c):
    """Predict, compare and correct; return whether every innovation passes the gate at its `variance` (s,)
    (c.x is then x⁺).
    """
    n_x, s, m, known = len(p.uniform), len(usable), u.law_W.shape[1], u.z_end.shape[1]
    for j in range(m):
        c.weights[j] = u.law_W[k, j]
    for q in range(known):
        c.weights[m + q], c.weights[m + known + q] = u.z_start[k, q], u.z_end[k, q]
    for j in range(len(p.source)):
        c.weights[m + 2 * known + j] = c.x[n_x + j]
    for b in range(len(c.x)):
        c.x_pred[b] = c.decay[b] * c.x[b]
    add_scaled(c.x_pred, c.inputs, c.weights, len(c.weights))
    for i in range(len(c.expected)):
        c.expected[i] = 0.0
    add_scaled(c.expected, c.sensors_F, u.z_end[k], known)
    add_scaled(c.expected, c.sensors, c.x_pred, n_x)
    for i in range(s):
        c.nu[i] = u.y_degC[k, i] - c.expected[i] if usable[i] else 0.0
        if c.nu[i] * c.nu[i] > gate_sigma * gate_sigma * variance[i]:
            return False
    for b in range(len(c.x)):
        c.x[b] = c.x_pred[b]
    add_scaled(c.x, c.gain, c.nu, s)
    return True


@inlined
def write_steady(p, u, k, usable, gains, settled, c, work, out):
    """Write step k with the steady σ of noise; return whether all values are numbers."""
    n_x, value, lost = len(p.uniform), work.value, 0
    out.log_likelihood[k] = 0.0
    for i in range(len(usable)):
        out.innovation[k, i] = c.nu[i] if usable[i] else np.nan
        out.innovation_sigma[k, i] = c.nu_sigma[i] if usable[i] else np.nan
    for j in range(len(p.source)):
        law = u.law_W[k, p.source[j]]
        out.law[k, j], out.heat[k, j] = law, law + c.x[n_x + j]
        out.heat_sigma[k, j] = gains.heat_sigma[settled, j]
        lost += 0 if np.isfinite(out.heat[k, j]) else 1
    for r in range(len(value)):
        value[r] = 0.0
    add_scaled(value, p.rows_F, u.z_end[k], len(p.rows_F))
    add_scaled(value, work.rows, c.x, n_x)
    for r in range(out.field.shape[1]):
        out.field[k, r], out.field_sigma[k, r] = value[r], gains.field_sigma[settled, r]
        lost += 0 if np.isfinite(value[r]) else 1
    return lost == 0


@inlined
def cruise(p, t, rungs, u, step, state, gate_sigma, gains, settled, out, k, work, c, allowed):
    """Take regular steps from k on; return the first that is not, or that the gate would refuse."""
    laid_out = -1
    for a in range(len(state.x)):
        c.x[a] = state.x[a]
    while k < len(step):
        find_usable(u, k, work.usable)
        if not is_regular(p, rungs, u, step[k], k, work.usable, state, gains, settled):
            break
        if step[k] != laid_out or len(p.moving) > 0:
            move_columns(p, u, k, work.B, work.C)
            move_rows(p, u, k, work.rows)
            lay_out(p, t, step[k], work.B, work.C, gains.K[settled], gains.S[settled], c)
            laid_out = step[k]
        allow(allowed, t, step[k], u, k)
        allow_for_readings(allowed, gains.S[settled])
        if not step_state(p, u, k, work.usable, gate_sigma, allowed.variance, c):
            break
        correct_allowed(allowed, gains.K[settled], work.usable)
        finish_allowing(allowed, u.dt_s[k], c.x)
        out.quality[k] = judge(u, k, work.usable, work.usable, state, out)
        known = write_steady(p, u, k, work.usable, gains, settled, c, work, out)
        for i in range(allowed.nu.shape[0]):
            if allowed.nu.shape[1] > 0 and work.usable[i]:
                out.innovation_sigma[k, i] = np.sqrt(allowed.variance[i])
        widen(allowed, work.rows, k, out)
        if not known:
            invalidate(out, k)
        k += 1
    for a in range(len(state.x)):
        state.x[a] = c.x[a]
    return k
