"""What couples the plant's states to each other and to the temperature of the moment.

The plant itself is diagonal. A loss that changes with speed or temperature, a film that differs along the
screw, a link to a body that stores heat and a sensor that lags are taken in half a step before and half a
step after the exact diagonal step (Strang 1968), and within each half in an order that reads the same
backwards: the error is of second order in the step, and these couplings are slow against it. Each is solved
exactly by itself, so none can become unstable.
"""

# numba compiles the functions at the end: their types are those of the arrays they get.
# mypy: disable-error-code="misc"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.compiled import inlined
from observer.frames import FloatArray
from observer.physics.constants import ZERO_DEGC_K


class Coupling(NamedTuple):
    """The couplings of a plant with n_x states, m sources and p known inputs, as plain arrays.

    `active` is 0 where there is none. `conductance_W_m` is kA, which turns an input column B_j into the row
    that reads the mean temperature under source j; `under_C` (m, n_x), `under_F` (m, p) add what the dropped
    modes hold there. `uniform`, `mean` (n_x,): the modes of 1 °C everywhere, and the row of the mean
    temperature. `square` turns the sum of the modes' squares into the mean square of the temperature, and
    `radiation` is ε σ P/(ρ c A), 1/(s K³). Films along stretches: their rates `film_1_s` (f,)
    with the orthonormal shapes `film_shape` (f, N) that decay at them, and `film_ambient` (N,), the input of
    1 °C of ambient. Links between nodes and the screw: `link_source` (k,), where on the screw, `link_W_K`
    (k,), the row `link_C` (k, n_x) that reads the node, and the column `link_B` (k, n_x) of 1 J into it;
    `screw` states come before those of the nodes, `nodes` is how many these are, and `place_gain` (m,) makes
    up for the part of a source's heat that its input column leaves to nodes. Under a nut that sweeps over
    its stroke, colder places take more: the orthonormal shapes `spread_shape` (e, N) of the links at source
    `spread_source` (e,) decay at `spread_1_s` (e,) where its column is that of the whole stroke, of the
    squared size `swept` (m,), and not at all where it is that of a nut in one place, `standing` (m,). Lagging
    sensors: `lag_state`
    (l,), `lag_rate_1_s` (l,), `lag_C` (l, n_x), `lag_F` (l, p). Fading friction: `fade_1_K`, `fade_degC`
    (m,).
    """

    active: int
    modes: int
    conductance_W_m: float
    under_C: FloatArray
    under_F: FloatArray
    uniform: FloatArray
    mean: FloatArray
    square: float
    radiation: float
    film_1_s: FloatArray
    film_shape: FloatArray
    film_ambient: FloatArray
    screw: int
    nodes: int
    place_gain: FloatArray
    link_source: NDArray[np.int64]
    link_W_K: FloatArray
    link_C: FloatArray
    link_B: FloatArray
    spread_source: NDArray[np.int64]
    spread_1_s: FloatArray
    spread_shape: FloatArray
    swept: FloatArray
    standing: FloatArray
    lag_state: NDArray[np.int64]
    lag_rate_1_s: FloatArray
    lag_C: FloatArray
    lag_F: FloatArray
    fade_1_K: FloatArray
    fade_degC: FloatArray

    @property
    def states(self) -> int:
        """How many states the couplings add to the plant."""
        return self.nodes + len(self.lag_state)


def no_coupling(n_x: int, sources: int, known: int, modes: int = 0) -> Coupling:
    """Return the coupling of a plant without any."""
    none, nothing = np.zeros(0, np.int64), np.zeros(0)
    return Coupling(
        active=0,
        modes=modes,
        conductance_W_m=0.0,
        under_C=np.zeros((sources, n_x)),
        under_F=np.zeros((sources, known)),
        uniform=np.zeros(n_x),
        mean=np.zeros(n_x),
        square=0.0,
        radiation=0.0,
        film_1_s=nothing,
        film_shape=np.zeros((0, modes)),
        film_ambient=nothing,
        screw=n_x,
        nodes=0,
        place_gain=np.ones(sources),
        link_source=none,
        link_W_K=nothing,
        link_C=np.zeros((0, n_x)),
        link_B=np.zeros((0, n_x)),
        spread_source=none,
        spread_1_s=nothing,
        spread_shape=np.zeros((0, modes)),
        swept=np.zeros(sources),
        standing=np.zeros(sources),
        lag_state=none,
        lag_rate_1_s=nothing,
        lag_C=np.zeros((0, n_x)),
        lag_F=np.zeros((0, known)),
        fade_1_K=np.zeros(sources),
        fade_degC=np.zeros(sources),
    )


@inlined
def coupled(c, loss_1_s, loss_degC, z, B, half_s, x, M, b):  # type: ignore[no-untyped-def]
    """Fill M (n_x, n_x) and b (n_x,) so that x⁺ = M x + b is what the couplings do in `half_s`.

    `loss_1_s` is the uniform loss of the moment, towards `loss_degC`; z (p,) the known inputs, the ambient
    first; B (m, n_x) the input columns in force, as rows; x the state, of which the first n_x count.
    """
    n_x = M.shape[0]
    for a in range(n_x):
        b[a] = 0.0
        for i in range(n_x):
            M[a, i] = 0.0
        M[a, a] = 1.0
    couple(c, loss_1_s, loss_degC, z, B, half_s, x, M, b)


@inlined
def couple(c, loss_1_s, loss_degC, z, B, half_s, x, M, b):  # type: ignore[no-untyped-def]
    """Do to the columns of M (n_x, r) and to b (n_x,) what the couplings do to a state in `half_s`: M takes
    their linear part alone. The rest is as for `coupled`; a state itself is x and b in one, with r = 0.

    The films act for the whole time, sensors and links half before and half after them.
    """
    rate_1_s, drawn = _uniform_loss(c, loss_1_s, loss_degC, z, x)
    for i in range(len(c.lag_state) - 1, -1, -1):
        _sensor(c, i, z, 0.5 * half_s, M, b)
    for i in range(len(c.spread_1_s) - 1, -1, -1):
        _spread(c, i, B, 0.5 * half_s, M, b)
    for i in range(len(c.link_source) - 1, -1, -1):
        _link(c, i, z, B, 0.5 * half_s, M, b)
    _lose(c, rate_1_s, drawn, 0.5 * half_s, M, b)
    for f in range(len(c.film_1_s)):
        _film(c, f, z, half_s, M, b)
    _lose(c, rate_1_s, drawn, 0.5 * half_s, M, b)
    for i in range(len(c.link_source)):
        _link(c, i, z, B, 0.5 * half_s, M, b)
    for i in range(len(c.spread_1_s)):
        _spread(c, i, B, 0.5 * half_s, M, b)
    for i in range(len(c.lag_state)):
        _sensor(c, i, z, 0.5 * half_s, M, b)


@inlined
def _uniform_loss(c, loss_1_s, loss_degC, z, x):  # type: ignore[no-untyped-def]
    """The rate of the losses that are the same along the screw, 1/s, and rate × what they draw to; radiation
    in its tangent at the mean temperature, and with the variance along the screw in its mean.
    """
    rate, drawn = loss_1_s, loss_1_s * loss_degC
    if c.radiation > 0.0:
        mean_degC, square = 0.0, 0.0
        for a in range(c.modes):
            mean_degC += c.mean[a] * x[a]
            square += c.square * x[a] ** 2
        mean_K, around_K = mean_degC + ZERO_DEGC_K, z[0] + ZERO_DEGC_K
        lost = mean_K**4 + 6.0 * mean_K**2 * max(square - mean_degC**2, 0.0) - around_K**4
        rate += 4.0 * c.radiation * mean_K**3
        drawn += c.radiation * (4.0 * mean_K**3 * mean_degC - lost)
    return rate, drawn


@inlined
def _lose(c, rate_1_s, drawn, time_s, M, b):  # type: ignore[no-untyped-def]
    """Losses that are the same along the screw."""
    if rate_1_s == 0.0:
        return
    keep = np.exp(-rate_1_s * time_s)
    towards_degC = (1.0 - keep) * drawn / rate_1_s
    for a in range(c.modes):
        b[a] = keep * b[a] + towards_degC * c.uniform[a]
        for q in range(M.shape[1]):
            M[a, q] *= keep


@inlined
def _film(c, f, z, time_s, M, b):  # type: ignore[no-untyped-def]
    """One of the orthonormal shapes of films along stretches decays towards what the ambient makes of it."""
    lost = -np.expm1(-c.film_1_s[f] * time_s)
    drive = 0.0
    for a in range(c.modes):
        drive += c.film_shape[f, a] * c.film_ambient[a]
    change = lost / c.film_1_s[f] * drive * z[0]
    for a in range(c.modes):
        change -= lost * c.film_shape[f, a] * b[a]
    for a in range(c.modes):
        b[a] += change * c.film_shape[f, a]
    _fade(c.film_shape[f], lost, M)


@inlined
def _fade(shape, lost, M):  # type: ignore[no-untyped-def]
    """The part `lost` of an orthonormal shape goes from the columns of M."""
    for q in range(M.shape[1]):
        warm = 0.0
        for a in range(len(shape)):
            warm += shape[a] * M[a, q]
        for a in range(len(shape)):
            M[a, q] -= lost * warm * shape[a]


@inlined
def _link(c, i, z, B, time_s, M, b):  # type: ignore[no-untyped-def]
    """A node gives Q = G (T_node − T) to the screw.

    With d the row of the difference and v the column of 1 J passed, dx/dt = G v d x: both temperatures meet
    at the rate κ = −G d·v.
    """
    source, n_x = c.link_source[i], M.shape[0]
    compliance = 0.0
    for a in range(n_x):
        compliance -= _apart(c, i, B, a) * _passed(c, i, B, a)
    heat_J_K = -np.expm1(-c.link_W_K[i] * compliance * time_s) / compliance
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


@inlined
def _apart(c, i, B, a):  # type: ignore[no-untyped-def]
    """Entry a of the row that reads how much warmer the node of a link is than the screw."""
    return c.link_C[i, a] - under(c, c.link_source[i], B, a)


@inlined
def _passed(c, i, B, a):  # type: ignore[no-untyped-def]
    """Entry a of what 1 J from the node of a link to the screw does."""
    source = c.link_source[i]
    return c.place_gain[source] * B[source, a] if a < c.screw else -c.link_B[i, a]


@inlined
def _spread(c, i, B, time_s, M, b):  # type: ignore[no-untyped-def]
    """What a sweeping nut passes on top of its mean: one shape fades.

    The rate goes with the variance of the places swept: with the square of the stretch, which is about the
    reciprocal of the column's squared size.
    """
    source = c.spread_source[i]
    size = 0.0
    for a in range(c.modes):
        size += (c.place_gain[source] * B[source, a]) ** 2
    nut, now = (c.swept[source] / c.standing[source]) ** 2, (c.swept[source] / size) ** 2
    lost = -np.expm1(-c.spread_1_s[i] * min(max((now - nut) / (1.0 - nut), 0.0), 1.0) * time_s)
    warm = 0.0
    for a in range(c.modes):
        warm += c.spread_shape[i, a] * b[a]
    for a in range(c.modes):
        b[a] -= lost * warm * c.spread_shape[i, a]
    _fade(c.spread_shape[i], lost, M)


@inlined
def swept(c, source, shapes, time_s, x, order):  # type: ignore[no-untyped-def]
    """What a nut passes to its nodes on top of its mean, where the places swept are known: the squares of
    the `shapes` (e, N) add up to the covariance of its input column over the time. They are taken from the
    first on (`order` 1) or from the last (-1).
    """
    rate_1_s = 0.0
    for i in range(len(c.link_source)):
        if c.link_source[i] == source:
            rate_1_s += c.link_W_K[i] * c.conductance_W_m * c.place_gain[source] ** 2
    for number in range(shapes.shape[0]):
        e = number if order > 0 else shapes.shape[0] - 1 - number
        size, warm = 0.0, 0.0
        for a in range(c.modes):
            size += shapes[e, a] ** 2
            warm += shapes[e, a] * x[a]
        if size > 0.0:
            part = -np.expm1(-rate_1_s * size * time_s) * warm / size
            for a in range(c.modes):
                x[a] -= part * shapes[e, a]


@inlined
def _sensor(c, i, z, time_s, M, b):  # type: ignore[no-untyped-def]
    """A sensor goes towards the temperature below it."""
    state, n_x = c.lag_state[i], M.shape[0]
    taken = -np.expm1(-time_s * c.lag_rate_1_s[i])
    below = 0.0
    for q in range(len(z)):
        below += c.lag_F[i, q] * z[q]
    for a in range(n_x):
        below += c.lag_C[i, a] * b[a]
    b[state] += taken * (below - b[state])
    for q in range(M.shape[1]):
        below = 0.0
        for a in range(n_x):
            below += c.lag_C[i, a] * M[a, q]
        M[state, q] += taken * (below - M[state, q])


@inlined
def under(c, source, B, a):  # type: ignore[no-untyped-def]
    """Entry a of the row that reads the temperature under a source."""
    seen = c.under_C[source, a]
    return seen + c.conductance_W_m * c.place_gain[source] * B[source, a] if a < c.modes else seen


@inlined
def faded(c, j, z, B, x):  # type: ignore[no-untyped-def]
    """The factor on the law of source j at the temperature under it."""
    if c.fade_1_K[j] == 0.0:
        return 1.0
    seen_degC = 0.0
    for a in range(c.under_C.shape[1]):
        seen_degC += under(c, j, B, a) * x[a]
    for q in range(len(z)):
        seen_degC += c.under_F[j, q] * z[q]
    return np.exp(-c.fade_1_K[j] * (seen_degC - c.fade_degC[j]))
