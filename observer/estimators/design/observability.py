"""How well sensors see what is to be estimated: a Gramian in units of the priors, and single modes."""

from __future__ import annotations

import numpy as np

from observer.frames import FloatArray
from observer.model.generator import settled_inputs, settled_rows
from observer.model.plant import Plant
from observer.model.rod.modes import held_s

# Modes that decay faster than this many times the slowest leave no trace that stands out from noise.
_SLOW = 16.0
_PANELS, _NODES = 12, 4
_ROUNDING = 1e-12


def slow_modes(decay_1_s: FloatArray) -> np.typing.NDArray[np.int64]:
    """Return the indices of the modes that sensors can see: Λ up to 16 times the slowest that decays."""
    slowest = float(np.min(decay_1_s[decay_1_s > 0], initial=np.inf))
    return np.flatnonzero(decay_1_s <= _SLOW * slowest)


def responses(
    decay_1_s: FloatArray, B: FloatArray, C: FloatArray, scale: FloatArray, horizon_s: float
) -> FloatArray:
    """Return each row's weighted response (rows, times, n) to every state of [modes | heats], each of its
    prior size.

    `decay_1_s` (N,), `B` (N, m_e), `C` (rows, N), `scale` (N + m_e,). Their squares summed over times are the
    Gramian 1/T ∫_0^T D Φᵀ cᵀ c Φ D dt, K²; the times crowd towards 0, where fast modes act.
    """
    x, w = np.polynomial.legendre.leggauss(_NODES)
    edges = horizon_s * np.append(0.0, 0.5 ** np.arange(_PANELS - 1, -1, -1))
    half = np.diff(edges) / 2
    times = (edges[:-1] + half)[:, None] + half[:, None] * x
    weights = (half[:, None] * w / horizon_s).ravel()
    t = times.ravel()[:, None]
    decayed = np.exp(-t * decay_1_s)
    seen = np.concatenate(
        [C[:, None, :] * decayed, np.einsum("rn,tn,nj->rtj", C, held_s(decay_1_s, t), B)], axis=2
    )
    return np.asarray(seen * scale * np.sqrt(weights)[:, None])


def smallest_singular_value(seen: FloatArray) -> float:
    """Return the smallest singular value of the responses, K: what a sensor sees of the worst-seen direction.

    Its square is that of the Gramian; it is worked out without squaring, which would lose half the digits.
    What is not more than rounding is 0.
    """
    singular = np.linalg.svd(seen.reshape(-1, seen.shape[-1]), compute_uv=False)
    return float(singular[-1]) if singular[-1] > _ROUNDING * singular[0] else 0.0


def plant_responses(plant: Plant, C: FloatArray) -> FloatArray:
    """Return the responses of sensor rows `C` (rows, n_x) on the slow part of a plant's pair, over the time
    constant of the slowest decaying mode.
    """
    slow = slow_modes(plant.decay_1_s[: plant.modes])
    decay = plant.decay_1_s[slow]
    scale = np.concatenate([np.sqrt(np.diag(plant.prior_P))[slow], plant.initial_sigma_W])
    B = settled_inputs(plant)[np.ix_(slow, np.flatnonzero(plant.estimated))]
    return responses(decay, B, C[:, slow], scale, 1.0 / float(np.min(decay[decay > 0])))


def weakest_mode(plant: Plant) -> tuple[int, int, float]:
    """Return the mode (its number) that the sensors see worst, the sensor (index) that sees it best, and how
    much.

    How much is the mode's shape at that sensor against its largest value anywhere on the grid.
    """
    temperatures = settled_rows(plant)[: plant.rows.sensors + plant.rows.grid, : plant.modes]
    largest = np.abs(temperatures).max(axis=0)
    share = np.abs(temperatures[: plant.rows.sensors]) / np.where(largest > 0, largest, 1.0)
    best = share.max(axis=0)
    mode = int(np.argmin(best))
    return plant.mode_index[mode], int(np.argmax(share[:, mode])), float(best[mode])
