"""How well sensors see what is to be estimated, and at which places they would see it best.

A Gramian in units of the priors, and single modes. Sites are ranked by conditioning: the smallest singular
value of what they see, not a rank.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.errors import UserError
from observer.frames import FloatArray
from observer.model.build import build_plant
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


# A set is only exchanged for one that is better by more than rounding.
_BETTER = 1.0 + 1e-9
# Log volumes that are as close differ by rounding: the least directions have four digits beside the floor.
_ALIKE = 1e-3


class SiteSet(NamedTuple):
    """Candidates chosen together: indices in the order of importance, and how well they see.

    `score_K` is the smallest singular value of the responses: the rms temperature that the worst-seen
    direction of field and heats, of prior size, leaves at the sensors. `condition` is the largest over the
    smallest.
    """

    sites: tuple[int, ...]
    score_K: float
    condition: float


def best_places(config: Config, count: int, spacing_m: float | None) -> list[tuple[list[float], SiteSet]]:
    """Return the best sets of 1 … `count` places of a grid over the screw, in m, and how well each sees.

    The grid has steps of about `spacing_m`, 41 places without it. Raises `UserError` for more sensors than
    places.
    """
    length_m = config.screw.length_m
    points = 41 if spacing_m is None else max(2, round(length_m / spacing_m) + 1)
    places_m = [round(x, 6) for x in np.linspace(0.0, length_m, points).tolist()]
    plant = build_plant(_with_sensors(config, np.linspace(0.0, length_m, points).tolist()))
    sets = rank_sensor_sites(plant, plant.rows.C[plant.rows.sensor_slice], count)
    return [(sorted(places_m[i] for i in found.sites), found) for found in sets]


def _with_sensors(config: Config, places_m: list[float]) -> Config:
    """The configuration with a sensor like its first at each place, and no effect of the sensors."""
    first = config.sensor[0]
    candidates = (
        first.model_copy(update={"name": f"c{i}", "channel": f"c{i}", "position_m": x_m, "on": None})
        for i, x_m in enumerate(places_m)
    )
    effects = tuple(e for e in config.effect if e.targets != "sensor")
    return config.model_copy(update={"effect": effects, "sensor": tuple(candidates)})


def rank_sensor_sites(plant: Plant, candidates: FloatArray, count: int) -> list[SiteSet]:
    """Return the best sets found of 1, 2, … `count` sites out of the candidate rows (G, n_x).

    Greedy choice by the volume of the Gramian, then exchanges, one site at a time, while the smallest
    singular value grows. Raises `UserError` for more sensors than candidates.
    """
    if not 1 <= count <= len(candidates):
        raise UserError(
            f"place: {count} sensors cannot stand on {len(candidates)} candidate positions; "
            f"ask for 1 to {len(candidates)}"
        )
    seen = plant_responses(plant, candidates)
    chosen: list[int] = []
    ranked = []
    for _ in range(count):
        chosen = _exchange(seen, [*chosen, _most_volume(seen, chosen)])
        singular = np.linalg.svd(seen[chosen].reshape(-1, seen.shape[-1]), compute_uv=False)
        smallest = smallest_singular_value(seen[chosen])
        condition = float(singular[0]) / smallest if smallest > 0 else float("inf")
        ranked.append(SiteSet(tuple(chosen), smallest, condition))
    return ranked


def _most_volume(seen: FloatArray, chosen: list[int]) -> int:
    """Return the candidate that adds most to log det of the Gramian, with a floor while that is singular."""
    n = seen.shape[-1]
    flat = seen[chosen].reshape(-1, n)
    base = flat.T @ flat
    floor = 1e-12 * float(np.max(np.einsum("rtn,rtn->r", seen, seen))) * np.eye(n)
    volumes = [
        -np.inf if i in chosen else np.linalg.slogdet(base + row.T @ row + floor)[1]
        for i, row in enumerate(seen)
    ]
    # places that differ by rounding alone, as the two ends of a symmetric screw: the first on any computer
    return int(np.flatnonzero(np.array(volumes) >= max(volumes) - _ALIKE)[0])


def _exchange(seen: FloatArray, chosen: list[int]) -> list[int]:
    """Replace one site at a time by the candidate that raises the smallest singular value most."""
    best = smallest_singular_value(seen[chosen])
    improved = True
    while improved:
        improved = False
        for place in range(len(chosen)):
            for candidate in set(range(len(seen))) - set(chosen):
                trial = [*chosen[:place], candidate, *chosen[place + 1 :]]
                score = smallest_singular_value(seen[trial])
                if score > best * _BETTER:
                    chosen, best, improved = trial, score, True
    return chosen
