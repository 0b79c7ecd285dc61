"""What the kernels of fixed gains take besides a plant: gains, columns, and what is allowed for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.estimators.packing import IntArray, PlantArrays, Work, padded_width
from observer.frames import FloatArray


class GainTable(NamedTuple):
    """Gains known so far: `key` (G,) = rung 2^s + sensors as bits, `K` (G, n, s), zero columns for absent
    sensors.

    With `steady` (G,): the covariance `P` (G, n, n) after a correction, the innovations' variances `S` (G,
    s), `heat_sigma` (G, m_e), `field_sigma` (G, R-s) that go with it.
    """

    key: NDArray[np.int64]
    K: FloatArray
    steady: NDArray[np.bool_]
    P: FloatArray
    S: FloatArray
    heat_sigma: FloatArray
    field_sigma: FloatArray


class Rungs(NamedTuple):
    """For each step length of a table: which rung's gains it uses, and whether that rung has exactly its
    length.
    """

    rung: NDArray[np.int64]
    exact: NDArray[np.bool_]


class Columns(NamedTuple):
    """The steady step, laid out in padded rows: W ≥ n and W_s ≥ s.

    `decay`, `x`, `x_pred` (W,); `inputs` (c, W) and `weights` (c,), what drives the states and how much at a
    step: laws, known inputs at its start and at its end, heats; `gain` (s, W); the sensors' rows as columns,
    `sensors` (n_x, W_s), `sensors_F` (p, W_s); `expected`, `nu` (W_s,), `nu_sigma` (s,); `z_end` (p,) the
    known inputs at the end of the step; the largest squares of innovations, `gate_K2` (s,), and of laws'
    jumps, `jump_W2` (m_e,); and which sensors are `present` (s,).
    """

    decay: FloatArray
    x: FloatArray
    x_pred: FloatArray
    inputs: FloatArray
    weights: FloatArray
    gain: FloatArray
    sensors: FloatArray
    sensors_F: FloatArray
    expected: FloatArray
    nu: FloatArray
    nu_sigma: FloatArray
    z_end: FloatArray
    gate_K2: FloatArray
    jump_W2: FloatArray
    present: NDArray[np.uint8]


def columns(arrays: PlantArrays) -> Columns:
    """Allocate the layout of a plant's steady step."""
    (m, n_x), p, m_e, s = arrays.B.shape, len(arrays.E), len(arrays.source), len(arrays.R_K2)
    width, of_sensors, inputs = padded_width(n_x + m_e), padded_width(s), m + 2 * p + m_e
    shapes = [(width,), (width,), (width,), (inputs, width), (inputs,), (s, width)]
    shapes += [(n_x, of_sensors), (p, of_sensors), (of_sensors,), (of_sensors,), (s,), (p,), (s,), (m_e,)]
    return Columns._make([*map(np.zeros, shapes), np.zeros(s, np.uint8)])


class Allowed(NamedTuple):
    """What is allowed for: nothing where the plant has no states that are learnt.

    Of the state `around` (n_x + m_e + 2 s,) and `S` (n, L). Scratch: `work`, `nothing` (n + L,) is zero,
    `nu` (s, L) what the parameters do to the innovations, `variance` (s,) the innovations' with it, `e` (s,),
    and `taken` (1,), whether S is over the step at hand already.
    """

    plant: PlantArrays
    work: Work
    around: FloatArray
    S: FloatArray
    nothing: FloatArray
    nu: FloatArray
    variance: FloatArray
    e: FloatArray
    taken: IntArray
