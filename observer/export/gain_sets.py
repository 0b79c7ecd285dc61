"""Constant gains for every set of sensors that a controller may have left, and their settling times."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from observer.config.machine import Config
from observer.errors import ConfigError
from observer.estimators.design.gains import (
    LuenbergerGain,
    Refusal,
    closed_loop,
    everything,
    refusal,
    sensor_rows,
)
from observer.estimators.design.steady import bandwidth, gain_for, steady_covariance
from observer.frames import FloatArray
from observer.model.discretise import StepMatrices
from observer.model.plant import Plant

_MOST_GAINS = 40_000
"""Numbers in the table of gains up to which two absent sensors have gains, too: 320 kB in double."""
_GROWTH_AT_MOST_1_S = 1e-5
"""Permitted growth of an error while a nut stands, on an unattended controller: e-fold in more than a day."""
_SETTLED_SIGMA = 1.1
"""The heats count as settled once their σ are within a tenth of the steady ones."""
LONG = 30_000
"""The value at which step counters stop: it fits into 16 bits."""


class GainSets(NamedTuple):
    """Gains for G sets of s sensors, of n states each.

    Attributes:
        K: Gains (2 G + 1, s, n), first index the set: G steady ones, G of the first correction and of an
            inflated state, and last zeros. Rows of absent sensors are zero.
        gate_K2: Largest squares of innovations that pass, in K², (2 G + 1, s).
        number: The set without the sensors i and j, (s + 1, s + 1); index s means no sensor. A set without a
            gain has the number of the zeros.
        most_absent: How many sensors may be absent, 1 or 2.
        settled: Steps until the heats' σ are within a tenth of their steady values.
        refused: The absent sensors of each set without a gain, as names separated by commas.
    """

    K: FloatArray
    gate_K2: FloatArray
    number: NDArray[np.int64]
    most_absent: int
    settled: int
    refused: tuple[str, ...]


def gain_sets(config: Config, plant: Plant, step: StepMatrices) -> GainSets:
    """Design the gains of all sets.

    The steady gain is the Kalman gain or the placed Luenberger gain, as `estimator.kind` chooses. Covariances
    follow Joseph's form, so they are right for any gain.

    Args:
        config: The configuration of sensors, tolerances and estimator.
        plant: The plant with constant matrices.
        step: Its step of one period.

    Returns:
        Gains for all sensors, without each one, and without each two if the table stays below 40 000 numbers.

    Raises:
        ConfigError: If all sensors together have no gain, with the reason and the remedy.
    """
    s, n = len(config.sensor), len(plant.decay_1_s) + len(plant.heat_decay_1_s)
    most_absent = 2 if 2 * (1 + s + s * (s - 1) // 2) * s * n <= _MOST_GAINS else 1
    omega = bandwidth(plant, config.estimator) if config.estimator.kind == "luenberger" else None
    constant = config.estimator.model_copy(update={"engine": "constant"})
    offset_K2 = (
        np.array([config.tolerance.offset_K if x.offset_K is None else x.offset_K for x in config.sensor])
        ** 2
    )
    number = np.full((s + 1, s + 1), -1)
    steady, wide = list[tuple[FloatArray, FloatArray]](), list[tuple[FloatArray, FloatArray]]()
    refused = list[str]()
    settled = 0
    for absent in itertools.chain(*(itertools.combinations(range(s), k) for k in range(most_absent + 1))):
        present = everything(plant)
        present[list(absent)] = False
        K = gain_for(plant, step, present, constant, omega, _GROWTH_AT_MOST_1_S)
        K = K.K if isinstance(K, LuenbergerGain) else K
        covariance = None if isinstance(K, Refusal) else steady_covariance(plant, step, K)
        if isinstance(K, Refusal) or covariance is None:
            if not absent:
                out_of_precision = refusal(plant, present, "its σ is beyond double precision")
                why = K if isinstance(K, Refusal) else out_of_precision
                raise ConfigError(
                    f"estimator: no constant gain for {', '.join(why.sensors)}: {why.reason}; add or move "
                    "sensors (`observer place`), give each source random_walk_W_sqrt_s > 0, or take "
                    'kind = "luenberger" with a lower bandwidth_1_s'
                )
            refused.append(", ".join(config.sensor[i].name for i in absent))
            continue
        first, second = (*absent, s, s)[:2]
        number[first, second] = len(steady)
        P0 = block_diag(plant.prior_P, np.diag(plant.initial_sigma_W**2))
        K0, S0 = _first_gain(plant, P0, present)
        if not absent:
            settled = _settled(plant, step, K, _corrected(plant, P0, K0), covariance.P)
        steady.append((K, _variance(plant, covariance.P_pred) + offset_K2))
        wide.append((K0, S0 + offset_K2))
    number[number < 0] = 2 * len(steady)
    no_gain = (np.zeros((n, s)), steady[0][1])  # without a gain readings are judged nevertheless
    K_all, S_all = zip(*steady, *wide, no_gain, strict=True)
    gate_K2 = config.estimator.gate_sigma**2 * np.array(S_all)
    gains = np.array(K_all).transpose(0, 2, 1)
    return GainSets(gains, gate_K2, number, min(most_absent, s), settled, tuple(refused))


def _variance(plant: Plant, P: FloatArray) -> FloatArray:
    """Return the innovations' variances (s,) in K² for a state covariance P (n, n) before a correction."""
    C = sensor_rows(plant)
    return np.asarray(np.einsum("ij,jk,ik->i", C, P, C) + plant.noise_R_K2)


def _first_gain(plant: Plant, P0: FloatArray, present: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """Return the Kalman gain (n, s) at a covariance P0 (n, n), zero for absent sensors, and the variances
    (s,).
    """
    C = sensor_rows(plant)
    K = np.zeros((len(P0), len(C)))
    C_present = C[present]
    if len(C_present):
        S = C_present @ P0 @ C_present.T + np.diag(plant.noise_R_K2[present])
        K[:, present] = np.linalg.solve(S, C_present @ P0).T
    return K, _variance(plant, P0)


def _corrected(plant: Plant, P: FloatArray, K: FloatArray) -> FloatArray:
    """Return the covariance (n, n) after a correction with a gain K (n, s), by Joseph's form."""
    rest = np.eye(len(P)) - K @ sensor_rows(plant)
    return np.asarray(rest @ P @ rest.T + (K * plant.noise_R_K2) @ K.T)


def _settled(plant: Plant, step: StepMatrices, K: FloatArray, first: FloatArray, last: FloatArray) -> int:
    """Return how many steps the heats' σ need to come near their steady values; at most `LONG` − 1."""
    heats = slice(len(plant.decay_1_s), None)
    steady_W2 = np.diag(last)[heats]
    M, away = closed_loop(plant, step, K), first - last

    def near(power: FloatArray) -> bool:
        own_W2 = np.diag(power @ away @ power.T)[heats] + steady_W2
        return bool(np.all(own_W2 <= _SETTLED_SIGMA**2 * steady_W2))

    powers = [M]
    while not near(powers[-1]) and 2 ** len(powers) < LONG:
        powers.append(powers[-1] @ powers[-1])
    count, behind = 1, np.eye(len(M))
    for k, power in reversed(list(enumerate(powers[:-1]))):
        if not near(power @ behind):
            behind, count = power @ behind, count + 2**k
    return min(count, LONG - 1)
