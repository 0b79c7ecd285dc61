"""Couplings of a plant's states, with the records of `observer.model.coupling`.

Couplings act for half a step before and half a step after the exact diagonal step (Strang 1968). Within each
half their order is symmetric, so the error is of second order in the step. Each coupling is solved exactly,
so all are stable.

They act on columns X (n_x, w). A state is one column. The matrix of a half step has a column for each state,
each known input and the constant. `inputs` (p + 1, w) contains the known inputs and a one for these columns.
Factors that do not act on each other are taken together; `sums` (f, w) is scratch for f of them.
"""

from __future__ import annotations

from observer.kernels.covariance import add_row, add_scaled, squared
from observer.kernels.libc import exp, expm1, sqrt


def couple(c, rate_1_s, drawn, B, half_s, columns, link):
    """Take the columns over the time `half_s` of the couplings.

    `rate_1_s` and `drawn` are those of `uniform_loss`. B (m, n_x) are the current input columns, as rows.
    `link` (4, w) is scratch. The losses act for the whole time, links and shapes half before and half after
    them.
    """
    _fade_shapes(c, B, 0.5 * half_s, link[3])
    for j in range(len(c.place_gain) - 1, -1, -1):
        _spread(c, j, columns, link[3])
    for i in range(len(c.links.source) - 1, -1, -1):
        _link(c, i, B, 0.5 * half_s, columns, link)
    _lose(c, rate_1_s, drawn, half_s, columns, link[2])
    for i in range(len(c.links.source)):
        _link(c, i, B, 0.5 * half_s, columns, link)
    for j in range(len(c.place_gain)):
        _spread(c, j, columns, link[3])


def uniform_loss(c, loss_1_s, loss_degC, ambient_degC, x):
    """Return the rate of the losses that are uniform along the screw, 1/s, and rate × target temperature.

    Radiation and a film that grows with its own rise are taken in their tangents at the mean temperature, and
    with the variance along the screw in their means.
    """
    rate, drawn = loss_1_s, loss_1_s * loss_degC
    if c.radiation == 0.0 and c.rising == 0.0:
        return rate, drawn
    mean_degC = 0.0
    for a in range(len(c.mean)):
        mean_degC += c.mean[a] * x[a]
    square = c.square * _product(c, x, x)
    if c.rising > 0.0:
        rise_K, variance_K2 = mean_degC - ambient_degC, max(square - squared(mean_degC), 0.0)
        size_K = max(abs(rise_K), sqrt(variance_K2))
        tangent_1_s = 1.25 * c.rising * sqrt(sqrt(size_K))
        lost = c.rising * sqrt(sqrt(abs(rise_K))) * rise_K
        if size_K > 0.0:
            lost += 0.125 * tangent_1_s * rise_K / squared(size_K) * variance_K2
        rate += tangent_1_s
        drawn += tangent_1_s * mean_degC - lost
    if c.radiation > 0.0:
        mean_K, around_K = mean_degC + c.zero_degC_K, ambient_degC + c.zero_degC_K
        mean_K2, around_K2 = mean_K * mean_K, around_K * around_K
        mean_K3 = mean_K * mean_K2
        lost = (
            mean_K2 * mean_K2 + 6.0 * mean_K2 * max(square - squared(mean_degC), 0.0) - around_K2 * around_K2
        )
        rate += 4.0 * c.radiation * mean_K3
        drawn += c.radiation * (4.0 * mean_K3 * mean_degC - lost)
    return rate, drawn


def _product(c, x, y):
    """Return the inner product of two states over the screw's modes."""
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


def _lose(c, rate_1_s, drawn, time_s, columns, gain):
    """Take the losses that are uniform along the screw; attached bodies keep their temperatures.

    On a screw with sections each shape has its own rate.
    """
    if rate_1_s == 0.0:
        return
    if len(c.uneven.rate) > 0:
        for e in range(len(c.uneven.rate)):
            gain[e] = expm1(-c.uneven.rate[e] * rate_1_s * time_s)
        _warm(c, -drawn / rate_1_s, columns)
        _read_columns(c.uneven.row, 0, len(c.uneven.rate), columns)
        _add_factors(c.uneven.into, 0, len(c.uneven.rate), gain, columns)
        _warm(c, drawn / rate_1_s, columns)
        return
    keep, lost, states = exp(-rate_1_s * time_s), -expm1(-rate_1_s * time_s), c.modes
    if len(c.non_modal_rows) > 0:  # they get back what they will lose with the screw
        states = len(c.uniform)
        for i in range(len(c.non_modal_rows)):
            gain[i] = lost / keep
        _read_columns(c.non_modal_rows, 0, len(c.non_modal_rows), columns)
        _add_factors(c.non_modal_into, 0, len(c.non_modal_rows), gain, columns)
    for a in range(states):
        for q in range(columns.X.shape[1]):
            columns.X[a, q] *= keep
    _warm(c, lost * drawn / rate_1_s, columns)


def _warm(c, by_K, columns):
    """Warm the whole screw, and nothing else."""
    for a in range(len(c.uniform)):
        add_row(columns.X[a], by_K * c.uniform[a], columns.inputs[columns.inputs.shape[0] - 1])


def _link(c, i, B, time_s, columns, link):
    """Take the heat flow Q = G (T_node − T) from a node to the screw.

    Let d be the row of the difference and v the column of 1 J passed. Then dx/dt = G v d x. Both temperatures
    approach each other at the rate κ = −G d·v.
    """
    source, compliance = c.links.source[i], 0.0
    see_under(c, source, B, link)
    for a in range(columns.X.shape[0]):
        link[0, a] = c.links.C[i, a] - link[0, a]
        link[1, a] = c.place_gain[source] * B[source, a] - c.links.B[i, a]
        compliance -= link[0, a] * link[1, a]
    link[2, 0] = -expm1(-c.links.conductance_W_K[i] * compliance * time_s) / compliance
    _read_columns(link, 0, 1, columns)
    for q in range(c.under_F.shape[1]):
        add_row(columns.sums[0], -c.under_F[source, q], columns.inputs[q])
    _add_factors(link, 1, 1, link[2], columns)


def see_under(c, source, B, link):
    """Put the row that reads the temperature under a source into the first of `link`."""
    scale, n_x = c.conductance_W_m * c.place_gain[source], c.under_C.shape[1]
    for a in range(n_x):
        link[0, a] = 0.0
    if c.metric.shape[0] == 0:
        for a in range(c.modes):
            link[0, a] = B[source, a]
    else:
        add_scaled(link[0, :n_x], c.metric, B[source], n_x)
    for a in range(n_x):
        link[0, a] = c.under_C[source, a] + scale * link[0, a]


def _fade_shapes(c, B, time_s, gain):
    """Write the loss of each shape that fades under a sweeping nut into `gain`; 0 for a standing nut."""
    for j in range(len(c.place_gain)):
        share, first, end = 0.0, c.spreads.first[j], c.spreads.first[j + 1]
        if first < end:
            share = swept_share(c, j, B)
        for i in range(first, end):
            gain[i] = expm1(-c.spreads.rate_1_s[i] * share * time_s)


def swept_share(c, j, B):
    """Return the part of the rates of source j's shapes at which they decay: 0 of a standing nut.

    The rate goes with the variance of the places swept: with the square of the stretch, which is about the
    reciprocal of the column's squared size.
    """
    size = squared(c.place_gain[j]) * _product(c, B[j], B[j])
    nut = squared(c.spreads.swept[j] / c.spreads.at_rest[j])
    now = squared(c.spreads.swept[j] / size)
    return min(max((now - nut) / (1.0 - nut), 0.0), 1.0)


def _spread(c, j, columns, gain):
    """Fade the shapes of a sweeping nut: the heat it passes in addition to its mean."""
    first = c.spreads.first[j]
    count = c.spreads.first[j + 1] - first
    if count > 0 and gain[first] != 0.0:
        _read_columns(c.spreads.row, first, count, columns)
        _add_factors(c.spreads.into, first, count, gain[first:], columns)


def _read_columns(rows, first, count, columns):
    """Write the products of `count` rows with the columns into `sums`."""
    states = min(rows.shape[1], columns.X.shape[0])
    for i in range(count):
        for q in range(columns.X.shape[1]):
            columns.sums[i, q] = 0.0
        add_scaled(columns.sums[i], columns.X, rows[first + i], states)


def _add_factors(into, first, count, gain, columns):
    """X += Σ_i gain_i into_i sums_i, in sums of four, with `sums` as `_read_columns` left them."""
    fours, sums = count // 4 * 4, columns.sums
    for i in range(count):
        for q in range(sums.shape[1]):
            sums[i, q] *= gain[i]
    for a in range(min(into.shape[1], columns.X.shape[0])):
        for i in range(0, fours, 4):
            w0, w1 = into[first + i, a], into[first + i + 1, a]
            w2, w3 = into[first + i + 2, a], into[first + i + 3, a]
            for q in range(sums.shape[1]):
                columns.X[a, q] += (w0 * sums[i, q] + w1 * sums[i + 1, q]) + (
                    w2 * sums[i + 2, q] + w3 * sums[i + 3, q]
                )
        for i in range(fours, count):
            add_row(columns.X[a], into[first + i, a], sums[i])


def swept(c, source, shapes, time_s, x, order):
    """Take the heat that a nut passes to its nodes in addition to its mean, for known swept places.

    The squares of the `shapes` (e, w) add up to the covariance of its input column over the time. They are
    taken from the first on (`order` 1) or from the last (-1).
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
    """Return the factor on the law of source j at the temperature under it."""
    if c.fades.per_K[j] == 0.0:
        return 1.0
    seen_degC = c.conductance_W_m * c.place_gain[j] * _product(c, B[j], x)
    for a in range(c.under_C.shape[1]):
        seen_degC += c.under_C[j, a] * x[a]
    for q in range(len(z)):
        seen_degC += c.under_F[j, q] * z[q]
    return exp(-c.fades.per_K[j] * (seen_degC - c.fades.reference_degC[j]))
