"""Time-varying couplings of a plant's states: moving nuts, losses by speed or temperature, fading friction.

Constant couplings are in the plant's own modes (`generator`). The others are applied for half a step before
and half a step after the exact diagonal step (Strang 1968). Within each half, the order reads the same
backwards, so that the error is of second order in the step. The couplings are slow against a step. Each is
solved exactly on its own and cannot become unstable.
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
    """Links between nodes and moving nuts.

    Attributes:
        source: The source of each link, (k,).
        conductance_W_K: Conductance of each, (k,).
        C: Rows that read the temperatures of the nodes, (k, n_x).
        B: The difference between 1 J of the source and 1 J from the node to the screw, (k, n_x).
    """

    source: NDArray[np.int64]
    conductance_W_K: FloatArray
    C: FloatArray
    B: FloatArray


class Spreads(NamedTuple):
    """Exchange under a nut that sweeps over its stroke, beyond the exchange of the mean temperature.

    Colder places take more heat. The orthonormal shapes of a source decay at `rate_1_s` if the nut sweeps
    over its whole stroke, and not at all if it stands.

    Attributes:
        first: Number of the first shape of each source, (m + 1,).
        rate_1_s: Decay rate of each shape, (e,).
        row: Rows that read the shapes, (e, w).
        into: Rows that change the states, (e, w).
        swept: Squared size of the source's column over the whole stroke, (m,).
        at_rest: The same for a standing nut, (m,).
    """

    first: NDArray[np.int64]
    rate_1_s: FloatArray
    row: FloatArray
    into: FloatArray
    swept: FloatArray
    at_rest: FloatArray


class CoupledColumns(NamedTuple):
    """Columns on which couplings act (see `kernels.coupling`).

    Attributes:
        X: States, (n_x, w).
        inputs: Known inputs and a row of ones, (p + 1, w).
        sums: Scratch, (f, w).
    """

    X: FloatArray
    inputs: FloatArray
    sums: FloatArray


def state_column(coupling: Coupling) -> CoupledColumns:
    """Return memory for one state."""
    n_x, inputs = len(coupling.uniform), coupling.under_F.shape[1] + 1
    return CoupledColumns(np.zeros((n_x, 1)), np.ones((inputs, 1)), np.zeros((_most_factors(coupling), 1)))


def half_step_columns(coupling: Coupling) -> tuple[CoupledColumns, FloatArray]:
    """Return memory for the matrix [M N r] of half a step, and for its transpose (w, W).

    N begins at column W: zeros pad the columns of M to whole registers.
    """
    n_x, inputs = len(coupling.uniform), coupling.under_F.shape[1] + 1
    first = padded_width(n_x, _REGISTER)
    width = padded_width(first + inputs, _REGISTER // 2)
    columns = CoupledColumns(
        *(aligned_zeros((rows, width)) for rows in (n_x, inputs, _most_factors(coupling)))
    )
    columns.inputs[np.arange(inputs), first + np.arange(inputs)] = 1.0
    return columns, aligned_zeros((width, first))


def link_scratch(coupling: Coupling) -> FloatArray:
    """Return scratch memory of the couplings, (4, w)."""
    return aligned_zeros((4, max(len(coupling.uniform), len(coupling.spreads.rate_1_s))))


def _most_factors(c: Coupling) -> int:
    """The largest number of factors that are applied together."""
    return int(max(1, len(c.non_modal_rows), len(c.uneven.rate), *np.diff(c.spreads.first)))


class Fades(NamedTuple):
    """Friction that fades with the temperature under its source: `per_K` (m,), from `reference_degC` (m,)."""

    per_K: FloatArray
    reference_degC: FloatArray


class Uneven(NamedTuple):
    """The loss of a screw with sections by a film, as e shapes that decay independently; empty if uniform.

    Attributes:
        rate: Loss rate of each shape, as a multiple of that of the screw's own diameter and bore, (e,).
        row: Rows that read the shapes, (e, n_x).
        into: Rows that change the states, (e, n_x).
    """

    rate: FloatArray
    row: FloatArray
    into: FloatArray


class Coupling(NamedTuple):
    """The couplings of a plant with n_x states, m sources and p known inputs, as plain arrays.

    In another basis, x = V ξ, `metric`, `non_modal_rows` and `non_modal_into` describe the screw's modes. In
    the original basis they are empty, and the first `modes` states are the modes.

    Attributes:
        active: 0 without couplings.
        ambient: Column of the ambient among the known inputs.
        modes: Number of the screw's modes.
        conductance_W_m: kA, from an input column B_j to the row of the mean temperature under source j.
        place_gain: Factor that scales a source's column to 1 W into the screw, (m,).
        under_C: Temperature of the dropped modes under each source, by the states, (m, n_x).
        under_F: The same by the known inputs, (m, p).
        uniform: The state of a screw at 1 °C with bodies at 0 °C, (n_x,).
        mean: Row of the screw's mean temperature, (n_x,).
        square: From the sum of the modes' squares to the mean square of the temperature.
        radiation: ε σ P/(ρ c A), 1/(s K³), of temperatures above −`zero_degC_K` °C.
        rising: Loss of a film that grows with the fourth root of its rise, at 1 K, 1/(s K^(1/4)).
        zero_degC_K: 0 °C in K.
        metric: Quadratic form of the sum of the modes' squares in ξ, (n_x, n_x).
        non_modal_rows: Rows that read the states beside the modes, (r, n_x).
        non_modal_into: Rows that change these, (r, n_x).
        links: Links to moving nuts.
        spreads: Exchange under sweeping nuts.
        fades: Friction that fades.
        uneven: Loss of a screw with sections.
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
    non_modal_rows: FloatArray
    non_modal_into: FloatArray
    links: Links
    spreads: Spreads
    fades: Fades
    uneven: Uneven


def no_coupling(n_x: int, sources: int, inputs: int, modes: int = 0) -> Coupling:
    """Return the coupling of an uncoupled plant."""
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
        non_modal_rows=np.zeros((0, n_x)),
        non_modal_into=np.zeros((0, n_x)),
        links=Links(no_index, no_rate, np.zeros((0, n_x)), np.zeros((0, n_x))),
        spreads=Spreads(
            np.zeros(sources + 1, np.int64), no_rate, no_shape, no_shape, np.zeros(sources), np.zeros(sources)
        ),
        fades=Fades(np.zeros(sources), np.zeros(sources)),
        uneven=Uneven(no_rate, np.zeros((0, n_x)), np.zeros((0, n_x))),
    )
