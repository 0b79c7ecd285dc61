"""What couples the plant's states to each other and to the temperature of the moment.

The plant itself is diagonal. A loss that changes with speed or temperature, a film that differs along the
screw, a link to a body that stores heat and a sensor that lags are taken in half a step before and half a
step after the exact diagonal step (Strang 1968), and within each half in an order that reads the same
backwards: the error is of second order in the step, and these couplings are slow against it. Each is solved
exactly by itself, so none can become unstable.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    temperature, and `radiation` is ε σ P/(ρ c A), 1/(s K³), of temperatures above −`zero_degC_K` °C. `screw`
    states come before those of the nodes, `nodes` is how many these are.
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
    zero_degC_K: float
    films: Films
    links: Links
    spreads: Spreads
    lags: SensorLags
    fades: Fades

    @property
    def lasting(self) -> bool:
        """Whether anything couples the states for good, and not by the moment."""
        return len(self.films.rate_1_s) + len(self.links.source) + len(self.lags.state) > 0

    @property
    def states(self) -> int:
        """How many states the couplings add to the plant."""
        return self.nodes + len(self.lags.state)


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
        zero_degC_K=ZERO_DEGC_K,
        films=Films(nothing, no_shape, nothing),
        links=Links(none, nothing, np.zeros((0, n_x)), np.zeros((0, n_x))),
        spreads=Spreads(none, nothing, no_shape, np.zeros(sources), np.zeros(sources)),
        lags=SensorLags(none, nothing, np.zeros((0, n_x)), np.zeros((0, known))),
        fades=Fades(np.zeros(sources), np.zeros(sources)),
    )
