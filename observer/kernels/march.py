"""The open loop over many steps: a plant driven by its heat laws alone."""

from __future__ import annotations

from observer.kernels.advance import advance, move_columns
from observer.kernels.discretise import hold, ramp
from observer.kernels.libm import exp


def march_steps(p, t, decay, u, B, C, work, x, states):
    """March x over the steps of `u`; `states` (K, n_x + p) are the states and known inputs at their ends."""
    n_x, dt_known = len(decay), -1.0
    for k in range(len(u.dt_s)):
        if u.dt_s[k] != dt_known:
            dt_known = u.dt_s[k]
            for a in range(n_x):
                t.decay[0, a] = exp(-decay[a] * dt_known)
                t.hold[0, a], t.ramp[0, a] = hold(decay[a], dt_known), ramp(decay[a], dt_known)
        move_columns(p, u, k, B, C)
        advance(p, t, 0, u, k, B, x, work)
        for a in range(n_x):
            states[k, a] = x[a]
        for q in range(u.z_end.shape[1]):
            states[k, n_x + q] = u.z_end[k, q]
