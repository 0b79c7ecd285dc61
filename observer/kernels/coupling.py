"""What couples a plant's states to each other and to the temperature of the moment.

The records are those of `observer.model.coupling`.

The plant itself is diagonal. A loss that changes with speed or temperature, a film that differs along the
screw, a link to a body that stores heat and a sensor that lags are taken in half a step before and half a
step after the exact diagonal step (Strang 1968), and within each half in an order that reads the same
backwards: the error is of second order in the step, and these couplings are slow against it. Each is solved
exactly by itself, so none can become unstable.
"""

from __future__ import annotations

from observer.kernels.arithmetic import squared
from observer.kernels.libm import exp, expm1


def coupled(c, loss_1_s, loss_degC, z, B, half_s, x, M, b):
    """Fill M (n_x, n_x) and b (n_x,) so that x⁺ = M x + b is what the couplings do in `half_s`.

    `loss_1_s` is the uniform loss of the moment, towards `loss_degC`; z (p,) the known inputs;
    B (m, n_x) the input columns in force, as rows; x the state, of which the first n_x count.
    """
    n_x = M.shape[0]
    for a in range(n_x):
        b[a] = 0.0
        for i in range(n_x):
            M[a, i] = 0.0
        M[a, a] = 1.0
    couple(c, loss_1_s, loss_degC, z, B, half_s, x, M, b)


def couple(c, loss_1_s, loss_degC, z, B, half_s, x, M, b):
    """Do to the columns of M (n_x, r) and to b (n_x,) what the couplings do to a state in `half_s`: M takes
    their linear part alone. The rest is as for `coupled`; a state itself is x and b in one, with r = 0.

    The films act for the whole time, sensors and links half before and half after them.
    """
    rate_1_s, drawn = _uniform_loss(c, loss_1_s, loss_degC, z, x)
    for i in range(len(c.lags.state) - 1, -1, -1):
        _sensor(c, i, z, 0.5 * half_s, M, b)
    for i in range(len(c.spreads.rate_1_s) - 1, -1, -1):
        _spread(c, i, B, 0.5 * half_s, M, b)
    for i in range(len(c.links.source) - 1, -1, -1):
        _link(c, i, z, B, 0.5 * half_s, M, b)
    _lose(c, rate_1_s, drawn, 0.5 * half_s, M, b)
    for f in range(len(c.films.rate_1_s)):
        _film(c, f, z, half_s, M, b)
    _lose(c, rate_1_s, drawn, 0.5 * half_s, M, b)
    for i in range(len(c.links.source)):
        _link(c, i, z, B, 0.5 * half_s, M, b)
    for i in range(len(c.spreads.rate_1_s)):
        _spread(c, i, B, 0.5 * half_s, M, b)
    for i in range(len(c.lags.state)):
        _sensor(c, i, z, 0.5 * half_s, M, b)


def _uniform_loss(c, loss_1_s, loss_degC, z, x):
    """The rate of the losses that are the same along the screw, 1/s, and rate × what they draw to; radiation
    in its tangent at the mean temperature, and with the variance along the screw in its mean.
    """
    rate, drawn = loss_1_s, loss_1_s * loss_degC
    if c.radiation > 0.0:
        mean_degC, square = 0.0, 0.0
        for a in range(c.modes):
            mean_degC += c.mean[a] * x[a]
            square += c.square * squared(x[a])
        mean_K, around_K = mean_degC + c.zero_degC_K, z[c.ambient] + c.zero_degC_K
        mean_K2, around_K2 = mean_K * mean_K, around_K * around_K
        mean_K3 = mean_K * mean_K2
        lost = (
            mean_K2 * mean_K2 + 6.0 * mean_K2 * max(square - squared(mean_degC), 0.0) - around_K2 * around_K2
        )
        rate += 4.0 * c.radiation * mean_K3
        drawn += c.radiation * (4.0 * mean_K3 * mean_degC - lost)
    return rate, drawn


def _lose(c, rate_1_s, drawn, time_s, M, b):
    """Losses that are the same along the screw."""
    if rate_1_s == 0.0:
        return
    keep = exp(-rate_1_s * time_s)
    towards_degC = (1.0 - keep) * drawn / rate_1_s
    for a in range(c.modes):
        b[a] = keep * b[a] + towards_degC * c.uniform[a]
        for q in range(M.shape[1]):
            M[a, q] *= keep


def _film(c, f, z, time_s, M, b):
    """One of the orthonormal shapes of films along stretches decays towards what the ambient makes of it."""
    lost = -expm1(-c.films.rate_1_s[f] * time_s)
    drive = 0.0
    for a in range(c.modes):
        drive += c.films.shape[f, a] * c.films.ambient[a]
    change = lost / c.films.rate_1_s[f] * drive * z[c.ambient]
    for a in range(c.modes):
        change -= lost * c.films.shape[f, a] * b[a]
    for a in range(c.modes):
        b[a] += change * c.films.shape[f, a]
    _fade(c.films.shape[f], lost, M)


def _fade(shape, lost, M):
    """The part `lost` of an orthonormal shape goes from the columns of M."""
    for q in range(M.shape[1]):
        warm = 0.0
        for a in range(len(shape)):
            warm += shape[a] * M[a, q]
        for a in range(len(shape)):
            M[a, q] -= lost * warm * shape[a]


def _link(c, i, z, B, time_s, M, b):
    """A node gives Q = G (T_node − T) to the screw.

    With d the row of the difference and v the column of 1 J passed, dx/dt = G v d x: both temperatures meet
    at the rate κ = −G d·v.
    """
    source, n_x = c.links.source[i], M.shape[0]
    compliance = 0.0
    for a in range(n_x):
        compliance -= _apart(c, i, B, a) * _passed(c, i, B, a)
    heat_J_K = -expm1(-c.links.conductance_W_K[i] * compliance * time_s) / compliance
    apart_K = 0.0
    for q in range(len(z)):
        apart_K -= c.under_F[source, q] * z[q]
    for a in range(n_x):
        apart_K += _apart(c, i, B, a) * b[a]
    for a in range(n_x):
        b[a] += _passed(c, i, B, a) * heat_J_K * apart_K
    for q in range(M.shape[1]):
        apart_K = 0.0
        for a in range(n_x):
            apart_K += _apart(c, i, B, a) * M[a, q]
        for a in range(n_x):
            M[a, q] += _passed(c, i, B, a) * heat_J_K * apart_K


def _apart(c, i, B, a):
    """Entry a of the row that reads how much warmer the node of a link is than the screw."""
    return c.links.C[i, a] - under(c, c.links.source[i], B, a)


def _passed(c, i, B, a):
    """Entry a of what 1 J from the node of a link to the screw does."""
    source = c.links.source[i]
    return c.place_gain[source] * B[source, a] if a < c.screw else -c.links.B[i, a]


def _spread(c, i, B, time_s, M, b):
    """What a sweeping nut passes on top of its mean: one shape fades.

    The rate goes with the variance of the places swept: with the square of the stretch, which is about the
    reciprocal of the column's squared size.
    """
    source = c.spreads.source[i]
    size = 0.0
    for a in range(c.modes):
        size += squared(c.place_gain[source] * B[source, a])
    nut = squared(c.spreads.swept[source] / c.spreads.at_rest[source])
    now = squared(c.spreads.swept[source] / size)
    lost = -expm1(-c.spreads.rate_1_s[i] * min(max((now - nut) / (1.0 - nut), 0.0), 1.0) * time_s)
    warm = 0.0
    for a in range(c.modes):
        warm += c.spreads.shape[i, a] * b[a]
    for a in range(c.modes):
        b[a] -= lost * warm * c.spreads.shape[i, a]
    _fade(c.spreads.shape[i], lost, M)


def swept(c, source, shapes, time_s, x, order):
    """What a nut passes to its nodes on top of its mean, where the places swept are known: the squares of
    the `shapes` (e, N) add up to the covariance of its input column over the time. They are taken from the
    first on (`order` 1) or from the last (-1).
    """
    rate_1_s = 0.0
    for i in range(len(c.links.source)):
        if c.links.source[i] == source:
            rate_1_s += c.links.conductance_W_K[i] * c.conductance_W_m * squared(c.place_gain[source])
    for number in range(shapes.shape[0]):
        e = number if order > 0 else shapes.shape[0] - 1 - number
        size, warm = 0.0, 0.0
        for a in range(c.modes):
            size += squared(shapes[e, a])
            warm += shapes[e, a] * x[a]
        if size > 0.0:
            part = -expm1(-rate_1_s * size * time_s) * warm / size
            for a in range(c.modes):
                x[a] -= part * shapes[e, a]


def _sensor(c, i, z, time_s, M, b):
    """A sensor goes towards the temperature below it."""
    state, n_x = c.lags.state[i], M.shape[0]
    taken = -expm1(-time_s * c.lags.rate_1_s[i])
    below = 0.0
    for q in range(len(z)):
        below += c.lags.F[i, q] * z[q]
    for a in range(n_x):
        below += c.lags.C[i, a] * b[a]
    b[state] += taken * (below - b[state])
    for q in range(M.shape[1]):
        below = 0.0
        for a in range(n_x):
            below += c.lags.C[i, a] * M[a, q]
        M[state, q] += taken * (below - M[state, q])


def under(c, source, B, a):
    """Entry a of the row that reads the temperature under a source."""
    seen = c.under_C[source, a]
    return seen + c.conductance_W_m * c.place_gain[source] * B[source, a] if a < c.modes else seen


def faded(c, j, z, B, x):
    """The factor on the law of source j at the temperature under it."""
    if c.fades.per_K[j] == 0.0:
        return 1.0
    seen_degC = 0.0
    for a in range(c.under_C.shape[1]):
        seen_degC += under(c, j, B, a) * x[a]
    for q in range(len(z)):
        seen_degC += c.under_F[j, q] * z[q]
    return exp(-c.fades.per_K[j] * (seen_degC - c.fades.reference_degC[j]))
