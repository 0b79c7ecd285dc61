"""What the kernels of fixed gains take besides a plant: gains, the steady step, and what is considered."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.estimators.packing import IntArray, PlantArrays, Work, scratch
from observer.frames import FloatArray
from observer.kernels.layout import aligned_zeros, padded_width

_REGISTER, _EIGHT = 4, 8
"""Numbers in a vector register, and rows that `vector.weigh` takes at a time."""
_RUN = 128
"""Steps in a run: few enough that they stay in the nearest cache."""


class GainTable(NamedTuple):
    """Gains known so far: `key` (G,) = bin 2^s + sensors as bits, `K` (G, n, s), zero columns for absent
    sensors.

    With `steady` (G,): the covariance `P` (G, n, n) after a correction and how far from it each variance
    counts as settled, `slack` (G, n); the innovations' variances `S` (G, s), `heat_sigma` (G, m_e) and
    `field_sigma` (G, R-s) that go with it.
    """

    key: NDArray[np.int64]
    K: FloatArray
    steady: NDArray[np.bool_]
    P: FloatArray
    slack: FloatArray
    S: FloatArray
    heat_sigma: FloatArray
    field_sigma: FloatArray


class StepBins(NamedTuple):
    """For each step length of a table: which bin's gains it uses, and whether that bin has exactly its
    length.
    """

    number: NDArray[np.int64]
    exact: NDArray[np.bool_]


class SteadyStep(NamedTuple):
    """The steady step, laid out in padded rows, and runs of R such steps (see `kernels.steady_state_step`).

    W ≥ n_x + p + m_e, W_s ≥ s, W_r ≥ the rows that are reported. `decay` (W,). What laws, known inputs at a
    step's start and at its end, and heats do to the states, `drives` (m + 2 p + m_e, W); the sensors' columns
    with the opposite sign, `sensors` (W, W_s); made of them `inputs` (c, W + W_s), what inputs do to states
    and innovations, `seen` (W, W_s), what states before a step do to innovations, and `push` (q, W), what
    heats and then innovations do to states; `rows` (W, W_r).

    Of each step of a run: `weights` (R, c) of the inputs, `states` (R+1, ·), `value` (R, W_r); of the one at
    hand `forced` (W + W_s,). `nu_sigma` (s,); the largest squares of innovations, `gate_K2` (s,), and of
    laws' jumps, `jump_W2` (m_e,); and which sensors are `present` (s,).
    """

    decay: FloatArray
    drives: FloatArray
    sensors: FloatArray
    inputs: FloatArray
    seen: FloatArray
    push: FloatArray
    rows: FloatArray
    weights: FloatArray
    forced: FloatArray
    states: FloatArray
    value: FloatArray
    nu_sigma: FloatArray
    gate_K2: FloatArray
    jump_W2: FloatArray
    present: NDArray[np.uint8]


def steady_step(arrays: PlantArrays, reported: int) -> SteadyStep:
    """Allocate the layout of a plant's steady step, of which so many rows are reported."""
    (m, n_x), p, m_e, s = arrays.B.shape, len(arrays.E), len(arrays.source), len(arrays.R_K2)
    own, shown = padded_width(s, _REGISTER), padded_width(reported, _REGISTER)
    width, c, pushing = (padded_width(count, _EIGHT) for count in (n_x + p + m_e, m + 2 * p, m_e + own))
    rows = aligned_zeros((width, shown))
    rows[:n_x, :reported] = arrays.rows[:, :reported]
    rows[n_x : n_x + p, :reported] = arrays.rows_F[:, :reported]
    step = padded_width(width - m_e + pushing, _EIGHT)
    return SteadyStep(
        decay=aligned_zeros((width,)),
        drives=np.zeros((m + 2 * p + m_e, width)),
        sensors=aligned_zeros((width, own)),
        inputs=aligned_zeros((c, width + own)),
        seen=aligned_zeros((width, own)),
        push=aligned_zeros((pushing, width)),
        rows=rows,
        weights=aligned_zeros((_RUN, c)),
        forced=aligned_zeros((width + own,)),
        states=aligned_zeros((_RUN + 1, step)),
        value=aligned_zeros((_RUN, shown)),
        nu_sigma=np.zeros(s),
        gate_K2=np.zeros(s),
        jump_W2=np.zeros(m_e),
        present=np.zeros(s, np.uint8),
    )


class Considered(NamedTuple):
    """Parameters that are considered (Schmidt 1966): none where the plant has no states that are learnt.

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


def considered(plant: PlantArrays, around: FloatArray, S: FloatArray) -> Considered:
    """Allocate what is considered of a plant, on the memory of its state."""
    (n, L), s = S.shape, len(plant.R_K2)
    return Considered(
        plant, scratch(plant), around, S, np.zeros(n + L), np.zeros((s, L)), np.zeros(s), np.zeros(s),
        np.zeros(1, np.int64),
    )  # fmt: skip


class FixedGainWork(NamedTuple):
    """What a run with fixed gains works on: `optimal` and `at` (3,) as in `kernels.fixed_gain.observe`.

    `work`, `bins` and `gains` are records; the last two are set for each run.
    """

    optimal: bool
    at: IntArray
    steady: SteadyStep
    considered: Considered
    work: Any
    bins: Any = None
    gains: Any = None
