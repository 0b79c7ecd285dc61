"""The effect of a configuration's tolerances on the sensors over a log, and their estimate from the log.

A tolerance changes the sensors by d_i θ_i, with θ_i of variance 1 and d_i (K, s) simulated along known heats.
The smoother is linear in the readings, so it is run once for each d_i. The other matrices are small: Σ is the
covariance of all readings without tolerances, D has the d_i as columns, and M is the smoother's response to
them.

    S = (I + Dᵀ Σ⁻¹ D)⁻¹,   θ = S Dᵀ Σ⁻¹ (y − ŷ),   q = q̂(y − D θ),   P = P̂ + M S Mᵀ.

Considered parameters (Schmidt 1966) keep θ = 0 and the identity in their block of S. If they were estimated
with a model that is wrong by hundredths of a kelvin, the results for sensor positions, ends and material
would be wrong and overconfident. The smoothed residual is R Σ⁻¹ (y − ŷ). Sources: Rosenberg (1973) for
regression beside a filter; de Jong (1991), sections 3 and 5, for the smoother and its covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.config.estimator import EstimatorSettings
from observer.config.machine import Config
from observer.estimators import packing
from observer.estimators.steps import StepCache, chunks
from observer.fit.linear import LinearFit
from observer.frames import BoolArray, FloatArray, Inputs
from observer.history.smoother import smooth_changes
from observer.kernels import record, run_tolerances
from observer.model.build import build_plant
from observer.model.learning import Nuisance, of_parameters
from observer.model.plant import Plant
from observer.model.simulate import start_from_sensors

AVERAGED_S = 300.0
"""Time over which the heats are averaged along which changes are simulated. The smoother's response to a
reading's noise lasts a minute or two; a screw warms in half an hour or more.
"""


class Changes(NamedTuple):
    """The change of the sensors with one standard deviation of each of c tolerances.

    Attributes:
        sensor_K: Changes of the readings, K, (K, s, c).
        learnt: Whether each tolerance is learnt; the others are considered, (c,).
    """

    sensor_K: FloatArray
    learnt: BoolArray


def changes_within(config: Config, blocks: Sequence[Inputs], heat_W: FloatArray) -> Changes:
    """Return the effect of the plant's tolerances on the sensors over a log.

    It is zero initially, when the sensors give the field. Learnt are the tolerances in `[estimator] learn`;
    the common tolerance of the sensors' gains is only considered.

    Args:
        config: The machine with its tolerances.
        blocks: Consecutive blocks of inputs, K steps in total.
        heat_W: Estimated heats, W, (K, m_e), NaN where unknown, along which changes are simulated. The effect
            of a film depends on the temperature of the screw.

    Returns:
        The changes, with c = 0 if no heat is known.
    """
    plant, learnt = _roughly_known(config)
    known_rows = np.flatnonzero(np.isfinite(heat_W).any(axis=1))
    gain, L, s = config.tolerance.gain, len(learnt), plant.rows.sensors
    common = gain * np.array([sensor.shows_tolerance is None for sensor in config.sensor])
    D = np.zeros((len(heat_W), s, L + (s if gain > 0.0 else 0)))
    if not (len(known_rows) and D.size):
        return Changes(D[:, :, :0], np.zeros(0, dtype=np.bool_))
    along, row, start, sensors = _Along(plant), 0, int(known_rows[0]), np.arange(s)
    for block in blocks:
        rows = slice(max(row, start), row + len(block))
        u = block.sensors_only(s).part(rows.start - row)
        row += len(block)
        if len(u):
            law_W = u.law_W.copy()
            law_W[:, plant.estimated] = heat_W[rows]
            expected_degC = along(u._replace(law_W=law_W), D[rows])
            if gain > 0.0:
                air_degC = u.z_end[:, plant.known.ambient, None]
                D[rows, sensors, L + sensors] = np.nan_to_num(common * (air_degC - expected_degC))
    return Changes(D, np.concatenate([learnt, np.zeros(D.shape[2] - L, dtype=np.bool_)]))


def averaged(blocks: Sequence[Inputs], estimated: BoolArray, heat_W: FloatArray) -> FloatArray:
    """Return estimated heats with their deviation from the laws averaged over `AVERAGED_S`, W, (K, m_e).

    Estimated heats follow the noise of the readings. Changes simulated along them would correlate with that
    noise, and the estimate of the tolerances would be biased.

    Args:
        blocks: Consecutive blocks of inputs, K steps in total.
        estimated: True for estimated heats, (m,).
        heat_W: Estimated heats, W, (K, m_e). Rows with a NaN stay NaN.
    """
    time_s = np.concatenate([block.time_s for block in blocks])
    law_W = np.concatenate([block.law_W for block in blocks])[:, estimated]
    finite = np.isfinite(heat_W + law_W).all(axis=1)
    departure_W = np.where(finite[:, None], heat_W - law_W, 0.0)
    total_W = np.cumsum(np.vstack([np.zeros(departure_W.shape[1]), departure_W]), axis=0)
    count = np.cumsum(np.concatenate([[0], finite]))
    first = np.searchsorted(time_s, time_s - 0.5 * AVERAGED_S)
    end = np.searchsorted(time_s, time_s + 0.5 * AVERAGED_S, side="right")
    rows = np.maximum(count[end] - count[first], 1)
    mean_W = (total_W[end] - total_W[first]) / rows[:, None]
    return np.where(finite[:, None], law_W + mean_W, np.nan)


def _roughly_known(config: Config) -> tuple[Plant, BoolArray]:
    """Return the plant with all tolerances except those of the estimated heats, and which of them are
    learnt.
    """
    by_kalman = config.estimator.model_copy(update={"kind": "kalman", "engine": "compiled"})
    lean = config.model_copy(update={"estimator": by_kalman})
    plant = build_plant(lean, nut_places=2, learns=True).sensors_only()  # the inputs hold the nut's columns
    if plant.learning is None:
        return plant, np.zeros(0, dtype=np.bool_)
    fades, parameters = plant.coupling.fades, plant.learning.arrays
    sought = fades._replace(per_K=np.where(plant.estimated, 0.0, fades.per_K))
    selected = np.flatnonzero(parameters.kind != Nuisance.LAW)
    learning = replace(plant.learning, arrays=of_parameters(parameters, selected))
    plant = replace(plant, coupling=plant.coupling._replace(fades=sought), learning=learning)
    return plant, np.isin(selected, parameters.considered, invert=True)


class Sensitivities(NamedTuple):
    """Sensitivities of an open loop to the machine's tolerances, for the kernel.

    Attributes:
        plant: The plant.
        work: Scratch memory.
        around: State that follows the log's heats, the linearisation point, (n_x + m_e + 2 s,).
        S: ∂x/∂θ σ_θ, (n_x + m_e, t).
        nothing: Zeros, (n,).
    """

    plant: packing.PlantArrays
    work: packing.Work
    around: FloatArray
    S: FloatArray
    nothing: FloatArray


class _Along:
    """A simulation over a log: the field, and its change with one standard deviation of each parameter."""

    def __init__(self, plant: Plant) -> None:
        self._plant, self._steps, self._begins = plant, StepCache(plant), True
        arrays = packing.pack_plant(plant)
        n, s, L = packing.states_of(plant), plant.rows.sensors, len(arrays.learn.kind)
        of_machine = max(arrays.learn.machine, 1)
        self._x = np.zeros(n)
        linearised, S = np.zeros(n - L + 2 * s), np.zeros((n - L, of_machine))
        sensitivities = Sensitivities(arrays, packing.scratch(arrays), linearised, S, np.zeros(n))
        self._sensitivities, self._plant_record = record(sensitivities), record(arrays)

    def __call__(self, u: Inputs, D: FloatArray) -> FloatArray:
        """Fill D (K, s, …) for the steps of a block, and return the expected readings (K, s) in °C.

        The first step of all starts from the sensors. The expected readings are those without any changed
        parameter.
        """
        if self._begins:
            y_degC = np.where(u.usable[0], u.y_degC[0], np.nan)
            field = start_from_sensors(self._plant, y_degC, self._plant.noise_R_K2, u.law_W[0], u.z_end[0])
            self._x[: len(field)] = field
        expected_degC = np.full(u.y_degC.shape, np.nan)
        for part, _, table, chunk, step in chunks(self._steps, u):
            batch = record(packing.Batch(self._plant_record, table, chunk, step))
            run_tolerances(self._sensitivities, batch, self._x, self._begins, D[part], expected_degC[part])
            self._begins = False
        return expected_degC


class ToleranceEstimate(NamedTuple):
    """The most probable effect of tolerances on sensors and heats.

    Attributes:
        sensor_K: Effect of the learnt tolerances, K, (K, s).
        whole_K: Effect of all tolerances, the considered ones too, K, (K, s).
        largest: Largest tolerance, in σ.
        variance_W2: Variance of the heats due to all tolerances, W², (K, m_e).
    """

    sensor_K: FloatArray
    whole_K: FloatArray
    largest: float
    variance_W2: FloatArray


def most_probable(
    plant: Plant, settings: EstimatorSettings, blocks: Sequence[Inputs], changes: Changes
) -> ToleranceEstimate:
    """Return the estimate of the tolerances from the accepted readings of a log.

    Args:
        plant: The model without uncertain parameters.
        settings: The table `[estimator]`, of which the gate is read.
        blocks: Consecutive blocks of inputs, K steps in total.
        changes: Changes by at least one tolerance.
    """
    information, M = smooth_changes(plant, settings, blocks, changes.sensor_K)
    linear = LinearFit.of_information(np.eye(len(information)) + information[:, 1:], information[:, 0])
    S, theta = linear.covariance, linear.step
    considered = np.ix_(~changes.learnt, ~changes.learnt)
    S[considered] = np.eye(len(information))[considered]
    variance_W2 = np.maximum(np.sum(M @ S * M, axis=2), 0.0)
    learnt_K = changes.sensor_K @ np.where(changes.learnt, theta, 0.0)
    return ToleranceEstimate(learnt_K, changes.sensor_K @ theta, float(np.abs(theta).max()), variance_W2)


def without_changes(blocks: Sequence[Inputs], change_K: FloatArray) -> list[Inputs]:
    """Return the blocks with changes of the sensors, K, (K, s), subtracted from the readings."""
    out, begin = [], 0
    for block in blocks:
        out.append(block._replace(y_degC=block.y_degC - change_K[begin : begin + len(block)]))
        begin += len(block)
    return out
