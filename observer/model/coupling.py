"""What couples the plant's states to each other and to the temperature of the moment.

The plant itself is diagonal. A loss that changes with speed or temperature, a film that differs along the
screw, a body that stores heat and a sensor that lags are taken in half a step before and half a step after
the exact diagonal step (Strang 1968), and within each half in an order that reads the same backwards: the
error is of second order in the step, and these couplings are slow against it. Each is solved exactly by
itself, so none can become unstable.
"""

# numba compiles the functions at the end: their types are those of the arrays they get.
# mypy: disable-error-code="misc"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.compiling import inlined
from observer.frames import FloatArray

ZERO_DEGC_K = 273.15


class Coupling(NamedTuple):
    """The couplings of a plant with n_x states, m sources and p known inputs, as plain arrays.

    `active` is 0 where there is none. `conductance_W_m` is kA, which turns an input column B_j into the row
    that reads the mean temperature under source j; `under_C` (m, n_x), `under_F` (m, p) add what the dropped
    modes hold there. `uniform`, `mean` (n_x,): the modes of 1 °C everywhere, and the row of the mean
    temperature. `radiation` is ε σ P/(ρ c A), 1/(s K³). Films along stretches: their rates `film_1_s` (f,)
    with the orthonormal shapes `film_shape` (f, N) that decay at them, and `film_ambient` (N,), the input of
    1 °C of ambient. Bodies: `body_state`, `body_source` (b,), `body_capacity_J_K`, `body_conductance_W_K`
    (b,). Lagging sensors: `lag_state` (l,), `lag_rate_1_s` (l,), `lag_C` (l, n_x), `lag_F` (l, p). Fading
    friction: `fade_1_K`, `fade_degC` (m,).
    """

    active: int
    modes: int
    conductance_W_m: float
    under_C: FloatArray
    under_F: FloatArray
    uniform: FloatArray
    mean: FloatArray
    radiation: float
    film_1_s: FloatArray
    film_shape: FloatArray
    film_ambient: FloatArray
    body_state: NDArray[np.int64]
    body_source: NDArray[np.int64]
    body_capacity_J_K: FloatArray
    body_conductance_W_K: FloatArray
    lag_state: NDArray[np.int64]
    lag_rate_1_s: FloatArray
    lag_C: FloatArray
    lag_F: FloatArray
    fade_1_K: FloatArray
    fade_degC: FloatArray

    @property
    def states(self) -> int:
        """How many states the couplings add to the plant."""
        return len(self.body_state) + len(self.lag_state)


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
        radiation=0.0,
        film_1_s=nothing,
        film_shape=np.zeros((0, modes)),
        film_ambient=nothing,
        body_state=none,
        body_source=none,
        body_capacity_J_K=nothing,
        body_conductance_W_K=nothing,
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
    first; B (m, n_x) the input columns in force, as rows; x the state, of which the first n_x count. The
    films act for the whole time, bodies and sensors half before and half after them.
    """
    _films(c, loss_1_s, loss_degC, z, half_s, x, M, b)
    for i in range(len(c.body_state)):
        _body(c, i, z, B, 0.5 * half_s, M, b)
    for i in range(len(c.lag_state)):
        _sensor(c, i, z, 0.5 * half_s, M, b)


@inlined
def _films(c, loss_1_s, loss_degC, z, time_s, x, M, b):  # type: ignore[no-untyped-def]
    """Uniform losses, radiation in its tangent at the mean temperature, and films along stretches."""
    n_x = M.shape[0]
    for a in range(n_x):
        b[a] = 0.0
        for i in range(n_x):
            M[a, i] = 0.0
        M[a, a] = 1.0
    rate, drawn = loss_1_s, loss_1_s * loss_degC
    if c.radiation > 0.0:
        mean_degC = 0.0
        for a in range(c.modes):
            mean_degC += c.mean[a] * x[a]
        mean_K, around_K = mean_degC + ZERO_DEGC_K, z[0] + ZERO_DEGC_K
        rate += 4.0 * c.radiation * mean_K**3
        drawn += c.radiation * (4.0 * mean_K**3 * mean_degC - (mean_K**4 - around_K**4))
    keep = np.exp(-0.5 * rate * time_s)
    towards = (1.0 - keep) * drawn / rate if rate > 0.0 else 0.0
    for a in range(c.modes):
        M[a, a] = keep * keep
        b[a] = towards * (1.0 + keep) * c.uniform[a]
        if len(c.film_1_s) > 0:
            b[a] += keep * time_s * c.film_ambient[a] * z[0]
    for f in range(len(c.film_1_s)):
        lost = -np.expm1(-c.film_1_s[f] * time_s)
        warm, drive = 0.0, 0.0
        for a in range(c.modes):
            warm += c.film_shape[f, a] * towards * c.uniform[a]
            drive += c.film_shape[f, a] * c.film_ambient[a] * z[0]
        change = keep * ((lost / c.film_1_s[f] - time_s) * drive - lost * warm)
        for a in range(c.modes):
            b[a] += change * c.film_shape[f, a]
            share = keep * keep * lost * c.film_shape[f, a]
            for i in range(c.modes):
                M[a, i] -= share * c.film_shape[f, i]


@inlined
def _body(c, i, z, B, time_s, M, b):  # type: ignore[no-untyped-def]
    """A body gives Q = G (T_b − T) to the screw, before and after what M and b already do.

    Both temperatures meet at the rate κ = G (1/C + r·B), r the row of the temperature under the body.
    """
    state, source, n_x = c.body_state[i], c.body_source[i], M.shape[0]
    compliance = 1.0 / c.body_capacity_J_K[i]
    for a in range(n_x):
        compliance += under(c, source, B, a) * B[source, a]
    G = c.body_conductance_W_K[i]
    heat_J_K = -np.expm1(-G * compliance * time_s) / compliance
    around_degC = 0.0
    for q in range(len(z)):
        around_degC += c.under_F[source, q] * z[q]
    for a in range(n_x):  # first the body, then M
        moved = -M[a, state] / c.body_capacity_J_K[i]
        for q in range(n_x):
            moved += M[a, q] * B[source, q]
        moved *= heat_J_K
        for q in range(n_x):
            M[a, q] -= moved * under(c, source, B, q)
        M[a, state] += moved
        b[a] -= moved * around_degC
    for q in range(n_x):  # then the body again
        heat_J = heat_J_K * M[state, q]
        for a in range(n_x):
            heat_J -= heat_J_K * under(c, source, B, a) * M[a, q]
        for a in range(n_x):
            M[a, q] += B[source, a] * heat_J
        M[state, q] -= heat_J / c.body_capacity_J_K[i]
    heat_J = heat_J_K * (b[state] - around_degC)
    for a in range(n_x):
        heat_J -= heat_J_K * under(c, source, B, a) * b[a]
    for a in range(n_x):
        b[a] += B[source, a] * heat_J
    b[state] -= heat_J / c.body_capacity_J_K[i]


@inlined
def _sensor(c, i, z, time_s, M, b):  # type: ignore[no-untyped-def]
    """A sensor goes towards the temperature below it, before and after what M and b already do."""
    state, n_x = c.lag_state[i], M.shape[0]
    taken = -np.expm1(-time_s * c.lag_rate_1_s[i])
    around = 0.0
    for q in range(len(z)):
        around += taken * c.lag_F[i, q] * z[q]
    for a in range(n_x):
        own = M[a, state]
        M[a, state] -= taken * own
        for q in range(n_x):
            M[a, q] += taken * own * c.lag_C[i, q]
        b[a] += own * around
    for q in range(n_x):
        below = 0.0
        for a in range(n_x):
            below += c.lag_C[i, a] * M[a, q]
        M[state, q] += taken * (below - M[state, q])
    below = 0.0
    for a in range(n_x):
        below += c.lag_C[i, a] * b[a]
    b[state] += taken * (below - b[state]) + around


@inlined
def under(c, source, B, a):  # type: ignore[no-untyped-def]
    """Entry a of the row that reads the temperature under a source."""
    seen = c.under_C[source, a]
    return seen + c.conductance_W_m * B[source, a] if a < c.modes else seen


@inlined
def faded(c, j, z, B, x):  # type: ignore[no-untyped-def]
    """The factor on the law of source j at the temperature under it."""
    if c.fade_1_K[j] == 0.0:
        return 1.0
    seen_degC = 0.0
    for a in range(B.shape[1]):
        seen_degC += under(c, j, B, a) * x[a]
    for q in range(len(z)):
        seen_degC += c.under_F[j, q] * z[q]
    return np.exp(-c.fade_1_K[j] * (seen_degC - c.fade_degC[j]))
