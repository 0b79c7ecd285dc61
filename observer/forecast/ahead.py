"""An hour ahead: the estimator's own prediction without a sensor, for a program and the present heats.

x⁺ = Ad x + known inputs, P⁺ = Ad P Adᵀ + Qd (Kalman 1960), from the estimated state. Each heat is its law
times r, the ratio of the estimated heat to that law. The prior of r is 1, with the law's uncertainty. The
deviation of the heat then carries the uncertainty of r, and drifts. Variation of the program is white heat
with its spectral density at low frequency. Possible changes of the air enter its state.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from observer.config.estimator import EstimatorSettings
from observer.estimators.kalman import KalmanEstimator
from observer.estimators.protocol import Estimator, EstimatorState
from observer.forecast.program import BIN_S, Bins, Program
from observer.frames import BoolArray, EstimateBlock, FloatArray, Inputs
from observer.model.learning import WANDER_S, Nuisance
from observer.model.plant import Plant

HOUR_S = 3600.0
DRIFT = 0.2
"""How far a heat drifts from its law in an hour, in parts of the law's uncertainty."""
AIR_K_sqrt_h = 0.3
"""How far air wanders in an hour where nothing more is known."""
REST = 0.1
"""How much of what the estimator allows for a heat at rest is left once none was seen there."""
CALM = 0.3
"""How much less than the estimator allows for the machine itself changes within hours."""
MEMORY_S = 300.0
"""Over how long errors of an estimated heat go together."""
AGO_BINS = 120
_PART = 30
_TEN, _FIRM, _MOST_SCALE = 60, 3.0, 9.0


class MeanHeats(NamedTuple):
    """The mean heats of m sources, m_e of them estimated.

    Attributes:
        ratio: Ratio of each heat to its law, (m,).
        extra_W: Heat in addition to the law, W, (m,).
        sigma_W: σ of the mean heat, W, (m_e,).
    """

    ratio: FloatArray
    extra_W: FloatArray
    sigma_W: FloatArray


@dataclass(frozen=True, slots=True)
class Runner:
    """An estimator that predicts without corrections from a state.

    Attributes:
        plant: The model with the process noise of a forecast.
        estimator: Estimator of this plant.
        state: Its state.
        heats: Heats relative to their laws.
        z: Known inputs, which stay as they are, (p,).
        settings: The table `[estimator]`.
        after_s: Time of the state since the start of the forecast, s.
        drifts: Whether heats may drift from their ratio to the laws; otherwise they settle to that ratio.
    """

    plant: Plant
    estimator: Estimator
    state: EstimatorState
    heats: MeanHeats
    z: FloatArray
    settings: EstimatorSettings
    after_s: float = 0.0
    drifts: bool = True

    def run(self, bins: Bins) -> tuple[Runner, EstimateBlock]:
        """Advance over some bins.

        Learnt parameters of the machine stay unchanged.

        Args:
            bins: Inputs, one step per bin.

        Returns:
            The new runner, and the estimates with times from the start of the forecast, s.
        """
        u, time_s = self._inputs(bins), self.after_s + np.cumsum(bins.dt_s)
        state, block = self.estimator.run(self.state, u)
        if learnt := self.plant.learnt:
            x = state.x_hat.copy()
            x[-learnt:] = self.state.x_hat[-learnt:]
            state = replace(state, x_hat=x)
        return replace(self, state=state, after_s=float(time_s[-1])), replace(block, time_s=time_s)

    def follow(self, parts: Iterable[Bins]) -> Iterator[EstimateBlock]:
        """Yield the estimates of one part after the other, without storing the earlier ones."""
        at = self
        for bins in parts:
            at, block = at.run(bins)
            yield block

    def _inputs(self, bins: Bins) -> Inputs:
        n, s, time_s = len(bins.dt_s), self.plant.rows.sensors, self.state.time_s
        z = np.tile(self.z, (n, 1))
        return Inputs(
            time_s=time_s + np.cumsum(bins.dt_s),
            dt_s=bins.dt_s.copy(),
            y_degC=np.full((n, s), np.nan),
            usable=np.zeros((n, s), np.bool_),
            quality=np.ones((n, s), np.int8),
            law_W=bins.law_W * self.heats.ratio + self.heats.extra_W,
            law_jump_W=np.zeros_like(bins.law_W),
            z_start=z,
            z_end=z,
            moving_B=bins.moving_B,
            moving_C=bins.moving_C,
            degraded=np.zeros(n, np.int8),
            loss_1_s=bins.loss_1_s,
            loss_degC=bins.loss_degC,
        )


def heats_of(plant: Plant, program: Program) -> MeanHeats:
    """Return the present heats relative to their laws.

    The ratio is 1 before anything is estimated. Then it is the mean of prior and estimate, weighted by their
    variances.

    Args:
        plant: The model, whose `law_uncertainty` is the prior's σ.
        program: The program; at most 120 bins of its past count.
    """
    past = program.past.at(slice(-AGO_BINS, None))
    finite = np.isfinite(past.heat_W).all(axis=1) if past.heat_W.size else np.ones(len(past.dt_s), np.bool_)
    free, m = np.flatnonzero(plant.estimated), len(plant.source_names)
    ratio, extra_W, sigma_W = np.ones(m), np.zeros(m), plant.initial_sigma_W.copy()
    if not finite.any():
        return MeanHeats(ratio, extra_W, sigma_W)
    past = past.at(np.flatnonzero(finite))
    length_s = float(past.dt_s.sum())
    heat_W, law_W = past.heat_W.mean(axis=0), past.own_law_W.mean(axis=0)
    ahead_W = program.mean.law_W[0, free]
    mean_sigma_W = past.sigma_W.mean(axis=0) * min(1.0, np.sqrt(MEMORY_S / max(length_s, 1e-9)))
    for i, j in enumerate(free):
        if abs(law_W[i]) <= 1e-6:  # no law, or none at rest
            stays = abs(ahead_W[i]) <= 1e-6
            extra_W[j] = heat_W[i] if stays and abs(heat_W[i]) > 2.0 * mean_sigma_W[i] else 0.0
            by_law_W = plant.law_uncertainty[i] * abs(ahead_W[i])
            sigma_W[i] = np.hypot(min(mean_sigma_W[i], abs(heat_W[i]) + REST * mean_sigma_W[i]), by_law_W)
            continue
        prior, estimated = max(plant.law_uncertainty[i], 1e-3), max(mean_sigma_W[i] / abs(law_W[i]), 1e-6)
        weight = prior**2 / (prior**2 + estimated**2)
        ratio[j] = 1.0 + weight * (heat_W[i] / law_W[i] - 1.0)
        sigma_W[i] = np.sqrt(weight) * estimated * abs(ahead_W[i])
    return MeanHeats(ratio, extra_W, sigma_W)


def runner(plant: Plant, settings: EstimatorSettings, state: EstimatorState, program: Program) -> Runner:
    """Return the runner that starts from a state, with heats at their present ratio to the laws.

    Args:
        plant: The model of the state.
        settings: The table `[estimator]`.
        state: State of the estimator.
        program: The program; the last five minutes of its past give the known inputs.

    Raises:
        ValueError: If the state has not started, belongs to another plant, or is not finite.
    """
    _refuse_unknown(plant, state)
    n_x, m_e = len(plant.decay_1_s), int(plant.estimated.sum())
    heats = heats_of(plant, program)
    x, P = state.x_hat.copy(), state.P.copy()
    heats_slice = slice(n_x, n_x + m_e)
    x[heats_slice] = 0.0
    past_s = max(float(program.past.dt_s.sum()), BIN_S)
    mean_W = np.abs(program.mean.law_W[0] * heats.ratio + heats.extra_W)
    share = mean_W / max(float(mean_W.sum()), 1e-12)
    free = np.flatnonzero(plant.estimated)
    P = _of_means(P, heats_slice, heats.sigma_W, np.abs(program.mean.law_W[0, free]) <= 1e-6)
    P[heats_slice, heats_slice] += np.diag(share[free] ** 2 * program.noise_W2_s / past_s)
    learning = plant.learning
    if learning is not None:
        laws = n_x + m_e + np.flatnonzero(learning.arrays.kind == Nuisance.LAW)
        x[laws], P[laws], P[:, laws] = 0.0, 0.0, 0.0  # the ratio has them
    doubtful = _doubtful(plant, program, share, mean_W[free])
    linearisation = state.around.copy()
    if len(linearisation):
        linearisation[heats_slice] = 0.0
    z = program.past.z[-_PART:].mean(axis=0)
    begin = replace(state, x_hat=x, P=P, around=linearisation)
    return Runner(doubtful, KalmanEstimator(doubtful, settings), begin, heats, z, settings)


def runner_by_law(
    plant: Plant, settings: EstimatorSettings, state: EstimatorState, program: Program
) -> Runner:
    """Return the runner that starts from a state, with heats that settle to their laws, scaled as learnt.

    Arguments as in `runner`.

    Raises:
        ValueError: If the state has not started, belongs to another plant, or is not finite.
    """
    _refuse_unknown(plant, state)
    m = len(plant.source_names)
    heats = MeanHeats(np.ones(m), np.zeros(m), np.zeros(int(plant.estimated.sum())))
    mean_W = np.abs(program.mean.law_W[0])
    share = mean_W / max(float(mean_W.sum()), 1e-12)
    doubtful = replace(
        _doubtful(plant, program, share, mean_W[plant.estimated]),
        random_walk_W2_s=plant.random_walk_W2_s,
        heat_decay_1_s=plant.heat_decay_1_s,
    )
    z = program.past.z[-_PART:].mean(axis=0)
    return Runner(doubtful, KalmanEstimator(doubtful, settings), state, heats, z, settings, drifts=False)


def _refuse_unknown(plant: Plant, state: EstimatorState) -> None:
    """Raise `ValueError` if the state has no finite estimate with a covariance."""
    n = len(plant.decay_1_s) + int(plant.estimated.sum()) + plant.learnt
    if not state.started or state.x_hat.shape != (n,) or state.P.shape != (n, n):
        raise ValueError(
            "a forecast needs an estimate with its σ, and there is none yet; wait for readings of all sensors"
        )
    if not (np.isfinite(state.x_hat).all() and np.isfinite(state.P).all()):
        raise ValueError(
            "the estimate is not finite, so there is no forecast; check the readings and the configuration"
        )


def _of_means(P: FloatArray, heats: slice, sigma_W: FloatArray, is_idle: BoolArray) -> FloatArray:
    """Return the covariance with the σ of mean heats (m_e,) in place of that of momentary heats.

    A heat is K θ + w, with the learnt parameters θ of the machine, the states after the heats. K θ stays: a
    stronger film goes with larger heats, and no mean over time removes that. Only w becomes smaller. A heat
    that `is_idle` (m_e,) has no K θ.
    """
    scale = np.minimum(1.0, sigma_W / np.sqrt(np.maximum(np.diag(P)[heats], 1e-12)))
    learnt = slice(heats.stop, len(P))
    K = P[heats, learnt] @ np.linalg.pinv(P[learnt, learnt], rcond=1e-10, hermitian=True)
    T = np.eye(len(P))
    T[heats, heats] = np.diag(scale)
    T[heats, learnt] = np.where(is_idle, 0.0, 1.0 - scale)[:, None] * K
    return np.asarray(T @ P @ T.T)


def drift_scale(past: Bins, per_hour: float) -> float:
    """Return the variance of the observed drift of heats over laws, relative to the expected one.

    It follows from the differences of means over ten minutes of work, and is at most `_MOST_SCALE`. The
    expectation counts as much as `_FIRM` of those differences.

    Args:
        past: The last bins.
        per_hour: Expected drift in an hour, σ relative to the heat.
    """
    count = len(past.dt_s) // _TEN if past.heat_W.size else 0
    blocks = slice(len(past.dt_s) - count * _TEN, None)
    law_W, heat_W = (
        c[blocks].sum(axis=1).reshape(count, _TEN).mean(axis=1) for c in (past.own_law_W, past.heat_W)
    )
    is_working = np.isfinite(heat_W) & (law_W > 0.5 * law_W.max(initial=0.0)) & (law_W > 1e-6)
    ratio = heat_W[is_working] / law_W[is_working]
    steps = np.diff(ratio)[-_TEN // 10 :] / max(float(ratio.mean()) if len(ratio) else 1.0, 1e-3)
    observed = float(steps @ steps) * HOUR_S / (_TEN * BIN_S) / max(per_hour, 1e-6) ** 2
    return min((_FIRM + observed) / (_FIRM + len(steps)), _MOST_SCALE)


def _doubtful(plant: Plant, program: Program, share: FloatArray, mean_W: FloatArray) -> Plant:
    """Return the plant with the process noise of a forecast in place of that of an estimate."""
    mean = program.mean
    B = plant.B.copy()
    for i, source in enumerate(plant.moving):
        B[:, source.index] = mean.moving_B[0, i]
    b = B @ share
    hour_W = DRIFT * plant.law_uncertainty * mean_W
    whole_W = max(float(mean_W.sum()), 1e-12)
    scale = drift_scale(program.past, float(np.linalg.norm(hour_W)) / whole_W) if hour_W.any() else 1.0
    walk = scale * hour_W**2 / HOUR_S
    learning = plant.learning
    if learning is not None:
        arrays = learning.arrays
        wander_K = max(AIR_K_sqrt_h, _wander_K(program.past.z[:, arrays.ambient]))
        air = arrays.kind == Nuisance.AMBIENT
        sigma = np.where(air, wander_K * np.sqrt(WANDER_S / 2 / HOUR_S), CALM * arrays.sigma)
        learning = replace(learning, arrays=arrays._replace(sigma=sigma), wander_s=WANDER_S)
    return replace(
        plant,
        field_noise_Q=plant.field_noise_Q + program.noise_W2_s * np.outer(b, b),
        random_walk_W2_s=walk,
        heat_decay_1_s=np.zeros_like(walk),
        learning=learning,
    )


def _wander_K(air_degC: FloatArray) -> float:
    """Return the change of the air in an hour, in K, from ten minutes' differences of the past."""
    step = 60
    if len(air_degC) < 2 * step:
        return 0.0
    rise = air_degC[step:] - air_degC[:-step]
    return float(np.sqrt(np.mean(rise**2) * HOUR_S / (step * BIN_S)))


def repeated(bins: Bins, duration_s: float) -> Bins:
    """Return the bins repeated in order for a duration.

    Args:
        bins: The program; a single bin is repeated in steps of `BIN_S`.
        duration_s: The duration, s, rounded to whole bins, at least one.
    """
    if len(bins.dt_s) == 1:
        bins = bins._replace(dt_s=np.full(1, BIN_S))
    count = max(1, round(duration_s / float(bins.dt_s.mean())))
    return bins.at(np.arange(count) % len(bins.dt_s))


def ahead(begin: Runner, program: Program, duration_s: float) -> EstimateBlock:
    """Return the estimates of the next hours, one per bin, with times from now, s.

    Args:
        begin: The runner at the present moment.
        program: The program, which is repeated.
        duration_s: The duration, s.
    """
    bins = repeated(program.bins, duration_s)
    parts = (bins.at(slice(first, first + _PART)) for first in range(0, len(bins.dt_s), _PART))
    return EstimateBlock.joined(list(begin.follow(parts)))
