"""The open loop over many steps: a plant driven by its heat laws alone."""

from __future__ import annotations

from observer.kernels.advance import add_scaled, advance, move_columns, ramp_up
from observer.kernels.discretise import hold, ramp
from observer.kernels.libm import exp


def march_steps(p, t, decay, u, B, C, work, x, states, first):
    """March x over steps of `u` from `first` on; `states` (K, n_x + p) are the states and known inputs at
    their ends. What drives a plant that is not coupled is made anew only where it is not what it was.
    """
    n_x, dt_known, driven = len(decay), -1.0, False
    for r in range(states.shape[0]):
        k = first + r
        if u.dt_s[k] != dt_known:
            dt_known, driven = u.dt_s[k], False
            for a in range(n_x):
                t.decay[0, a] = exp(-decay[a] * dt_known)
                t.hold[0, a], t.ramp[0, a] = hold(decay[a], dt_known), ramp(decay[a], dt_known)
        move_columns(p, u, k, B, C)
        if p.coupling.active:
            advance(p, t, 0, u, k, B, x, work)
        else:
            if not driven or len(p.moving) > 0 or not is_held(p, u, k):
                hold_inputs(p, t, u, k, B, work)
                driven = True
            for a in range(len(x)):
                x[a] = t.decay[0, a] * x[a] + work.driven[a]
            ramp_up(p, t, 0, u, k, x)
        for a in range(n_x):
            states[r, a] = x[a]
        for q in range(u.z_end.shape[1]):
            states[r, n_x + q] = u.z_end[k, q]


def is_held(p, u, k):
    """Whether step k is driven like the one before it, but for what known inputs do within it."""
    for j in range(u.law_W.shape[1]):
        if u.law_W[k, j] != u.law_W[k - 1, j]:
            return False
    for q in range(p.E.shape[0]):
        if u.z_start[k, q] != u.z_start[k - 1, q]:
            return False
    return True


def hold_inputs(p, t, u, k, B, work):
    """Put hold∘(B law + E z_start) of step k into `work.driven`."""
    for a in range(len(work.driven)):
        work.driven[a] = 0.0
    add_scaled(work.driven, B, u.law_W[k], B.shape[0])
    add_scaled(work.driven, p.E, u.z_start[k], p.E.shape[0])
    for a in range(len(work.driven)):
        work.driven[a] *= t.hold[0, a]
