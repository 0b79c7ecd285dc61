"""What couples a plant's states by the moment (see `observer.model.coupling`, whose records these are).

It is taken in half a step before and half a step after the exact diagonal step (Strang 1968), and within
each half in an order that reads the same backwards: the error is of second order in the step. Each is solved
exactly by itself, so none can become unstable.
"""

from __future__ import annotations

from observer.kernels.covariance import squared
from observer.kernels.libc import exp, expm1


def coupled(c, loss_1_s, loss_degC, z, B, half_s, x, M, b, link):
    """Fill M (n_x, n_x) and b (n_x,) so that x⁺ = M x + b is what the couplings do in `half_s`.

    `loss_1_s` is the uniform loss of the moment, towards `loss_degC`; z (p,) the known inputs;
    B (m, n_x) the input columns in force, as rows; x the state, of which the first n_x count; `link` (3, w)
    is scratch, at least as wide as x.
    """
    n_x = M.shape[0]
    for a in range(n_x):
        b[a] = 0.0
        for i in range(n_x):
            M[a, i] = 0.0
        M[a, a] = 1.0
    couple(c, loss_1_s, loss_degC, z, B, half_s, x, M, b, link)


def couple(c, loss_1_s, loss_degC, z, B, half_s, x, M, b, link):
    """Do to the columns of M (n_x, r) and to b (n_x,) what the couplings do to a state in `half_s`: M takes
    their linear part alone. The rest is as for `coupled`; a state itself is x and b in one, with r = 0.

    The losses act for the whole time, links half before and half after them.
    """
    rate_1_s, drawn = _uniform_loss(c, loss_1_s, loss_degC, z, x)
    for i in range(len(c.spreads.rate_1_s) - 1, -1, -1):
        _spread(c, i, B, 0.5 * half_s, M, b, link)
    for i in range(len(c.links.source) - 1, -1, -1):
        _link(c, i, z, B, 0.5 * half_s, M, b, link)
    _lose(c, rate_1_s, drawn, half_s, M, b, link)
    for i in range(len(c.links.source)):
        _link(c, i, z, B, 0.5 * half_s, M, b, link)
    for i in range(len(c.spreads.rate_1_s)):
        _spread(c, i, B, 0.5 * half_s, M, b, link)


def _uniform_loss(c, loss_1_s, loss_degC, z, x):
    """The rate of the losses that are the same along the screw, 1/s, and rate × what they draw to; radiation
    in its tangent at the mean temperature, and with the variance along the screw in its mean.
    """
    rate, drawn = loss_1_s, loss_1_s * loss_degC
    if c.radiation > 0.0:
        mean_degC = 0.0
        for a in range(len(c.mean)):
            mean_degC += c.mean[a] * x[a]
        square = c.square * _product(c, x, x)
        mean_K, around_K = mean_degC + c.zero_degC_K, z[c.ambient] + c.zero_degC_K
        mean_K2, around_K2 = mean_K * mean_K, around_K * around_K
        mean_K3 = mean_K * mean_K2
        lost = (
            mean_K2 * mean_K2 + 6.0 * mean_K2 * max(square - squared(mean_degC), 0.0) - around_K2 * around_K2
        )
        rate += 4.0 * c.radiation * mean_K3
        drawn += c.radiation * (4.0 * mean_K3 * mean_degC - lost)
    return rate, drawn


def _product(c, x, y):
    """The sum over the screw's modes of the products of what two states are there."""
    total = 0.0
    if c.metric.shape[0] == 0:
        for a in range(c.modes):
            total += x[a] * y[a]
        return total
    for a in range(c.metric.shape[0]):
        row = 0.0
        for i in range(c.metric.shape[0]):
            row += c.metric[a, i] * y[i]
        total += x[a] * row
    return total


def _lose(c, rate_1_s, drawn, time_s, M, b, link):
    """Losses that are the same along the screw; what is beside it keeps its temperature."""
    if rate_1_s == 0.0:
        return
    if len(c.uneven.rate) > 0:
        for e in range(len(c.uneven.rate)):
            _lose_unevenly(c, e, rate_1_s, drawn, time_s, M, b, link)
        return
    keep, lost = exp(-rate_1_s * time_s), -expm1(-rate_1_s * time_s)
    towards_degC = lost * drawn / rate_1_s
    if len(c.beside) == 0:
        for a in range(c.modes):
            b[a] = keep * b[a] + towards_degC * c.uniform[a]
            for q in range(M.shape[1]):
                M[a, q] *= keep
        return
    for i in range(len(c.beside)):
        _give_back(c, i, lost / keep, M, b, link)
    for a in range(len(c.uniform)):
        b[a] = keep * b[a] + towards_degC * c.uniform[a]
        for q in range(M.shape[1]):
            M[a, q] *= keep


def _lose_unevenly(c, e, rate_1_s, drawn, time_s, M, b, link):
    """What a shape of a screw with sections loses at a rate of its own: the others do not see it."""
    n_x = M.shape[0]
    lost = -expm1(-c.uneven.rate[e] * rate_1_s * time_s)
    excess = 0.0
    for a in range(n_x):
        excess += c.uneven.row[e, a] * (b[a] - drawn / rate_1_s * c.uniform[a])
    for a in range(n_x):
        b[a] -= lost * excess * c.uneven.into[e, a]
    _pass_on(c.uneven.row[e], c.uneven.into[e], -lost, n_x, M, link[2])


def _give_back(c, i, more, M, b, link):
    """Make up for what a state beside the screw will lose with it."""
    n_x, held = M.shape[0], 0.0
    for a in range(n_x):
        held += c.beside[i, a] * b[a]
    for a in range(n_x):
        b[a] += more * held * c.beside_into[i, a]
    _pass_on(c.beside[i], c.beside_into[i], more, n_x, M, link[2])


def _link(c, i, z, B, time_s, M, b, link):
    """A node gives Q = G (T_node − T) to the screw.

    With d the row of the difference and v the column of 1 J passed, dx/dt = G v d x: both temperatures meet
    at the rate κ = −G d·v.
    """
    source, n_x, compliance = c.links.source[i], M.shape[0], 0.0
    see_under(c, source, B, link)
    for a in range(n_x):
        link[0, a] = c.links.C[i, a] - link[0, a]
        link[1, a] = c.place_gain[source] * B[source, a] - c.links.B[i, a]
        compliance -= link[0, a] * link[1, a]
    heat_J_K = -expm1(-c.links.conductance_W_K[i] * compliance * time_s) / compliance
    apart_K = 0.0
    for q in range(len(z)):
        apart_K -= c.under_F[source, q] * z[q]
    for a in range(n_x):
        apart_K += link[0, a] * b[a]
    for a in range(n_x):
        b[a] += link[1, a] * heat_J_K * apart_K
    _pass_on(link[0], link[1], heat_J_K, n_x, M, link[2])


def see_under(c, source, B, link):
    """Put the row that reads the temperature under a source into the first of `link`."""
    scale = c.conductance_W_m * c.place_gain[source]
    for a in range(c.under_C.shape[1]):
        link[0, a] = c.under_C[source, a]
    if c.metric.shape[0] == 0:
        for a in range(c.modes):
            link[0, a] += scale * B[source, a]
        return
    for a in range(c.metric.shape[0]):
        row = 0.0
        for i in range(c.metric.shape[0]):
            row += c.metric[a, i] * B[source, i]
        link[0, a] += scale * row


def _spread(c, i, B, time_s, M, b, link):
    """What a sweeping nut passes on top of its mean: one shape fades.

    The rate goes with the variance of the places swept: with the square of the stretch, which is about the
    reciprocal of the column's squared size.
    """
    source = c.spreads.source[i]
    size = squared(c.place_gain[source]) * _product(c, B[source], B[source])
    nut = squared(c.spreads.swept[source] / c.spreads.at_rest[source])
    now = squared(c.spreads.swept[source] / size)
    lost = -expm1(-c.spreads.rate_1_s[i] * min(max((now - nut) / (1.0 - nut), 0.0), 1.0) * time_s)
    if lost == 0.0:  # the nut stands
        return
    warm = 0.0
    for a in range(c.spreads.row.shape[1]):
        warm += c.spreads.row[i, a] * b[a]
    for a in range(c.spreads.row.shape[1]):
        b[a] -= lost * warm * c.spreads.into[i, a]
    _pass_on(c.spreads.row[i], c.spreads.into[i], -lost, c.spreads.row.shape[1], M, link[2])


def _pass_on(read, into, share, n_x, M, sums):
    """M += share · into (readᵀ M) over the first n_x rows of M (n_x, r); `sums` (w,) is scratch.

    Columns are taken w at a time.
    """
    first = 0
    while first < M.shape[1]:
        count = min(len(sums), M.shape[1] - first)
        for q in range(count):
            sums[q] = 0.0
        for a in range(n_x):
            weight = read[a]
            for q in range(count):
                sums[q] += weight * M[a, first + q]
        for a in range(n_x):
            weight = share * into[a]
            for q in range(count):
                M[a, first + q] += weight * sums[q]
        first += count


def swept(c, source, shapes, time_s, x, order):
    """What a nut passes to its nodes on top of its mean, where the places swept are known: the squares of
    the `shapes` (e, w) add up to the covariance of its input column over the time. They are taken from the
    first on (`order` 1) or from the last (-1).
    """
    rate_1_s = 0.0
    for i in range(len(c.links.source)):
        if c.links.source[i] == source:
            rate_1_s += c.links.conductance_W_K[i] * c.conductance_W_m * squared(c.place_gain[source])
    for number in range(shapes.shape[0]):
        e = number if order > 0 else shapes.shape[0] - 1 - number
        size = _product(c, shapes[e], shapes[e])
        if size > 0.0:
            part = -expm1(-rate_1_s * size * time_s) * _product(c, shapes[e], x) / size
            for a in range(shapes.shape[1]):
                x[a] -= part * shapes[e, a]


def faded(c, j, z, B, x):
    """The factor on the law of source j at the temperature under it."""
    if c.fades.per_K[j] == 0.0:
        return 1.0
    seen_degC = c.conductance_W_m * c.place_gain[j] * _product(c, B[j], x)
    for a in range(c.under_C.shape[1]):
        seen_degC += c.under_C[j, a] * x[a]
    for q in range(len(z)):
        seen_degC += c.under_F[j, q] * z[q]
    return exp(-c.fades.per_K[j] * (seen_degC - c.fades.reference_degC[j]))
