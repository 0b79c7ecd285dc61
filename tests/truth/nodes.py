"""A finite-volume screw and bodies beside it, cell by cell: what a network of nodes is to be compared with.

Where a body touches the screw, each cell under it exchanges heat by itself, so that a nut that sweeps over
cold and warm places exchanges with each in the measure of its stay (Li 2022, eq. 45).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from tests.truth.bar import Bar, FloatArray, Mesh
from tests.truth.stepper import GAMMA, WEIGHT


@dataclass(frozen=True, slots=True)
class Contact:
    """A body that touches the screw: by cells, `share` (cells,) or (K, cells), or by the face of an `end`."""

    body: int
    conductance_W_K: float
    share: FloatArray | None = None
    end: Literal["left", "right"] | None = None


@dataclass(frozen=True, slots=True)
class Heat:
    """A heat (K,), mean over each step: into cells, an end's face, or a body, as `Contact`."""

    heat_W: FloatArray
    share: FloatArray | None = None
    end: Literal["left", "right"] | None = None
    body: int | None = None


@dataclass(frozen=True, slots=True)
class Bodies:
    """`capacity_J_K` (n,), links (i, j, W/K) between them and (i, W/K) into the air, and contacts."""

    capacity_J_K: FloatArray
    links: Sequence[tuple[int, int, float]]
    to_air: Sequence[tuple[int, float]]
    contacts: Sequence[Contact]


def simulate(
    bar: Bar,
    mesh: Mesh,
    bodies: Bodies,
    heats: Sequence[Heat],
    time_s: FloatArray,
    ambient_degC: float,
    covered: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the cells' (K + 1, cells) and the bodies' (K + 1, n) temperatures, all at ambient at first.

    `covered` (K, cells) is the part of each cell's surface and of each step in which no air cools it.

    TR-BDF2, as `stepper`, on dense matrices, as a moving contact changes them at every step.
    """
    cells, n, steps = mesh.cells, len(bodies.capacity_J_K), len(time_s) - 1
    capacity = np.concatenate([np.full(cells, bar.capacity_J_mK * mesh.width_m), bodies.capacity_J_K])
    fixed = _fixed(bar, mesh, bodies)
    half_K_W = mesh.width_m / (2.0 * bar.conductance_Wm_K)
    moving = any(c.share is not None and c.share.ndim == 2 for c in bodies.contacts) or covered is not None
    rise, out = np.zeros(cells + n), np.zeros((steps + 1, cells + n))
    factors: dict[float, object] = {}
    for k in range(steps):
        dt_s = float(time_s[k + 1] - time_s[k])
        K, load = fixed.copy(), np.zeros(cells + n)
        if covered is not None:
            K[np.arange(cells), np.arange(cells)] -= bar.film_W_mK * mesh.width_m * covered[k]
        for contact in bodies.contacts:
            _touch(K, load, contact, k, cells, half_K_W, heats)
        for heat in heats:
            _warm(load, heat, k, cells)
        key = 0.0 if moving else dt_s
        if moving or key not in factors:
            factors[key] = lu_factor(np.diag(capacity) + 0.5 * GAMMA * dt_s * K)
        stored, half_s = capacity * rise, 0.5 * GAMMA * dt_s
        middle = lu_solve(factors[key], stored - half_s * (K @ rise) + GAMMA * dt_s * load)
        last = capacity * (WEIGHT * middle) - (1.0 - GAMMA) ** 2 * WEIGHT * stored + half_s * load
        rise = lu_solve(factors[key], last)
        out[k + 1] = rise
    return ambient_degC + out[:, :cells], ambient_degC + out[:, cells:]


def _fixed(bar: Bar, mesh: Mesh, bodies: Bodies) -> FloatArray:
    """The conductances (cells + n, cells + n) that nothing moves; the air is at 0."""
    cells = mesh.cells
    size = cells + len(bodies.capacity_J_K)
    K = np.zeros((size, size))
    inner = [(i, i + 1, bar.conductance_Wm_K / mesh.width_m) for i in range(cells - 1)]
    for i, j, G in [*inner, *((cells + i, cells + j, G) for i, j, G in bodies.links)]:
        _tie(K, i, j, G)
    K[np.arange(cells), np.arange(cells)] += bar.film_W_mK * mesh.width_m
    for i, G in bodies.to_air:
        K[cells + i, cells + i] += G
    return K


def _tie(K: FloatArray, i: int, j: int, G: float) -> None:
    K[i, i] += G
    K[j, j] += G
    K[i, j] -= G
    K[j, i] -= G


def _touch(
    K: FloatArray,
    load: FloatArray,
    contact: Contact,
    k: int,
    cells: int,
    half_K_W: float,
    heats: Sequence[Heat],
) -> None:
    """Tie a body to the screw over step k. At a face its own gradient counts: Q = G (T_face − T_body) with
    T_face = T_cell + (q − Q) r, so that a heat q there goes into the body in part at once.
    """
    body = cells + contact.body
    if contact.share is not None:
        share = contact.share if contact.share.ndim == 1 else contact.share[k]
        for cell in np.flatnonzero(share):
            _tie(K, int(cell), body, contact.conductance_W_K * float(share[cell]))
        return
    cell = 0 if contact.end == "left" else cells - 1
    G = contact.conductance_W_K / (1.0 + contact.conductance_W_K * half_K_W)
    _tie(K, cell, body, G)
    for heat in heats:
        if heat.end == contact.end:
            load[body] += G * half_K_W * heat.heat_W[k]
            load[cell] -= G * half_K_W * heat.heat_W[k]


def _warm(load: FloatArray, heat: Heat, k: int, cells: int) -> None:
    if heat.body is not None:
        load[cells + heat.body] += heat.heat_W[k]
    elif heat.end is not None:
        load[0 if heat.end == "left" else cells - 1] += heat.heat_W[k]
    elif heat.share is not None:
        share = heat.share if heat.share.ndim == 1 else heat.share[k]
        load[:cells] += share * heat.heat_W[k]
