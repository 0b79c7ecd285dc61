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

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.compiled import inlined
from observer.frames import FloatArray
from observer.physics.constants import ZERO_DEGC_K


class Films(NamedTuple):
    """Films along stretches: orthonormal shapes `shape` (f, N) that decay at the rates `rate_1_s` (f,), and
    what 1 °C of ambient gives the modes, `ambient` (N,).
    """

    rate_1_s: FloatArray
    shape: FloatArray
    ambient: FloatArray


class Links(NamedTuple):
    """Links between nodes and the screw: at which `source` (k,) they touch it, `conductance_W_K` (k,), the
    rows `C` (k, n_x) that read the nodes, and the columns `B` (k, n_x) of 1 J into them.
    """

    source: NDArray[np.int64]
    conductance_W_K: FloatArray
    C: FloatArray
    B: FloatArray


class Spreads(NamedTuple):
    """Under a nut that sweeps over its stroke, colder places take more: the orthonormal shapes `shape` (e, N)
    of the links at `source` (e,) decay at `rate_1_s` (e,) where its column is that of the whole stroke, of
    the squared size `swept` (m,), and not at all where it is that of a nut in one place, `at_rest` (m,).
    """

    source: NDArray[np.int64]
    rate_1_s: FloatArray
    shape: FloatArray
    swept: FloatArray
    at_rest: FloatArray


class SensorLags(NamedTuple):
    """Sensors that lag: the `state` (l,) of each, its `rate_1_s` (l,), and what it goes towards: rows of the
    states, `C` (l, n_x), and of the known inputs, `F` (l, p).
    """

    state: NDArray[np.int64]
    rate_1_s: FloatArray
    C: FloatArray
    F: FloatArray


class Fades(NamedTuple):
    """Friction that fades with the temperature under its source: `per_K` (m,), from `reference_degC` (m,)."""

    per_K: FloatArray
    reference_degC: FloatArray


class Coupling(NamedTuple):
    """The couplings of a plant with n_x states, m sources and p known inputs, as plain arrays.

    `active` is 0 where there is none; `ambient` is that known input's column. `conductance_W_m` is kA, which
    turns an input column B_j into the row that reads the mean temperature under source j; `under_C` (m, n_x),
    `under_F` (m, p) add what the dropped modes hold there, and `place_gain` (m,) makes up for the part of a
    source's heat that its column leaves to nodes. `uniform`, `mean` (n_x,): the modes of 1 °C everywhere, and
    the row of the mean temperature. `square` turns the sum of the modes' squares into the mean square of the
    temperature, and `radiation` is ε σ P/(ρ c A), 1/(s K³). `screw` states come before those of the nodes,
    `nodes` is how many these are.
    """

    active: int
    ambient: int
    modes: int
    screw: int
    nodes: int
    conductance_W_m: float
    place_gain: FloatArray
    under_C: FloatArray
    under_F: FloatArray
    uniform: FloatArray
    mean: FloatArray
    square: float
    radiation: float
    films: Films
    links: Links
    spreads: Spreads
    lags: SensorLags
    fades: Fades

    @property
    def states(self) -> int:
        """How many states the couplings add to the plant."""
        return self.nodes + len(self.lags.state)


def packed(record: Any) -> Any:
    """Return a record, and the records in it, with every array in the one layout that compiled code takes."""
    if isinstance(record, np.ndarray):
        return np.require(record, requirements=["C", "W"])
    return type(record)(*map(packed, record)) if isinstance(record, tuple) else record


def no_coupling(n_x: int, sources: int, known: int, modes: int = 0) -> Coupling:
    """Return the coupling of a plant without any."""
    none, nothing, no_shape = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, modes))
    return Coupling(
        active=0,
        ambient=0,
        modes=modes,
        screw=n_x,
        nodes=0,
        conductance_W_m=0.0,
        place_gain=np.ones(sources),
        under_C=np.zeros((sources, n_x)),
        under_F=np.zeros((sources, known)),
        uniform=np.zeros(n_x),
        mean=np.zeros(n_x),
        square=0.0,
        radiation=0.0,
        films=Films(nothing, no_shape, nothing),
        links=Links(none, nothing, np.zeros((0, n_x)), np.zeros((0, n_x))),
        spreads=Spreads(none, nothing, no_shape, np.zeros(sources), np.zeros(sources)),
        lags=SensorLags(none, nothing, np.zeros((0, n_x)), np.zeros((0, known))),
        fades=Fades(np.zeros(sources), np.zeros(sources)),
    )


@inlined
def coupled(c, loss_1_s, loss_degC, z, B, half_s, x, M, b):  # type: ignore[no-untyped-def]
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


@inlined
def couple(c, loss_1_s, loss_degC, z, B, half_s, x, M, b):  # type: ignore[no-untyped-def]
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
        mean_K, around_K = mean_degC + ZERO_DEGC_K, z[c.ambient] + ZERO_DEGC_K
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
    lost = -np.expm1(-c.films.rate_1_s[f] * time_s)
    drive = 0.0
    for a in range(c.modes):
        drive += c.films.shape[f, a] * c.films.ambient[a]
    change = lost / c.films.rate_1_s[f] * drive * z[c.ambient]
    for a in range(c.modes):
        change -= lost * c.films.shape[f, a] * b[a]
    for a in range(c.modes):
        b[a] += change * c.films.shape[f, a]
    _fade(c.films.shape[f], lost, M)


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
    source, n_x = c.links.source[i], M.shape[0]
    compliance = 0.0
    for a in range(n_x):
        compliance -= _apart(c, i, B, a) * _passed(c, i, B, a)
    heat_J_K = -np.expm1(-c.links.conductance_W_K[i] * compliance * time_s) / compliance
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
    return c.links.C[i, a] - under(c, c.links.source[i], B, a)


@inlined
def _passed(c, i, B, a):  # type: ignore[no-untyped-def]
    """Entry a of what 1 J from the node of a link to the screw does."""
    source = c.links.source[i]
    return c.place_gain[source] * B[source, a] if a < c.screw else -c.links.B[i, a]


@inlined
def _spread(c, i, B, time_s, M, b):  # type: ignore[no-untyped-def]
    """What a sweeping nut passes on top of its mean: one shape fades.

    The rate goes with the variance of the places swept: with the square of the stretch, which is about the
    reciprocal of the column's squared size.
    """
    source, spreads = c.spreads.source[i], c.spreads
    size = 0.0
    for a in range(c.modes):
        size += (c.place_gain[source] * B[source, a]) ** 2
    nut = (spreads.swept[source] / spreads.at_rest[source]) ** 2
    now = (spreads.swept[source] / size) ** 2
    lost = -np.expm1(-c.spreads.rate_1_s[i] * min(max((now - nut) / (1.0 - nut), 0.0), 1.0) * time_s)
    warm = 0.0
    for a in range(c.modes):
        warm += c.spreads.shape[i, a] * b[a]
    for a in range(c.modes):
        b[a] -= lost * warm * c.spreads.shape[i, a]
    _fade(c.spreads.shape[i], lost, M)


@inlined
def swept(c, source, shapes, time_s, x, order):  # type: ignore[no-untyped-def]
    """What a nut passes to its nodes on top of its mean, where the places swept are known: the squares of
    the `shapes` (e, N) add up to the covariance of its input column over the time. They are taken from the
    first on (`order` 1) or from the last (-1).
    """
    rate_1_s = 0.0
    for i in range(len(c.links.source)):
        if c.links.source[i] == source:
            rate_1_s += c.links.conductance_W_K[i] * c.conductance_W_m * c.place_gain[source] ** 2
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
    state, n_x = c.lags.state[i], M.shape[0]
    taken = -np.expm1(-time_s * c.lags.rate_1_s[i])
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


@inlined
def under(c, source, B, a):  # type: ignore[no-untyped-def]
    """Entry a of the row that reads the temperature under a source."""
    seen = c.under_C[source, a]
    return seen + c.conductance_W_m * c.place_gain[source] * B[source, a] if a < c.modes else seen


@inlined
def faded(c, j, z, B, x):  # type: ignore[no-untyped-def]
    """The factor on the law of source j at the temperature under it."""
    if c.fades.per_K[j] == 0.0:
        return 1.0
    seen_degC = 0.0
    for a in range(c.under_C.shape[1]):
        seen_degC += under(c, j, B, a) * x[a]
    for q in range(len(z)):
        seen_degC += c.under_F[j, q] * z[q]
    return np.exp(-c.fades.per_K[j] * (seen_degC - c.fades.reference_degC[j]))
