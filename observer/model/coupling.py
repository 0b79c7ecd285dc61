"""Couplings of a plant's states that vary in time: nuts that move, losses with speed or temperature,
friction that fades.

Constant couplings are in the plant's own modes (`generator`). The rest is taken in half a step before and
half a step after the exact diagonal step (Strang 1968), and within each half in an order that reads the same
backwards: the error is of second order in the step, and these couplings are slow against it. Each is solved
exactly by itself, so none can become unstable.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.frames import FloatArray
from observer.kernels.layout import aligned_zeros, padded_width
from observer.units import ZERO_DEGC_K

_REGISTER = 8


class Links(NamedTuple):
    """Links between nodes and a nut that moves: the `source` (k,) of each, `conductance_W_K` (k,), the rows
    `C` (k, n_x) that read the nodes, and `B` (k, n_x): 1 J passed from a node to the screw does what 1 J of
    the source does there, less this.
    """

    source: NDArray[np.int64]
    conductance_W_K: FloatArray
    C: FloatArray
    B: FloatArray


class Spreads(NamedTuple):
    """Under a nut that sweeps over its stroke, colder places take more: the orthonormal shapes of the links
    at source j, from number `first` (m + 1,) of j to that of the next, which `row` (e, w) reads and `into`
    (e, w) warms, decay at `rate_1_s` (e,) where its column is that of the whole stroke, of the squared size
    `swept` (m,), and not at all where it is that of a nut in one place, `at_rest` (m,).
    """

    first: NDArray[np.int64]
    rate_1_s: FloatArray
    row: FloatArray
    into: FloatArray
    swept: FloatArray
    at_rest: FloatArray


class CoupledColumns(NamedTuple):
    """Columns on which couplings act: `X` (n_x, w), `known` (p + 1, w), scratch `sums` (f, w) (see
    `kernels.coupling`).
    """

    X: FloatArray
    known: FloatArray
    sums: FloatArray


def state_column(coupling: Coupling) -> CoupledColumns:
    """Return room for one state."""
    n_x, inputs = len(coupling.uniform), coupling.under_F.shape[1] + 1
    return CoupledColumns(np.zeros((n_x, 1)), np.ones((inputs, 1)), np.zeros((_most_factors(coupling), 1)))


def half_step_columns(coupling: Coupling) -> tuple[CoupledColumns, FloatArray]:
    """Return room for the matrix [M N r] of half a step, and for its transpose (w, W): N begins at column W,
    so that the columns of M are padded with zeros to whole registers.
    """
    n_x, inputs = len(coupling.uniform), coupling.under_F.shape[1] + 1
    first = padded_width(n_x, _REGISTER)
    width = padded_width(first + inputs, _REGISTER // 2)
    columns = CoupledColumns(
        *(aligned_zeros((rows, width)) for rows in (n_x, inputs, _most_factors(coupling)))
    )
    columns.known[np.arange(inputs), first + np.arange(inputs)] = 1.0
    return columns, aligned_zeros((width, first))


def link_scratch(coupling: Coupling) -> FloatArray:
    """Return scratch of the couplings, (4, w)."""
    return aligned_zeros((4, max(len(coupling.uniform), len(coupling.spreads.rate_1_s))))


def _most_factors(c: Coupling) -> int:
    """How many factors are taken together at most."""
    return int(max(1, len(c.beside), len(c.uneven.rate), *np.diff(c.spreads.first)))


class Fades(NamedTuple):
    """Friction that fades with the temperature under its source: `per_K` (m,), from `reference_degC` (m,)."""

    per_K: FloatArray
    reference_degC: FloatArray


class Uneven(NamedTuple):
    """How a film loses of a screw with sections: e shapes, of which each loses by itself at its multiple
    `rate` (e,) of the loss of the screw's own diameter and bore. The rows `row` (e, n_x) read them, the rows
    `into` (e, n_x) change them; of a uniform screw, which loses alike everywhere, there is none.
    """

    rate: FloatArray
    row: FloatArray
    into: FloatArray


class Coupling(NamedTuple):
    """The couplings of a plant with n_x states, m sources and p known inputs, as plain arrays.

    `active` is 0 where there is none; `ambient` is that known input's column. `conductance_W_m` is kA, which
    turns an input column B_j into the row that reads the mean temperature under source j; `under_C` (m, n_x),
    `under_F` (m, p) add what the dropped modes hold there, and `place_gain` (m,) makes up for the part of a
    source's heat that its column leaves to nodes. `uniform`, `mean` (n_x,): the state of a screw at 1 °C that
    warms nothing else, and the row of its mean temperature. `square` turns the sum of the modes' squares into
    the mean square of the temperature, and `radiation` is ε σ P/(ρ c A), 1/(s K³), of temperatures above
    −`zero_degC_K` °C. `rising` is the loss of a film that grows with the fourth root of its own rise over the
    air, at a rise of 1 K, 1/(s K^(1/4)).

    Where the states are those of another basis, x = V ξ: `metric` (n_x, n_x) makes of ξ the sum of the modes'
    squares, and the rows `beside` (r, n_x) read the states that are no modes, which the rows `beside_into`
    (r, n_x) change. Where not, all three are empty, and the first `modes` states are the modes.
    """

    active: int
    ambient: int
    modes: int
    conductance_W_m: float
    place_gain: FloatArray
    under_C: FloatArray
    under_F: FloatArray
    uniform: FloatArray
    mean: FloatArray
    square: float
    radiation: float
    rising: float
    zero_degC_K: float
    metric: FloatArray
    beside: FloatArray
    beside_into: FloatArray
    links: Links
    spreads: Spreads
    fades: Fades
    uneven: Uneven


def no_coupling(n_x: int, sources: int, inputs: int, modes: int = 0) -> Coupling:
    """Return the coupling of a plant without any."""
    no_index, no_rate, no_shape = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, modes))
    return Coupling(
        active=0,
        ambient=0,
        modes=modes,
        conductance_W_m=0.0,
        place_gain=np.ones(sources),
        under_C=np.zeros((sources, n_x)),
        under_F=np.zeros((sources, inputs)),
        uniform=np.zeros(n_x),
        mean=np.zeros(n_x),
        square=0.0,
        radiation=0.0,
        rising=0.0,
        zero_degC_K=ZERO_DEGC_K,
        metric=np.zeros((0, 0)),
        beside=np.zeros((0, n_x)),
        beside_into=np.zeros((0, n_x)),
        links=Links(no_index, no_rate, np.zeros((0, n_x)), np.zeros((0, n_x))),
        spreads=Spreads(
            np.zeros(sources + 1, np.int64), no_rate, no_shape, no_shape, np.zeros(sources), np.zeros(sources)
        ),
        fades=Fades(np.zeros(sources), np.zeros(sources)),
        uneven=Uneven(no_rate, np.zeros((0, n_x)), np.zeros((0, n_x))),
    )
