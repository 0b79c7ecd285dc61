"""The σ of an estimator over a shift, and the share of each tolerance in it, from covariances alone.

The filter of [x | δ | θ] (`model.learning`) runs on full matrices without measurements, because readings do
not change σ. Its steps (`along`) are longer than the estimator's. The noise is that of the mean of a step's
samples, which may be fewer than one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.estimators.design.along import along
from observer.estimators.design.gains import LuenbergerGain, Refusal, closed_loop, everything, is_stable
from observer.estimators.design.steady import gain_for
from observer.frames import FloatArray
from observer.kernels.codes import STILL
from observer.model.cycle import Stage
from observer.model.discretise import step_matrices
from observer.model.learning import WANDER_S, LearningArrays, Nuisance
from observer.model.plant import Plant
from observer.model.rod.supports import fold
from observer.tables.estimator import EstimatorSettings

FROM_S = 600.0
"""The means of σ exclude the first ten minutes, in which the heats settle."""
STEPS_PER_MOMENT = 3
"""Every third step enters the means."""
STEPS_S = (10.0, 20.0, 30.0)
"""Permitted steps: the first that needs at most `MOST_WORK`."""
MOST_WORK = 3e9
"""States cubed times steps times cases: a second or two."""
_TOO_MUCH_WORK = 4.0 * MOST_WORK


class Spread(NamedTuple):
    """Mean σ of v cases over a shift.

    Attributes:
        heat_W: σ of each estimated heat, W, (v, m_e).
        field_K: σ of the field, mean over its places, K, (v,).
        error_um: σ of the thermal error, mean over its places, µm, (v,). None without an expansion
            coefficient.
    """

    heat_W: FloatArray
    field_K: FloatArray
    error_um: FloatArray | None


class NotDefined(NamedTuple):
    """The reason why σ over a shift do not exist, as a clause for a message."""

    reason: str


class Moment(NamedTuple):
    """A moment of a shift that enters the means.

    Attributes:
        plant: The model with standing nuts in place.
        stage: The stage of the shift.
        x: States of the plant, (n_x,).
        H: Rows of the readings by phases of a sweep, (f, s, n).
        P: Covariances of v cases, mean over the step, (v, n, n).
    """

    plant: Plant
    stage: Stage
    x: FloatArray
    H: FloatArray
    P: FloatArray


def spread(
    plant: Plant, settings: EstimatorSettings, shift: Sequence[Stage], cases: FloatArray
) -> Spread | NotDefined:
    """Return the mean σ of an estimator over a shift.

    Args:
        plant: The model with its tolerances (`build_plant` with `learns`).
        settings: The table `[estimator]`. A constant or Luenberger gain is designed anew for the longer
            steps.
        shift: Stages of constant heats.
        cases: Share of each tolerance that remains, (v, L): 1 as configured, 0 exact.

    Returns:
        The σ. `NotDefined` if the settings have no gain, if the gain is unstable in these steps, or if the
        states are too many.
    """
    a = plant.parameters
    dt_s = _step_s(plant, sum(stage.duration_s for stage in shift), len(cases))
    if dt_s is None:
        return NotDefined("there are too many states")
    coarse = replace(plant, noise_R_K2=plant.noise_R_K2 * settings.period_s / dt_s)
    K = _fixed_gain(coarse, settings, dt_s)
    if isinstance(K, Refusal):
        return NotDefined("there is no gain")
    lost = NotDefined(f"the gains are too large for double precision: errors grow in steps of {dt_s:g} s")
    if K is not None and not is_stable(closed_loop(coarse, step_matrices(coarse, dt_s), K)):
        return lost
    with np.errstate(over="ignore", invalid="ignore"):  # what is lost to rounding shows in the result
        result = _over(coarse, a, shift, cases * a.sigma, K, dt_s)
    return result if all(np.isfinite(sigma).all() for sigma in result if sigma is not None) else lost


def _step_s(plant: Plant, duration_s: float, cases: int) -> float | None:
    """Return the shortest step within `MOST_WORK`, else the longest step; None if that is too much work."""
    n = len(plant.decay_1_s) + int(plant.estimated.sum()) + plant.learnt
    work_s = n**3 * cases * duration_s
    fitting = [step_s for step_s in STEPS_S if work_s / step_s <= MOST_WORK]
    if not fitting and work_s / STEPS_S[-1] > _TOO_MUCH_WORK:
        return None
    return (*fitting, STEPS_S[-1])[0]


def _fixed_gain(plant: Plant, settings: EstimatorSettings, dt_s: float) -> FloatArray | Refusal | None:
    """Return the constant gain (n, s) of an observer, None for a Kalman filter."""
    if settings.kind != "luenberger" and settings.engine != "constant":
        return None
    gain = gain_for(plant, step_matrices(plant, dt_s), everything(plant), settings)
    return gain.K if isinstance(gain, LuenbergerGain) else gain


def _over(
    plant: Plant,
    a: LearningArrays,
    shift: Sequence[Stage],
    sigma: FloatArray,
    K: FloatArray | None,
    dt_s: float,
) -> Spread:
    """Return the mean σ with tolerances `sigma` (v, L)."""
    moment_sigmas = [sigmas(moment, a) for moment in moments(plant, a, shift, sigma, K, dt_s)]
    heat, field, error = (np.mean(column, axis=0) for column in zip(*moment_sigmas, strict=True))
    has_error = len(plant.rows.C) > plant.rows.error_slice.start
    return Spread(heat, field.mean(axis=1), error.mean(axis=1) if has_error else None)


def moments(
    plant: Plant,
    a: LearningArrays,
    shift: Sequence[Stage],
    sigma: FloatArray,
    K: FloatArray | None,
    dt_s: float,
    weight_1_K: FloatArray | None = None,
) -> Iterator[Moment]:
    """Yield moments of a shift from `FROM_S` on, one in `STEPS_PER_MOMENT` steps.

    Args:
        plant: The model with its tolerances.
        a: Its parameters.
        shift: Stages of constant heats.
        sigma: σ of the L parameters in v cases, (v, L).
        K: Constant gain of [x | δ], or None for the Kalman filter.
        dt_s: Length of a step, s.
        weight_1_K: One over the σ of each reading's mean over a step, 1/K, (v, s), 0 for a reading that is
            not used. None takes the plant's noise in every case.
    """
    n_x, L = len(plant.decay_1_s), len(a.kind)
    first = n_x + int(plant.estimated.sum())
    P = start(plant, a, shift[0], sigma, at_rest=K is None)
    Q = wandering(sigma, first, dt_s)
    for count, now in enumerate(along(plant, a, shift, dt_s, sweeps=K is None), 1):
        Q[:, :first, :first] = now.Q
        P[:, range(n_x, first), range(n_x, first)] += (plant.jump_uncertainty * now.jump_W) ** 2
        phase_rows = now.H + now.passing
        before = now.F @ P @ now.F.T + Q
        if weight_1_K is None:
            noise_R = np.tile(plant.noise_R_K2 * len(phase_rows), len(phase_rows))
            P = corrected(before, phase_rows.reshape(-1, first + L), noise_R, K, a.considered, first)
        else:  # rows in standard deviations: a reading that is not used is a row of nothing
            rows = weight_1_K[:, None, :, None] * phase_rows / np.sqrt(len(phase_rows))
            rows = rows.reshape(len(sigma), -1, first + L)
            P = corrected(before, rows, np.ones(rows.shape[1]), None, a.considered, first)
        if is_counted(count, dt_s):
            yield Moment(now.plant, now.stage, now.x, phase_rows, between(before, P))


def is_counted(step: int, dt_s: float) -> bool:
    """Return whether a step enters the means; steps count from 1 and are `dt_s` long."""
    return step * dt_s >= FROM_S and step % STEPS_PER_MOMENT == 0


def between(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the mean covariance over a step, whose samples are spread over it.

    It is the mean of the covariances before and after the correction.
    """
    return np.asarray(0.5 * (before + after))


def wandering(sigma: FloatArray, first: int, dt_s: float) -> FloatArray:
    """Return the noise of a step by which the parameters wander about zero with constant σ.

    Args:
        sigma: σ of the parameters, (v, L).
        first: Number of states before the parameters.
        dt_s: Length of the step, s; the time constant is `learning.WANDER_S`.

    Returns:
        Q (v, n, n) with σ² (1 - exp(-2 dt/τ)) on the parameters' diagonal, else 0.
    """
    n = first + sigma.shape[1]
    Q = np.zeros((len(sigma), n, n))
    Q[:, range(first, n), range(first, n)] = sigma**2 * (1.0 - np.exp(-dt_s / WANDER_S) ** 2)
    return Q


def start(plant: Plant, a: LearningArrays, stage: Stage, sigma: FloatArray, *, at_rest: bool) -> FloatArray:
    """Return the covariances (v, n, n) before the first correction.

    Args:
        plant: The model with its tolerances.
        a: Its parameters.
        stage: The first stage of the shift.
        sigma: σ of the parameters, (v, L).
        at_rest: Whether a shift that begins without heats begins from a screw at the air's temperature. It
            needs uncertain offsets and an uncertain ambient.
    """
    n_x, m_e = len(plant.decay_1_s), int(plant.estimated.sum())
    first = n_x + m_e
    P = np.zeros((len(sigma), first + len(a.kind), first + len(a.kind)))
    rest = (
        at_rest
        and a.rests == 1
        and {Nuisance.AMBIENT, Nuisance.OFFSET} <= set(a.kind)
        and not stage.law_W.any()
    )
    P[:, :n_x, :n_x] = a.rest_P if rest else plant.prior_P
    still = STILL if rest else 1.0
    P[:, range(n_x, first), range(n_x, first)] = (still * plant.initial_sigma_W) ** 2
    parameters = range(first, first + len(a.kind))
    P[:, parameters, parameters] = sigma**2
    for i in np.flatnonzero(a.kind == Nuisance.AMBIENT) if rest else ():
        covariance = sigma[:, i, None] ** 2 * plant.uniform
        P[:, :n_x, first + i] = P[:, first + i, :n_x] = covariance
        P[:, :n_x, :n_x] += covariance[:, :, None] * plant.uniform
    return P


def corrected(
    P: FloatArray,
    H: FloatArray,
    R_K2: FloatArray,
    K: FloatArray | None,
    considered: NDArray[np.int64],
    first: int,
) -> FloatArray:
    """Return the covariances after a correction by all sensors.

    Args:
        P: Covariances before it, (v, n, n).
        H: Rows of the readings, (r, n), or (v, r, n) with rows for each case.
        R_K2: Variances of the readings, (r,).
        K: Constant gain of the `first` states; P is then in Joseph's form. None takes the Kalman gain.
        considered: Parameters that the Kalman gain leaves unchanged (Schmidt 1966).
        first: Number of states before the parameters.
    """
    if K is not None:
        left = np.eye(P.shape[1])
        left[:first] -= K @ H
        P = left @ P @ left.T
        P[:, :first, :first] += (K * R_K2) @ K.T
        return P
    PH = P @ H.swapaxes(-1, -2)
    learned = PH @ np.linalg.solve(H @ PH + np.diag(R_K2), PH.swapaxes(1, 2))
    considered = first + considered
    learned[:, considered[:, None], considered] = 0.0
    P = P - learned
    return np.asarray(0.5 * (P + P.swapaxes(1, 2)))


def sigmas(now: Moment, a: LearningArrays) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the σ at a moment.

    Args:
        now: The moment, with v cases.
        a: Parameters of the model; the scale of a law adds to its heat.

    Returns:
        σ of heats, W, (v, m_e), of the field, K, (v, g), and of the thermal error, µm, (v, g or 0).
    """
    plant, stage, x, P = now.plant, now.stage, now.x, now.P
    n_x, estimated, g = len(x), np.flatnonzero(plant.estimated), plant.rows.grid
    heats = np.eye(len(estimated), P.shape[1], n_x)
    for q in np.flatnonzero(a.kind == Nuisance.LAW):
        heats[a.of[q], n_x + len(estimated) + q] = stage.law_W[estimated[a.of[q]]]
    rows = plant.rows.C[plant.rows.sensors :]
    heat = np.sqrt(((heats @ P) * heats).sum(axis=2))
    variance = ((rows @ P[:, :n_x, :n_x]) * rows).sum(axis=2)
    wide = np.sqrt(np.maximum(variance, 0.0))
    value = np.tile(rows @ x + plant.rows.F[plant.rows.sensors :] @ stage.z, (len(P), 1))
    _, error = fold(plant.rows.restraint, value[:, g:], wide[:, g:])
    return heat, wide[:, :g], error
