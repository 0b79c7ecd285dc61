"""Open-loop prediction: the plant driven by its heat laws alone, without corrections by measurements."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.frames import FloatArray, Inputs, contiguous
from observer.kernels import march, record
from observer.kernels.layout import pad_rows, padded_width
from observer.model.coupling import CoupledColumns, Coupling, link_scratch, state_column
from observer.model.plant import Plant

_CHUNK = 512
"""Steps per call of the kernel: their data fit into the cache."""
_REGISTER = 8
"""States are padded with zeros to whole vector registers: the step takes half the time for it."""


class AdvancePlant(NamedTuple):
    """The plant's data for the open loop, with states padded to W (see `kernels.advance`).

    Attributes:
        modes: Number of modes.
        B: Input columns of the heats as rows, (m, W).
        E: Input columns of those known inputs that act on states, as rows, (p, W).
        source: Sources of estimated heats; empty, because no heat is a state here.
        moving: Sources of the moving columns, (M,).
        coupling: Couplings of the states.
    """

    modes: int
    B: FloatArray
    E: FloatArray
    source: NDArray[np.int64]
    moving: NDArray[np.int64]
    coupling: Coupling


class AdvanceTable(NamedTuple):
    """The current step, as a table of length one; no heat is a state here.

    Attributes:
        decay: Decay factors of the states, (1, W).
        hold: Response to a constant input, s, (1, W).
        ramp: Response to an input that rises from 0 to 1, s, (1, W).
        heat_decay: Empty, (1, 0).
        couple: Empty, (1, 0, W).
    """

    decay: FloatArray
    hold: FloatArray
    ramp: FloatArray
    heat_decay: FloatArray
    couple: FloatArray

    @classmethod
    def empty(cls, width: int) -> AdvanceTable:
        """Return memory for a step of `width` states."""
        decay, hold, ramp = np.zeros((3, 1, width))
        return cls(decay, hold, ramp, np.zeros((1, 0)), np.zeros((1, 0, width)))


class AdvanceWork(NamedTuple):
    """Scratch, as in `kernels.advance`.

    Attributes:
        B: Input columns with moving nuts in place, (m, W).
        C: Empty, because the march computes no outputs.
        law: Heats by law, W, (m,).
        driven: Rate of change by heats and known inputs, (W,).
        before: States at the start of each half of a coupling, (2, n_x).
        link: Scratch of couplings.
        state: The state as a column of the couplings.
        sweep: Shapes of the nuts' motion in each step, (K, M, e, n_x).
    """

    B: FloatArray
    C: FloatArray
    law: FloatArray
    driven: FloatArray
    before: FloatArray
    link: FloatArray
    state: CoupledColumns
    sweep: FloatArray

    @classmethod
    def of(cls, p: AdvancePlant, n_x: int, sweep: FloatArray) -> AdvanceWork:
        """Return scratch for a plant.

        Args:
            p: The plant's arrays.
            n_x: Number of its states without padding.
            sweep: Shapes of the nuts' motion, (K, M, e, n_x), with M = 0 if unknown.
        """
        (m, width), state, link = p.B.shape, state_column(p.coupling), link_scratch(p.coupling)
        B, C = p.B.copy(), np.zeros((0, width))
        return cls(B, C, np.zeros(m), np.zeros(width), np.zeros((2, n_x)), link, state, sweep)


class OpenLoopMarch(NamedTuple):
    """The argument of `kernels.march`.

    Attributes:
        plant: The plant's arrays.
        table: The current step, overwritten as lengths change.
        inputs: Inputs of all steps, packed.
        work: Scratch.
        decay_1_s: Decay rates of the states, 1/s, (n_x,).
    """

    plant: AdvancePlant
    table: AdvanceTable
    inputs: Inputs
    work: AdvanceWork
    decay_1_s: FloatArray


def start(plant: Plant, temperature_degC: float, law_W: FloatArray) -> FloatArray:
    """Return the state of a screw at one temperature, its lags settled at the heats, (n_x,).

    Args:
        plant: The model.
        temperature_degC: The temperature, °C.
        law_W: Heats of all sources, W, (m,).
    """
    return plant.uniform * temperature_degC + law_W @ plant.lags


def start_from_sensors(
    plant: Plant, y_degC: FloatArray, noise_R_K2: FloatArray, law_W: FloatArray, z: FloatArray
) -> FloatArray:
    """Return the most probable state of a screw from the readings of its sensors, its lags settled at the
    heats.

        x = x̄ + P Cᵀ (C P Cᵀ + R)⁻¹ (y − C x̄ − F z)

    x̄ is the screw at the sensors' mean, and P the prior of a smooth unknown field. P is widened if the
    sensors differ by more than the prior expects (Rasmussen & Williams 2006, eq. 2.25). Displacements, whose
    zero is still unknown, are not used.

    Args:
        plant: The model.
        y_degC: Readings, °C, (s,), NaN for a sensor without a value.
        noise_R_K2: Variances of the readings, K², (s,).
        law_W: Heats of all sources, W, (m,).
        z: Known inputs, (p,).

    Raises:
        ValueError: If no thermocouple has a value.
    """
    sensors = np.flatnonzero(np.isfinite(y_degC) & plant.thermal)
    if len(sensors) == 0:
        raise ValueError("no thermocouple has a value to start from; check the channels of [[sensor]]")
    C, y = plant.rows.C[sensors], y_degC[sensors]
    x = start(plant, float(np.mean(y)), law_W)
    PC = plant.smooth_P @ C.T
    prior_S = C @ PC
    widen = max(1.0, float(np.ptp(y) ** 2 / np.max(np.diag(prior_S))))
    gain = np.linalg.solve(widen * prior_S + np.diag(noise_R_K2[sensors]), widen * PC.T).T
    return np.asarray(x + gain @ (y - C @ x - plant.rows.F[sensors] @ z))


def simulate(
    plant: Plant, state: FloatArray, inputs: Inputs, sweep: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the state after K steps and the output rows at their ends.

    Exact for heats constant and known inputs linear over each step. Time-varying couplings are of second
    order in the step (see `coupling`).

    Args:
        plant: The model.
        state: State before the first step, (n_x,).
        inputs: K steps; readings are not used.
        sweep: Shapes of the screw for each step and moving source, (K, M, e, N). Their squares add up to the
            covariance of the source's input column over the step. None if unknown.

    Returns:
        The state, (n_x,), and the rows in °C and µm, (K, R).
    """
    rows, x = np.empty((len(inputs), len(plant.rows.C))), state
    output_matrix = np.vstack([_lagless(plant), plant.rows.F.T])
    for part, states in _marched(plant, state, inputs, sweep):
        np.matmul(states, output_matrix, out=rows[part])
        if plant.moving:
            rows[part] += _of_lags(plant, inputs, part, states)
        x = states[-1, : len(x)]
    return x.copy(), rows


class Means(NamedTuple):
    """Output rows of K steps.

    The lag of a source enters as constant over each step.

    Attributes:
        ends: Rows at the ends of the steps, (K, R).
        means: Means over each step, (K, R).
        way: Change over each step, (K, R).
        passed_W: Mean heat from bodies to the screw at each moving source, (K, M).
    """

    ends: FloatArray
    means: FloatArray
    way: FloatArray
    passed_W: FloatArray


def simulate_means(plant: Plant, state: FloatArray, inputs: Inputs, sweep: FloatArray | None = None) -> Means:
    """Return the output rows of K steps as means too, in °C and µm.

    A mode of the rate λ has on average completed the share w of its change over a step. With u = λ dt, w =
    1/(1 - e⁻ᵘ) - 1/u: half for a slow mode, nearly all for a fast one. Arguments as in `simulate`.
    """
    rows = np.empty((3, len(inputs), len(plant.rows.C)))
    out = Means(rows[0], rows[1], rows[2], passed_W=np.empty((len(inputs), len(plant.moving))))
    length_s, length_index = np.unique(inputs.dt_s, return_inverse=True)
    left, x = (1.0 - _share_of_way(plant.decay_1_s * length_s[:, None]))[length_index], state
    lagless, F = _lagless(plant), plant.rows.F
    for part, states in _marched(plant, state, inputs, sweep):
        ends, z_start, z_end = states[:, : len(x)], inputs.z_start[part], inputs.z_end[part]
        way = ends - np.vstack([x, ends[:-1]])
        mean = ends - left[part] * way
        out.ends[part] = ends @ lagless + _of_lags(plant, inputs, part, ends) + z_end @ F.T
        out.means[part] = mean @ lagless + _of_lags(plant, inputs, part, mean) + 0.5 * (z_start + z_end) @ F.T
        out.way[part] = way @ lagless + (z_end - z_start) @ F.T
        for i, source in enumerate(plant.moving):
            out.passed_W[part, i] = _passed_W(plant, source.index, inputs.moving_B[part, i], mean)
        x = ends[-1].copy()
    return out


def _passed_W(plant: Plant, source: int, B: FloatArray, states: FloatArray) -> FloatArray:
    """The heat (k,) from nodes to the screw at a source in some steps, by its columns B (k, n_x)."""
    links, passed_W = np.flatnonzero(plant.coupling.links.source == source), np.zeros(len(states))
    if not len(links):
        return passed_W
    c = plant.coupling
    reading = B @ c.metric.T if len(c.metric) else B[:, : c.modes]
    under_degC = np.einsum("ka,ka->k", reading, states[:, : reading.shape[1]])
    under_degC *= c.conductance_W_m * c.place_gain[source]
    for i in links.tolist():
        passed_W += c.links.conductance_W_K[i] * (states @ c.links.C[i] - under_degC)
    return passed_W


def _marched(
    plant: Plant, state: FloatArray, inputs: Inputs, sweep: FloatArray | None
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield some steps at a time, and the states and known inputs (k, n_x + p) at their ends.

    The next iteration overwrites these.
    """
    K, p = len(inputs), _plant_arrays(plant)
    sweep = np.zeros((K, 0, 0, 0)) if sweep is None else plant.of_screw(sweep)
    x = pad_rows(state, p.B.shape[1])
    u, table = inputs.packed(), AdvanceTable.empty(p.B.shape[1])
    states = np.empty((min(K, _CHUNK), len(state) + u.z_end.shape[1]))
    work, decay_1_s = AdvanceWork.of(p, len(state), sweep), contiguous(plant.decay_1_s)
    loop = record(OpenLoopMarch(p, table, u, work, decay_1_s))
    for begin in range(0, K, _CHUNK):
        ends = states[: K - begin]
        march(loop, x, ends, begin)
        yield slice(begin, begin + _CHUNK), ends


def _lagless(plant: Plant) -> FloatArray:
    """The output rows of the states, (n_x, R), without the lags of moving sources."""
    C = plant.rows.C.T.copy()
    for source in plant.moving:
        C[plant.modes + source.index] = 0.0
    return C


def _of_lags(plant: Plant, inputs: Inputs, part: slice, states: FloatArray) -> FloatArray:
    """The output rows (k, R) of the lags of moving sources in some steps, by their states (k, …)."""
    rows = np.zeros((len(states), len(plant.rows.C)))
    for i, source in enumerate(plant.moving):
        rows += states[:, plant.modes + source.index, None] * inputs.moving_C[part, i]
    return rows


def _share_of_way(u: FloatArray) -> FloatArray:
    """Return 1/(1 - e⁻ᵘ) - 1/u, a step's `ramp` over its `hold`; for small u a series."""
    small = u < 1e-2
    safe = np.where(small, 1.0, u)
    return np.where(small, 0.5 + u / 12.0, -1.0 / np.expm1(-safe) - 1.0 / safe)


def _plant_arrays(plant: Plant) -> AdvancePlant:
    width = padded_width(len(plant.decay_1_s), _REGISTER)
    acting = np.flatnonzero(plant.E.any(axis=0))
    acts = slice(0, acting.max(initial=-1) + 1)  # what comes later is for the outputs alone
    return AdvancePlant(
        plant.modes,
        pad_rows(plant.B.T, width),
        pad_rows(plant.E[:, acts].T, width),
        np.zeros(0, dtype=np.int64),
        np.array([s.index for s in plant.moving], dtype=np.int64),
        plant.coupling,
    )
