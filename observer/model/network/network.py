"""A network of nodes by itself: C dT/dt = −K T + g T_amb + q.

Li 2022, eq. 8, as matrices. At rest (Yu et al. 2024, eq. 49), by Crank and Nicolson (Li, eqs. 12 to 19),
and in its own modes, which is how a plant takes it in.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray

ROUNDING = 1e-13
"""A rate below this part of the largest is that of nodes that lose nothing."""


class Network(NamedTuple):
    """n nodes: `capacity_J_K` (n,); `conductance_W_K` (n, n), the matrix K of the links, with those into the
    ambient on its diagonal; `ambient_W_K` (n,), g.
    """

    capacity_J_K: FloatArray
    conductance_W_K: FloatArray
    ambient_W_K: FloatArray


class Transition(NamedTuple):
    """T⁺ = `E` q + `C` T + `D` T_amb over a step, q and T_amb its means; shapes (n, n), (n, n), (n,)."""

    C: FloatArray
    D: FloatArray
    E: FloatArray


class NodeModes(NamedTuple):
    """The network in coordinates that decay by themselves: T = `shape` ξ, ξ = `inverse` T.

    `decay_1_s` (n,); `shape` (n, n), each column at most 1; `inverse` (n, n); `input` (n, n), what 1 J into
    each node does to ξ; `ambient` (n,), 1/s.
    """

    decay_1_s: FloatArray
    shape: FloatArray
    inverse: FloatArray
    input: FloatArray
    ambient: FloatArray


def assemble(
    capacity_J_K: Sequence[float],
    links: Sequence[tuple[int, int, float]],
    to_ambient: Sequence[tuple[int, float]],
) -> Network:
    """Return the network of nodes with links (i, j, W/K) and conductances (i, W/K) to the ambient."""
    n = len(capacity_J_K)
    K, g = np.zeros((n, n)), np.zeros(n)
    for i, j, G in links:
        K[i, i] += G
        K[j, j] += G
        K[i, j] -= G
        K[j, i] -= G
    for i, G in to_ambient:
        K[i, i] += G
        g[i] += G
    return Network(np.array(capacity_J_K, dtype=float), K, g)


def steady(network: Network, heat_W: FloatArray, ambient_degC: float) -> FloatArray:
    """Return the temperatures (n,) at rest under heats (n,): K T = g T_amb + q (Yu et al. 2024, eq. 49).

    Raises `numpy.linalg.LinAlgError` where a node has no way to the ambient.
    """
    return np.asarray(
        np.linalg.solve(network.conductance_W_K, network.ambient_W_K * ambient_degC + heat_W), dtype=float
    )


def crank_nicolson(network: Network, dt_s: float) -> Transition:
    """Return one step by Crank and Nicolson: A T⁺ = B T + Δt (g T_amb + q), A, B = C ± Δt K/2.

    Of second order, and stable for any step; nodes that are fast against it swing. Source: Li 2022, eqs. 14
    to 19.
    """
    capacity, half = np.diag(network.capacity_J_K), 0.5 * dt_s * network.conductance_W_K
    E = np.asarray(dt_s * np.linalg.inv(capacity + half), dtype=float)
    return Transition(C=E @ (capacity - half) / dt_s, D=E @ network.ambient_W_K, E=E)


def node_modes(network: Network) -> NodeModes:
    """Return the network's modes: with S = C^{-1/2} K C^{-1/2} = U Λ Uᵀ, T = C^{-1/2} U D ξ.

    D scales each mode to 1 at its largest place, so that a node by itself keeps its temperature as its state.
    """
    root = np.sqrt(network.capacity_J_K)
    if not len(root):
        none = np.zeros((0, 0))
        return NodeModes(np.zeros(0), none, none, none, np.zeros(0))
    rates, U = np.linalg.eigh(network.conductance_W_K / np.multiply.outer(root, root))
    rates = np.where(rates > ROUNDING * np.abs(rates).max(initial=0.0), rates, 0.0)
    shape = U / root[:, None]
    largest = shape[np.argmax(np.abs(shape), axis=0), np.arange(len(root))]
    shape, inverse = shape / largest, largest[:, None] * U.T * root
    into = inverse / network.capacity_J_K
    return NodeModes(rates, shape, inverse, into, into @ network.ambient_W_K)
