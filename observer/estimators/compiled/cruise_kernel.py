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
from observer.estimators.compiled.judging import (
    GOOD,
    NUT_LOST,
    find_usable,
    invalidate,
    judge,
    step_is_finite,
)
from observer.estimators.compiled.packing import PlantArrays, padded_width
from observer.frames import FloatArray
from observer.model.advance import move_columns

# A law's jump that adds less than this share to a heat's σ² leaves the covariance settled.
_QUIET_JUMP = 1e-3


class Columns(NamedTuple):
    """The steady step, laid out in padded rows: W ≥ n, W_s ≥ s and W_r ≥ the field's and error's rows.

    `decay`, `x`, `x_pred` (W,); `law` (m, W), `z_start`, `z_end` (p, W), `heat` (m_e, W), `gain` (s, W);
    `sensors` (n_x, W_s) and `rows` (n_x, W_r) the output rows as columns; `nu` (W_s,), `value` (W_r,).
    """

    decay: FloatArray
    x: FloatArray
    x_pred: FloatArray
    law: FloatArray
    z_start: FloatArray
    z_end: FloatArray
    heat: FloatArray
    gain: FloatArray
    sensors: FloatArray
    rows: FloatArray
    nu: FloatArray
    value: FloatArray


def columns(arrays: PlantArrays) -> Columns:
    """Allocate the layout of a plant's steady step."""
    (m, n_x), p, m_e, s = arrays.B.shape, len(arrays.E), len(arrays.source), len(arrays.R_K2)
    width, of_sensors = padded_width(n_x + m_e), padded_width(s)
    of_rows = padded_width(len(arrays.C) - s)
    shapes = [(width,), (width,), (width,), (m, width), (p, width), (p, width), (m_e, width), (s, width)]
    shapes += [(n_x, of_sensors), (n_x, of_rows), (of_sensors,), (of_rows,)]
    return Columns(*(np.zeros(shape) for shape in shapes))


@rarely
def lay_out(p, t, d, B, C, K, c):
    """Fill in the columns for step length d, the input and output columns in force, and a gain (n, s)."""
    (m, n_x), s = B.shape, K.shape[1]
    for a in range(n_x):
        c.decay[a] = t.decay[d, a]
        for j in range(m):
            c.law[j, a] = t.hold[d, a] * B[j, a]
        for q in range(p.E.shape[0]):
            c.z_start[q, a] = (t.hold[d, a] - t.ramp[d, a]) * p.E[q, a]
            c.z_end[q, a] = t.ramp[d, a] * p.E[q, a]
        for j in range(len(p.source)):
            c.heat[j, a] = t.couple[d, j, a] * B[p.source[j], a]
        for i in range(s):
            c.sensors[a, i] = C[i, a]
        for r in range(s, C.shape[0]):
            c.rows[a, r - s] = C[r, a]
    for j in range(len(p.source)):
        c.decay[n_x + j] = t.heat_decay[d, j]
    for a in range(K.shape[0]):
        for i in range(s):
            c.gain[i, a] = K[a, i]


@inlined
def is_regular(p, rungs, u, k, usable, state, gains, settled):
    """Whether step k leaves the covariance settled: exact length, no jump σ would notice, all its sensors
    there.
    """
    s, n_x = len(usable), len(p.uniform)
    rung = rungs.rung[u.step[k]]
    regular = rungs.exact[u.step[k]] and step_is_finite(u, k) and u.degraded[k] < NUT_LOST
    for i in range(s):
        present = (gains.key[settled] >> i) & 1 == 1
        good = u.quality[k, i] == GOOD and state.suspect[i] == 0.0
        regular = regular and present == good and present == usable[i]
    for j in range(len(p.source)):
        jump = p.law_uncertainty[j] * u.jump[k, p.source[j]]
        regular = regular and jump * jump <= _QUIET_JUMP * gains.P[settled, n_x + j, n_x + j]
    return regular and gains.key[settled] >> s == rung


@inlined
def add_scaled(target, source, row, factor):
    """target += factor · source[row]."""
    for b in range(len(target)):
        target[b] += factor * source[row, b]


@inlined
def step_state(p, u, k, usable, gate_sigma, gains, settled, c):
    """Predict, compare and correct; return whether every innovation passes the gate (c.x is then x⁺)."""
    n_x, s = len(p.uniform), len(usable)
    for b in range(len(c.x)):
        c.x_pred[b] = c.decay[b] * c.x[b]
    for j in range(u.law.shape[1]):
        add_scaled(c.x_pred, c.law, j, u.law[k, j])
    for q in range(u.z_end.shape[1]):
        add_scaled(c.x_pred, c.z_start, q, u.z_start[k, q])
        add_scaled(c.x_pred, c.z_end, q, u.z_end[k, q])
    for j in range(len(p.source)):
        add_scaled(c.x_pred, c.heat, j, c.x[n_x + j])
    for i in range(s):
        c.nu[i] = u.y[k, i] if usable[i] else 0.0
        for q in range(u.z_end.shape[1]):
            c.nu[i] -= p.F[i, q] * u.z_end[k, q]
    for a in range(n_x):
        add_scaled(c.nu, c.sensors, a, -c.x_pred[a])
    for i in range(s):
        if usable[i] and c.nu[i] * c.nu[i] > gate_sigma * gate_sigma * gains.S[settled, i]:
            return False
    for b in range(len(c.x)):
        c.x[b] = c.x_pred[b]
    for i in range(s):
        if usable[i]:
            add_scaled(c.x, c.gain, i, c.nu[i])
    return True


@inlined
def write_steady(p, u, k, usable, gains, settled, c, out):
    """Write step k with the steady σ; return whether all values are numbers."""
    n_x, s = len(p.uniform), len(usable)
    total = 0.0
    for i in range(s):
        if usable[i]:
            out.innovation[k, i] = c.nu[i]
            out.innovation_sigma[k, i] = np.sqrt(gains.S[settled, i])
    for j in range(len(p.source)):
        out.law[k, j] = u.law[k, p.source[j]]
        out.heat[k, j] = u.law[k, p.source[j]] + c.x[n_x + j]
        out.heat_sigma[k, j] = gains.heat_sigma[settled, j]
        total += out.heat[k, j]
    for r in range(len(c.value)):
        c.value[r] = 0.0
    for a in range(n_x):
        add_scaled(c.value, c.rows, a, c.x[a])
    for r in range(out.field.shape[1]):
        for q in range(p.F.shape[1]):
            c.value[r] += p.F[s + r, q] * u.z_end[k, q]
        out.field[k, r] = c.value[r]
        out.field_sigma[k, r] = gains.field_sigma[settled, r]
        total += c.value[r]
    return np.isfinite(total)


@inlined
def cruise(p, t, rungs, u, state, gate_sigma, gains, settled, out, k, work, c):
    """Take regular steps from k on; return the first that is not, or that the gate would refuse."""
    laid_out = False
    for a in range(len(state.x)):
        c.x[a] = state.x[a]
    while k < len(u.step):
        find_usable(u, k, work.usable)
        if not is_regular(p, rungs, u, k, work.usable, state, gains, settled):
            break
        if not laid_out or len(p.moving) > 0:
            move_columns(p, u, k, work.B, work.C)
            lay_out(p, t, u.step[k], work.B, work.C, gains.K[settled], c)
            laid_out = True
        if not step_state(p, u, k, work.usable, gate_sigma, gains, settled, c):
            break
        out.quality[k] = judge(u, k, work.usable, work.usable, state, out)
        if not write_steady(p, u, k, work.usable, gains, settled, c, out):
            invalidate(out, k)
        k += 1
    for a in range(len(state.x)):
        state.x[a] = c.x[a]
    return k
