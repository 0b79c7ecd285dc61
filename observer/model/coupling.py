"""What couples the plant's states to each other and to the temperature of the moment.

The plant itself is diagonal. A loss that changes with speed or temperature, a film that differs along the
screw, a body that stores heat and a sensor that lags are taken in half a step before and half a step after
the exact diagonal step (Strang 1968): the error is of second order in the step, and these couplings are slow
against it. Each is solved exactly by itself, so none can become unstable.
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
    that reads the mean temperature under source j. `uniform`, `mean` (n_x,): the modes of 1 °C everywhere,
    and the row of the mean temperature. `radiation` is ε σ P/(ρ c A), 1/(s K³). `film` (n_x, n_x), 1/s, and
    `film_ambient` (n_x,): a film along a stretch. Bodies: `body_state`, `body_source` (b,),
    `body_capacity_J_K`, `body_conductance_W_K` (b,). Lagging sensors: `lag_state` (l,), `lag_rate_1_s` (l,),
    `lag_C` (l, n_x), `lag_F` (l, p). Fading friction: `fade_1_K`, `fade_degC` (m,).
    """

    active: int
    modes: int
    conductance_W_m: float
    uniform: FloatArray
    mean: FloatArray
    radiation: float
    film: FloatArray
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
        uniform=np.zeros(n_x),
        mean=np.zeros(n_x),
        radiation=0.0,
        film=np.zeros((0, 0)),
        film_ambient=np.zeros(0),
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
    first; B (m, n_x) the input columns in force, as rows; x the state, of which the first n_x count.
    """
    n_x = M.shape[0]
    for a in range(n_x):
        b[a] = 0.0
        for i in range(n_x):
            M[a, i] = 0.0
        M[a, a] = 1.0
    rate, drawn = loss_1_s, loss_1_s * loss_degC
    if c.radiation > 0.0:
        mean_K = ZERO_DEGC_K
        for a in range(c.modes):
            mean_K += c.mean[a] * x[a]
        around_K = z[0] + ZERO_DEGC_K
        radiated = c.radiation * (mean_K**2 + around_K**2) * (mean_K + around_K)
        rate += radiated
        drawn += radiated * z[0]
    if rate > 0.0:
        keep = np.exp(-rate * half_s)
        for a in range(c.modes):
            M[a, a] = keep
            b[a] = (1.0 - keep) * c.uniform[a] * drawn / rate
    for a in range(c.film.shape[0]):
        b[a] += half_s * c.film_ambient[a] * z[0]
        for i in range(c.film.shape[1]):
            M[a, i] -= half_s * c.film[a, i]
    for i in range(len(c.body_state)):
        _body(c, i, B, half_s, M)
    for i in range(len(c.lag_state)):
        state = c.lag_state[i]
        taken = -np.expm1(-half_s * c.lag_rate_1_s[i])
        M[state, state] = 1.0 - taken
        for a in range(n_x):
            M[state, a] += taken * c.lag_C[i, a]
        for q in range(len(z)):
            b[state] += taken * c.lag_F[i, q] * z[q]


@inlined
def _body(c, i, B, half_s, M):  # type: ignore[no-untyped-def]
    """A body gives Q = G (T_b − T) to the screw; both meet at the rate κ = G (1/C + Σ kA B²)."""
    state, source = c.body_state[i], c.body_source[i]
    compliance = 0.0
    for a in range(c.modes):
        compliance += c.conductance_W_m * B[source, a] ** 2
    kappa = c.body_conductance_W_K[i] * (1.0 / c.body_capacity_J_K[i] + compliance)
    gain = -c.body_conductance_W_K[i] * np.expm1(-kappa * half_s) / kappa
    into = gain / c.body_capacity_J_K[i]
    M[state, state] -= into
    for q in range(c.modes):
        row = c.conductance_W_m * B[source, q]
        M[state, q] += into * row
        for a in range(B.shape[1]):
            M[a, q] -= B[source, a] * gain * row
    for a in range(B.shape[1]):
        if a != state:
            M[a, state] += B[source, a] * gain


@inlined
def faded(c, j, B, x):  # type: ignore[no-untyped-def]
    """The factor on the law of source j at the temperature under it."""
    if c.fade_1_K[j] == 0.0:
        return 1.0
    seen_degC = 0.0
    for a in range(c.modes):
        seen_degC += c.conductance_W_m * B[j, a] * x[a]
    return np.exp(-c.fade_1_K[j] * (seen_degC - c.fade_degC[j]))
