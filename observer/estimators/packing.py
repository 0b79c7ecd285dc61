"""Records for the kernels: a plant, steps and inputs as contiguous arrays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.estimators.protocol import SCREENING_VERDICT, SENSOR_GUARD, EstimatorState
from observer.frames import PARTS, BoolArray, EstimateBlock, FloatArray, QualityArray, contiguous
from observer.kernels import layout
from observer.kernels.layout import Records, packed, pad_rows
from observer.model.coupling import CoupledColumns, Coupling, half_step_columns, link_scratch
from observer.model.learning import LearningArrays
from observer.model.plant import Plant
from observer.model.rod.supports import fold, tension

IntArray = NDArray[np.int64]
# Rows of a covariance are padded with zeros to whole vector registers: a step is twice as fast for it. Rows
# of 512 bytes would all share few places of the processor's cache: then it is half a register less, or more.
_REGISTER, _CROWDED = 16, 64
_SENSORS_AT_ONCE = 4  # sensors that the kernels take at a time


class Batch(NamedTuple):
    """K steps as records of the kernels.

    Attributes:
        plant: Record of `PlantArrays`.
        table: Record of `steps.StepTable`; None until the first step's length is known.
        inputs: Record of `Inputs`, packed.
        step: Row of each step's length in the table, (K,).
        gate_sigma: Distance in σ beyond which a reading is rejected.
    """

    plant: Any
    table: Any
    inputs: Any
    step: IntArray
    gate_sigma: float = np.inf


class PlantArrays(NamedTuple):
    """A plant for the kernels; input columns are stored as rows, which the inner loops walk.

    | Array | Meaning |
    |---|---|
    | `B` (m, n_x), `E` (p, n_x) | columns of sources and of known inputs |
    | `C` (s, n_x), `F` (s, p) | rows of the sensors |
    | `rows` (n_x, W), `rows_F` (p, W) | reported rows, as padded columns |
    | `R_K2` (s,), `uniform` (n_x,) | variance of a reading; states of a screw at 1 °C |
    | `lags` (m, n_x) | each source's lag at 1 W |
    | `prior_P` (n_x, n_x), `initial_W2`, `jump_uncertainty` (m_e,) | uncertainty at the start and of jumps |
    | `source` (m_e,) | source of each estimated heat |
    | `moving` (M,), `moving_heat` (M,) | source of each moving column; its estimated heat, or -1 |
    | `thermal` (s,) | true for thermocouples |
    | `VT`, `inverse_T` (n_x, n_x) | transposed matrices of `learn` |
    """

    modes: int
    B: FloatArray
    E: FloatArray
    C: FloatArray
    F: FloatArray
    rows: FloatArray
    rows_F: FloatArray
    R_K2: FloatArray
    uniform: FloatArray
    lags: FloatArray
    prior_P: FloatArray
    initial_W2: FloatArray
    jump_uncertainty: FloatArray
    source: IntArray
    moving: IntArray
    moving_heat: IntArray
    thermal: BoolArray
    coupling: Coupling
    learn: LearningArrays
    VT: FloatArray
    inverse_T: FloatArray


class Running(NamedTuple):
    """The state during a run, changed in place; names and shapes are those of `EstimatorState`.

    Attributes:
        x: Estimate, (n,).
        P: Covariance, (n, padded width); the columns beyond n are zero.
        suspect: Steps for which a sensor has been rejected in a row, (s,).
        refused_s: Time for which it has been rejected, s, (s,).
        opened_K: Its innovation when the covariance was last opened for it, K, (s,).
        lost_s: Time for which the position of a nut has been unknown, s, (1,).
        flags: Started, silent, limited and gain_sensors, (4,). If `limited` is set, bounds have limits, which
            decide whether a missing sensor is needed.
        around: Linearisation point of the parameters.
        guard: Memory of the screening by sensor, (s,).
        verdict: Memory of the screening of all sensors, (1,).
    """

    x: FloatArray
    P: FloatArray
    suspect: FloatArray
    refused_s: FloatArray
    opened_K: FloatArray
    lost_s: FloatArray
    flags: IntArray
    around: FloatArray
    guard: Records
    verdict: Records


class Work(NamedTuple):
    """Scratch memory of the kernels, with the arrays of one step.

    | Array | Meaning |
    |---|---|
    | `B`, `C`, `rows` | columns with moving nuts in place; `C` covers all states if parameters are learnt |
    | `law` (m,) | heats by law at the current temperatures |
    | `driven` (n_x,) | rate of change by heats and known inputs |
    | `before` (2, n_x) | states at the start of each half of a coupling |
    | `link` (4, w) | scratch of couplings |
    | `half_step`, `half_step_T` | half a step of the couplings as a matrix (see `advance.form_half`) |
    | `made_of` | the inputs that `half_step` was made of |
    | `plain`, `plain_B` | a state and columns in the basis of the parameters |
    | `CT` (n_x, S) | rows of the sensors as padded columns, for the plant's states |
    | `S` (s, S) | covariances of the innovations without R, each row from its sensor on |
    | `read` (S,) | readings |
    """

    B: FloatArray
    C: FloatArray
    rows: FloatArray
    value: FloatArray
    shared: FloatArray
    law: FloatArray
    driven: FloatArray
    shift: FloatArray
    was: FloatArray
    before: FloatArray
    link: FloatArray
    half_step: CoupledColumns
    half_step_T: FloatArray
    made_of: FloatArray
    G: FloatArray
    H: FloatArray
    M: FloatArray
    L: FloatArray
    W: FloatArray
    e: FloatArray
    order: IntArray
    K: FloatArray
    row: FloatArray
    half: FloatArray
    g: FloatArray
    nu: FloatArray
    S_nu: FloatArray
    usable: NDArray[np.bool_]
    accepted: NDArray[np.bool_]
    suspect: FloatArray
    A: FloatArray
    before_around: FloatArray
    plain: FloatArray
    plain_B: FloatArray
    saved: FloatArray
    CT: FloatArray
    S: FloatArray
    read: FloatArray


class Results(NamedTuple):
    """Where the kernels write K steps; bounds are NaN until a bank writes them.

    With m_e heats, l parameters, s sensors, and r padded rows. Rows are those of the field, °C, then those of
    the error, µm.

    Attributes:
        heat: Heats, W, (K, m_e).
        heat_sigma: Their σ, W, (K, m_e).
        field: Rows of field and error, (K, r).
        field_sigma: Their σ, K or µm, (K, r).
        innovation: Innovations, K or µm, (K, s), NaN without a reading.
        sensor_quality: Codes of `frames.Quality`, (K, s).
        quality: Codes of `frames.EstimateQuality`, (K,).
        part_quality: The same for heats, field and error, (K, 3).
        log_likelihood: Log-likelihood of the accepted readings, (K,).
        innovation_sigma: σ of the innovations, K or µm, (K, s).
        law: Heats by their laws, W, (K, m_e).
        learned: Parameters in their internal units, (K, l).
        learned_sigma: Their σ, (K, l).
        heat_bound: Bounds of the heats, W, (K, m_e).
        field_bound: Bounds of the rows, K or µm, (K, r).
    """

    heat: FloatArray
    heat_sigma: FloatArray
    field: FloatArray
    field_sigma: FloatArray
    innovation: FloatArray
    sensor_quality: QualityArray
    quality: QualityArray
    part_quality: QualityArray
    log_likelihood: FloatArray
    innovation_sigma: FloatArray
    law: FloatArray
    learned: FloatArray
    learned_sigma: FloatArray
    heat_bound: FloatArray
    field_bound: FloatArray


def padded_width(columns: int) -> int:
    """Return the width in memory of rows with `columns` numbers, which the inner loops run over.

    It is the next multiple of a vector register, except where rows would share few places of the cache.
    """
    width = layout.padded_width(columns, _REGISTER)
    if width % _CROWDED == 0:
        half = layout.padded_width(columns, _REGISTER // 2)
        return half + _REGISTER // 2 if half % _CROWDED == 0 else half
    return width


def pack_plant(plant: Plant) -> PlantArrays:
    """Bring a plant into the kernels' form.

    Arrays are contiguous copies. Input columns become rows, reported rows become padded columns, and
    `prior_P` is made symmetric. Source numbers refer to all sources of the plant, heat numbers to the
    estimated ones.
    """
    source = np.flatnonzero(plant.estimated)
    s = plant.rows.sensors
    reported = padded_width(len(plant.rows.C) - s)
    heat_of = {int(j): i for i, j in enumerate(source)}
    return PlantArrays(
        plant.modes,
        contiguous(plant.B.T),
        contiguous(plant.E.T),
        contiguous(plant.rows.C[:s]),
        contiguous(plant.rows.F[:s]),
        pad_rows(plant.rows.C[s:].T, reported),
        pad_rows(plant.rows.F[s:].T, reported),
        contiguous(plant.noise_R_K2),
        contiguous(plant.uniform),
        contiguous(plant.lags),
        contiguous(0.5 * (plant.prior_P + plant.prior_P.T)),
        contiguous(plant.initial_sigma_W**2),
        contiguous(plant.jump_uncertainty),
        contiguous(source, np.int64),
        contiguous([s.index for s in plant.moving], np.int64),
        contiguous([heat_of.get(s.index, -1) for s in plant.moving], np.int64),
        contiguous(plant.thermal, np.bool_),
        plant.coupling,
        packed(plant.parameters),
        contiguous(plant.parameters.V.T),
        contiguous(plant.parameters.inverse.T),
    )


def states_of(plant: Plant) -> int:
    """Return the number of an estimator's states: the plant's, the heats' and the learnt parameters."""
    return len(plant.decay_1_s) + int(plant.estimated.sum()) + plant.learnt


def initial_state(plant: Plant, *, screens: bool = False) -> EstimatorState:
    """Return the state before the first usable measurement: zeros, not started, time NaN.

    Args:
        plant: The model, which gives the sizes.
        screens: Whether readings are screened. Otherwise the memory of the sensors' screening is empty.
    """
    n, never = states_of(plant), np.zeros(plant.rows.sensors)
    linearisation_point = np.zeros(0)
    if plant.learning is not None:
        linearisation_point = np.zeros(n - plant.learnt + 2 * len(never))
    return EstimatorState(
        np.zeros(n), np.zeros((n, n)), False, never, never, never, float("nan"), around=linearisation_point,
        guard=np.zeros(len(never) if screens else 0, SENSOR_GUARD), verdict=np.zeros(1, SCREENING_VERDICT),
    )  # fmt: skip


def thaw(state: EstimatorState) -> Running:
    """Return a copy of a state as arrays that may change, with `P` padded for the kernels."""
    flags = np.array([int(state.started), state.silent, 0, state.gain_sensors], dtype=np.int64)
    return Running(
        np.array(state.x_hat, order="C"),
        pad_rows(state.P, padded_width(len(state.P))),
        np.array(state.suspect, dtype=float),
        np.array(state.refused_s, dtype=float),
        np.array(state.opened_K, dtype=float),
        np.array([state.lost_s]),
        flags,
        np.array(state.around),
        np.array(state.guard),
        np.array(state.verdict),
    )


def thaw_into(running: Running, state: EstimatorState) -> None:
    """Copy a state into arrays that may change, of the same sizes.

    The memory of the screening starts anew where the state has none or `running` has no place for it.
    """
    running.x[:] = state.x_hat
    running.P[:, : len(state.P)] = state.P
    running.suspect[:] = state.suspect
    running.refused_s[:] = state.refused_s
    running.opened_K[:] = state.opened_K
    running.lost_s[0] = state.lost_s
    running.flags[0], running.flags[1], running.flags[3] = state.started, state.silent, state.gain_sensors
    running.around[:] = state.around
    # An estimator that does not screen (a forecast's) goes on from the state of one that does.
    running.guard[:] = state.guard if state.guard.shape == running.guard.shape else np.zeros(1, SENSOR_GUARD)
    running.verdict[:] = state.verdict


def scratch(arrays: PlantArrays) -> Work:
    """Return the kernels' scratch for a plant; its contents mean nothing between two steps."""
    (m, n_x), m_e, s = arrays.B.shape, len(arrays.source), len(arrays.R_K2)
    n, learn = n_x + m_e + len(arrays.learn.kind), arrays.learn
    width, columns = padded_width(n), max(m_e + learn.machine, 1)
    sensors, shown = layout.padded_width(s, _SENSORS_AT_ONCE), arrays.rows.shape[1]
    half_step, half_step_T = half_step_columns(arrays.coupling)
    shapes: dict[str, tuple[int, ...]] = {
        "value": (shown,), "shared": (shown,), "law": (m,), "driven": (n_x,), "shift": (n_x,),
        "was": (n, width), "before": (2, n_x), "G": (columns, width), "H": (columns, width),
        "M": (m_e, width), "L": (s, s), "W": (s, width), "e": (s,), "K": (width,), "row": (width,),
        "half": (width,), "g": (s, width), "nu": (s,), "S_nu": (s,), "suspect": (s,), "A": (n, width),
        "before_around": (n_x + m_e,), "plain": (n_x + m_e,), "plain_B": (m, n_x),
        "saved": (len(learn.considered), len(learn.considered) + 1), "S": (s, sensors), "read": (sensors,),
    }  # fmt: skip
    return Work(
        B=arrays.B.copy(),
        C=pad_rows(arrays.C, n) if len(learn.kind) else arrays.C.copy(),
        rows=arrays.rows.copy(),
        order=np.zeros(s, dtype=np.int64),
        usable=np.zeros(s, dtype=np.bool_),
        accepted=np.zeros(s, dtype=np.bool_),
        CT=pad_rows(arrays.C.T, sensors),
        link=link_scratch(arrays.coupling),
        half_step=half_step,
        half_step_T=half_step_T,
        made_of=np.full(3 + len(arrays.moving) * n_x, np.nan),
        **{name: layout.aligned_zeros(shape) for name, shape in shapes.items()},
    )


def freeze(running: Running, time_s: float) -> EstimatorState:
    """Return a copy of the arrays as a state, valid at `time_s`, without the bytes of a bank."""
    return EstimatorState(
        running.x.copy(),
        running.P[:, : len(running.x)].copy(),
        bool(running.flags[0]),
        running.suspect.copy(),
        running.refused_s.copy(),
        running.opened_K.copy(),
        time_s,
        int(running.flags[1]),
        float(running.lost_s[0]),
        int(running.flags[3]),
        running.around.copy(),
        running.guard.copy(),
        running.verdict.copy(),
    )


def empty_results(plant: Plant, steps: int) -> Results:
    """Return results for this number of steps; bounds are NaN, all other numbers are undefined.

    The numbers are one piece of memory: the system provides a large one in large pages, at a fifth of the
    cost.
    """
    m_e, s = int(plant.estimated.sum()), plant.rows.sensors
    wide, learnt = len(plant.rows.C) - s, plant.learnt
    widths = [m_e, m_e, wide, wide, s, 1, s, m_e, learnt, learnt, m_e, wide]
    numbers, columns, at = np.empty(steps * sum(widths)), [], 0
    for width in widths:
        columns.append(numbers[at : at + steps * width].reshape(steps, width))
        at += steps * width
    columns[-1][...] = columns[-2][...] = np.nan
    heat, heat_sigma, field, field_sigma, innovation, likelihood, innovation_sigma, *others = columns
    return Results(
        heat,
        heat_sigma,
        field,
        field_sigma,
        innovation,
        np.empty((steps, s), dtype=np.int8),
        np.empty(steps, dtype=np.int8),
        np.empty((steps, len(PARTS)), dtype=np.int8),
        likelihood[:, 0],
        innovation_sigma,
        *others,
    )


def cut(results: Results, part: slice) -> Results:
    """Return the results of the steps in `part`, as views into the same memory."""
    return Results._make(array[part] for array in results)


def to_block(plant: Plant, time_s: FloatArray, results: Results) -> EstimateBlock:
    """Return the results as a block of estimates.

    Rows behind the field become error and axial force. Where a support has a clearance they are nonlinear in
    the rows (`supports.fold`).

    Args:
        plant: The model of the results.
        time_s: Time of each step, s, (K,).
        results: What the kernels have written; heats, field and qualities are shared, not copied.
    """
    g = plant.rows.grid
    error_um, error_sigma_um = fold(plant.rows.restraint, results.field[:, g:], results.field_sigma[:, g:])
    learned, learned_sigma = learned_of(plant, results)
    _, error_bound_um = fold(plant.rows.restraint, results.field[:, g:], results.field_bound[:, g:])
    force_N, force_sigma_N = tension(plant.rows.restraint, results.field[:, g:], results.field_sigma[:, g:])
    _, force_bound_N = tension(plant.rows.restraint, results.field[:, g:], results.field_bound[:, g:])
    return EstimateBlock(
        time_s=time_s,
        heat_W=results.heat,
        heat_sigma_W=results.heat_sigma,
        field_degC=results.field[:, :g],
        field_sigma_K=results.field_sigma[:, :g],
        error_um=error_um,
        error_sigma_um=error_sigma_um,
        innovation_K=results.innovation,
        sensor_quality=results.sensor_quality,
        quality=results.quality,
        part_quality=results.part_quality,
        innovation_sigma_K=results.innovation_sigma,
        law_W=results.law,
        learned=learned,
        learned_sigma=learned_sigma,
        heat_bound_W=results.heat_bound,
        field_bound_K=results.field_bound[:, :g],
        error_bound_um=error_bound_um,
        force_N=force_N,
        force_sigma_N=force_sigma_N,
        force_bound_N=force_bound_N,
    )


def learned_of(plant: Plant, results: Results) -> tuple[FloatArray, FloatArray]:
    """Return the learnt parameters in the units of their names.

    Args:
        plant: The model of the results.
        results: What the kernels have written.

    Returns:
        Values and σ, both (K, l). A parameter is its configured value plus its state times its unit. Without
        parameters both have no columns.
    """
    learned, sigma, learning = results.learned, results.learned_sigma, plant.learning
    if learning is None:
        return learned, sigma
    return learning.value + learning.unit * learned[:, learning.states], learning.unit * sigma[
        :, learning.states
    ]
