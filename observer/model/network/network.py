"""A network of nodes by itself: C dT/dt = −K T + g T_amb + q.

Li 2022, eq. 8, as matrices, and in its own modes, which is how a plant takes it in.
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
