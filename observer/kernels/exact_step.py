"""One exact step of a diagonal plant over a time dt, in closed form except for the random walks' noise."""

from __future__ import annotations

from observer.kernels.codes import TICKS_PER_S
from observer.kernels.libc import exp, expm1, rint


def hold(rate_1_s, dt_s):
    """∫_0^dt exp(-rate s) ds, safe for rate → 0."""
    if rate_1_s == 0.0:
        return dt_s
    return -expm1(-rate_1_s * dt_s) / rate_1_s


def ramp(rate_1_s, dt_s):
    """∫_0^dt exp(-rate (dt-s)) s/dt ds = dt (u - 1 + exp(-u)) / u², u = rate dt; for small u a series."""
    u = rate_1_s * dt_s
    if u < 1e-2:
        return dt_s * (0.5 - u * (1.0 / 6.0 - u * (1.0 / 24.0 - u * (1.0 / 120.0 - u / 720.0))))
    return dt_s * (u + expm1(-u)) / (u * u)


def respond(rate_1_s, heat_rate_1_s, dt_s):
    """∫_0^dt exp(-rate (dt-s)) exp(-heat_rate s) ds, safe where both rates meet."""
    slow = min(rate_1_s, heat_rate_1_s)
    return exp(-slow * dt_s) * hold(abs(rate_1_s - heat_rate_1_s), dt_s)


def discretise(rate, heat_rate, intensity, nodes, weights, response, step):
    """Fill in the matrices of `step`, of length `step.dt_s`.

    There are n_x plant states of the rates `rate`, and m_e heats of the rates `heat_rate` and the random
    walks' `intensity`. Quadrature is by `nodes` and `weights` on [0, 1]; `response` (n_x,) is scratch.
    """
    n_x, m_e, dt_s = len(rate), len(heat_rate), step.dt_s
    for i in range(n_x):
        step.decay[i] = exp(-rate[i] * dt_s)
        step.hold[i] = hold(rate[i], dt_s)
        step.ramp[i] = ramp(rate[i], dt_s)
    for j in range(m_e):
        step.heat_decay[j] = exp(-heat_rate[j] * dt_s)
        for i in range(n_x):
            step.couple[j, i] = respond(rate[i], heat_rate[j], dt_s)
        for q in range(len(nodes)):
            s = nodes[q] * dt_s
            weight = weights[q] * dt_s * intensity[j]
            decayed = exp(-heat_rate[j] * s)
            for i in range(n_x):
                response[i] = respond(rate[i], heat_rate[j], s)
            for i in range(n_x):
                step.walk_dx[j, i] += weight * decayed * response[i]
                for k in range(n_x):
                    step.walk_xx[j, i, k] += weight * response[i] * response[k]
            step.walk_dd[j] += weight * decayed * decayed


def number_steps(dt_s, start, step, lengths):
    """Number the steps from `start` on by their lengths, quantised, as long as there is room for these.

    Returns the first step that is left and how many lengths there are.
    """
    count, number = 0, 0
    for k in range(start, len(dt_s)):
        if k > start and dt_s[k] == dt_s[k - 1]:
            step[k] = number
            continue
        length = rint(dt_s[k] * TICKS_PER_S) / TICKS_PER_S
        if number == count or lengths[number] != length:
            number = 0
            while number < count and lengths[number] != length:
                number += 1
            if number == len(lengths):
                return k, count
            if number == count:
                lengths[count] = length
                count += 1
        step[k] = number
    return len(dt_s), count
