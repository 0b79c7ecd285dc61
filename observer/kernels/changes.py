"""Response of the smoother to changed readings: many changes at once over the gains of one filter's tape.

Gains and covariances do not depend on readings. A change of the readings therefore needs the arithmetic of
the state only. In the backward pass, column 0 is the log itself, and the others are changes.
"""

from __future__ import annotations

from observer.kernels.advance import (
    advance_columns,
    couple_columns,
    form_half,
    move_columns,
    multiply_columns,
)
from observer.kernels.covariance import add_row
from observer.kernels.judging import clear, step_is_finite
from observer.kernels.kalman import SKIPPED, STEPPED
from observer.kernels.learning import advance_learning, below, follow, linearise_at
from observer.kernels.libc import cython


def run_tolerances(a, b, x, begins, D, expected):
    """Fill D (K, s, ≥ L) with the effect of one standard deviation of each tolerance on the readings.

    Readings without deviations go into `expected` (K, s), °C. The field is that of an open loop with the
    inputs' heats, from the state `x` if it `begins`. A step that cannot be computed does not change it.
    """
    with cython.nogil:
        tolerances_forward(a, b, x, begins, D, expected)


def run_changes_forward(b, tape, work, X, changed):
    """Take the changes X (n, c) of the state over the K steps on the tape.

    On entry `changed.moved` (K, s, c) contains the changes of the readings. On return it contains those of
    the innovations, each given the sensors before it. Changes of the heats go into `changed.heat`
    (K, m_e, c). At the start of the filter the changes are zero, because its level is that of the log.
    """
    with cython.nogil:
        changes_forward(b, tape, work, X, changed)


def run_changes_backward(b, tape, work, R, changed, D, information):
    """Take the adjoint R (n, c) back over the tape; `changed.moved` is then Σ⁻¹ times the readings about
    their mean, and `changed.heat` smoothed. Dᵀ times the former is added to `information` (d, c), with D
    (K, s, d).
    """
    with cython.nogil:
        changes_backward(b, tape, work, R, changed, D, information)


def tolerances_forward(a, b, x, begins, D, expected):
    """Carry the columns S = ∂x/∂θ σ_θ of the machine's tolerances along an open loop over the K steps.

    Tolerances of a sensor act on its row only.
    """
    machine, L = a.plant.learn.machine, len(a.plant.learn.kind)
    first = len(a.plant.uniform) + len(a.plant.source)
    for k in range(len(b.step)):
        if not step_is_finite(b.inputs, k):
            continue
        move_columns(a.plant, b.inputs, k, a.work.B, a.work.C)
        if begins and k == 0:
            clear(a.S)
            linearise_at(a.plant, b.inputs, k, a.work.C, x, a.around)
        elif L > 0:
            carry_sensitivities(a, b, k)
        else:  # then nothing follows the field
            advance_learning(a.plant, b, k, a.around, 0, a.work)
        for i in range(D.shape[1]):
            expected[k, i] = below(a.plant, b.inputs, k, a.work.C, i, a.around)
            for q in range(machine):
                D[k, i, q] = sensed(a, i, q)
        for q in range(machine, L):
            sensor = a.plant.learn.of[q]
            D[k, sensor, q] = a.work.C[sensor, first + q] * a.plant.learn.sigma[q]


def carry_sensitivities(a, b, k):
    """Take the linearisation point `around` and the columns S over step k."""
    follow(a.plant, b, k, a.around, a.nothing, a.work)
    if a.plant.coupling.active:
        couple_columns(a.plant, b.inputs, k, b.inputs.z_start[k], a.work.before[0], a.S, a.work)
    advance_columns(a.plant, b.table, b.step[k], a.work.B, a.S)
    for i in range(a.plant.learn.machine):
        for n in range(len(a.plant.uniform)):
            a.S[n, i] += a.work.G[len(a.plant.source) + i, n] * a.plant.learn.sigma[i]
    if a.plant.coupling.active:
        couple_columns(a.plant, b.inputs, k, b.inputs.z_end[k], a.work.before[1], a.S, a.work)


def sensed(a, i, q):
    """Return the effect of one standard deviation of the machine's tolerance q on sensor i, °C."""
    first = len(a.plant.uniform) + len(a.plant.source)
    total = a.work.C[i, first + q] * a.plant.learn.sigma[q]
    for b in range(len(a.plant.uniform)):
        total += a.work.C[i, b] * a.S[b, q]
    return total


def changes_forward(b, tape, work, X, changed):
    """The filter's arithmetic, in the order of `advance.advance` and of the tape's corrections."""
    B, C, n_x, n, count = work.B, work.C, work.B.shape[1], X.shape[0], X.shape[1]
    for k in range(len(b.step)):
        if tape.kind[k] == SKIPPED:
            continue
        move_columns(b.plant, b.inputs, k, B, C)
        if tape.kind[k] == STEPPED:
            if b.plant.coupling.active:
                couple_columns(b.plant, b.inputs, k, b.inputs.z_start[k], tape.coupled[k, 0], X, work)
            advance_columns(b.plant, b.table, b.step[k], B, X)
            if b.plant.coupling.active:
                couple_columns(b.plant, b.inputs, k, b.inputs.z_end[k], tape.coupled[k, 1], X, work)
        for i in range(len(b.plant.R_K2)):
            if tape.weight[k, i] > 0.0:
                for a in range(n_x):
                    add_row(changed.moved[k, i], -C[i, a], X[a])
                for a in range(n):
                    add_row(X[a], tape.gain[k, i, a], changed.moved[k, i])
                changed.moved[k, i, 0] = tape.innovation[k, i]
            else:  # what is not used says nothing
                for q in range(count):
                    changed.moved[k, i, q] = 0.0
        for j in range(len(b.plant.source)):
            for q in range(count):
                changed.heat[k, j, q] = X[n_x + j, q]
            changed.heat[k, j, 0] = tape.heat[k, j]


def changes_backward(b, tape, work, R, changed, D, information):
    """The way of `smoother.smooth_back` for every column of r, without N."""
    B, C, n_x, n, count = work.B, work.C, work.B.shape[1], R.shape[0], R.shape[1]
    for k in range(len(b.step) - 1, -1, -1):
        if tape.kind[k] == SKIPPED:
            continue
        for j in range(len(b.plant.source)):
            for a in range(n):
                add_row(changed.heat[k, j], tape.cross[k, j, a], R[a])
        move_columns(b.plant, b.inputs, k, B, C)
        for i in range(len(b.plant.R_K2) - 1, -1, -1):
            if tape.weight[k, i] > 0.0:
                weight = tape.weight[k, i]
                for q in range(count):
                    changed.moved[k, i, q] *= weight
                for a in range(n):
                    add_row(changed.moved[k, i], -tape.gain[k, i, a], R[a])
                for a in range(n_x):
                    add_row(R[a], C[i, a], changed.moved[k, i])
                for q in range(D.shape[2]):
                    if D[k, i, q] != 0.0:
                        add_row(information[q], D[k, i, q], changed.moved[k, i])
        if tape.kind[k] == STEPPED:
            if b.plant.coupling.active:
                couple_changes_back(b.plant, b.inputs, k, b.inputs.z_end[k], tape.coupled[k, 1], R, work)
            step_changes_back(b.plant, b.table, b.step[k], B, R)
            if b.plant.coupling.active:
                couple_changes_back(b.plant, b.inputs, k, b.inputs.z_start[k], tape.coupled[k, 0], R, work)


def step_changes_back(p, t, d, B, R):
    """R ← Adᵀ R column by column, through the step without couplings."""
    n_x, count = B.shape[1], R.shape[1]
    for j in range(len(p.source)):
        keep, index = t.heat_decay[d, j], p.source[j]
        for q in range(count):
            R[n_x + j, q] *= keep
        for a in range(n_x):
            add_row(R[n_x + j], B[index, a] * t.couple[d, j, a], R[a])
    for a in range(n_x):
        keep = t.decay[d, a]
        for q in range(count):
            R[a, q] *= keep


def couple_changes_back(p, u, k, z, x, R, work):
    """R ← Tᵀ R for the states, column by column; T is half a step of the couplings at the state x."""
    form_half(p, u, k, z, work.B, x, work)
    multiply_columns(work.half_step_T, work.B.shape[1], R, work.was)
