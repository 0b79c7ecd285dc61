"""A network of nodes beside the screw: C dT/dt = −K T + g T_amb + q.

Li 2022, eq. 8, as matrices, and in its own modes, which is how a plant takes it in.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer.effects.terms import Body, Term
from observer.frames import FloatArray
from observer.model.network.resistance import conductance_W_K
from observer.model.prior import gathered_s
from observer.tables.nodes import AMBIENT
from observer.tables.sections import Description

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


class Attached(NamedTuple):
    """A network beside the screw: its `names` (n,), the `network` by itself, what each source's heat brings
    into each node, `shares` (n, m), and the `ties` (node, source, W/K) to the screw where a source stands.
    """

    names: tuple[str, ...]
    network: Network
    shares: FloatArray
    ties: tuple[tuple[int, int, float], ...]

    @property
    def held(self) -> Network:
        """The network with the screw, wherever it touches that, at ambient temperature."""
        to_ambient = np.zeros(len(self.names))
        for node, _, G in self.ties:
            to_ambient[node] += G
        K, g = self.network.conductance_W_K + np.diag(to_ambient), self.network.ambient_W_K + to_ambient
        return Network(self.network.capacity_J_K, K, g)


def attached(machine: Description, terms: Sequence[Term]) -> Attached:
    """Return the nodes of a machine, then one for each body of its effects."""
    bodies = [t for t in terms if isinstance(t, Body)]
    names = [n.name for n in machine.node]
    sources = [s.name for s in machine.source]
    links, to_ambient, ties = [], [], []
    for link in machine.link:
        G = conductance_W_K(link)
        first, second = sorted(link.between, key=lambda end: names.index(end) if end in names else len(names))
        if second in names:
            links.append((names.index(first), names.index(second), G))
        elif second == AMBIENT:
            to_ambient.append((names.index(first), G))
        else:
            ties.append((names.index(first), sources.index(second), G))
    for i, body in enumerate(bodies):
        ties.append((len(names) + i, sources.index(body.source), body.conductance_W_K))
        to_ambient.append((len(names) + i, body.loss_W_K))
    capacity = [n.capacity_J_K for n in machine.node] + [b.capacity_J_K for b in bodies]
    shares = np.zeros((len(capacity), len(sources)))
    for j, source in enumerate(machine.source):
        for name, share in source.nodes.items():
            shares[names.index(name), j] = share
    for i, body in enumerate(bodies):
        shares[len(names) + i, sources.index(body.source)] = body.heated
    all_names = (*names, *(f"body at {b.source}" for b in bodies))
    return Attached(all_names, assemble(capacity, links, to_ambient), shares, tuple(ties))


def past_covariance(
    beside: Attached, sigma_W: FloatArray, length_m: float, diffusivity_m2_s: float
) -> FloatArray:
    """Covariance (n, n), K², of the nodes' temperatures left by heats of unknown size before the start.

    As `prior.past_heat_covariance` for the screw, which is held at ambient temperature here; `sigma_W` (m,).
    """
    modes = node_modes(beside.held)
    covariance = np.zeros((len(beside.names), len(beside.names)))
    for gathered in gathered_s(modes.decay_1_s, length_m, diffusivity_m2_s):
        response = modes.shape @ (gathered * (modes.input @ (beside.shares * sigma_W)))
        covariance += response @ response.T
    return covariance
