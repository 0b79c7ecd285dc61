"""A network of nodes beside the screw: C dT/dt = −K T + g T_amb + q (Li 2022, eq. 8).

The network as matrices and in its own modes, which the plant uses. The conductance of links by geometry and
material. The exchange of a sweeping nut with a node, place by place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from observer.config.effects.terms import Body, Term, WarmedAir
from observer.config.sections import AMBIENT, Description, Link, Source
from observer.frames import FloatArray
from observer.model.caching import cached
from observer.model.coupling import Spreads
from observer.model.rod.modes import (
    NODES,
    Modes,
    Stretch,
    held_s,
    mean_stretch,
    modal_input,
    nut_stretch,
    quadrature,
    shapes_within,
)


def conductance_W_K(link: Link) -> float:
    """Return the conductance of a link of the configuration, by any description, with its factor."""
    return link.factor * _described_W_K(link)


def _described_W_K(link: Link) -> float:
    given_W_K = link.conductance_W_K or 1.0 / (link.resistance_K_W or math.inf)
    if given_W_K:
        return given_W_K
    area_m2, length_m, k_W_mK = link.area_m2 or 0.0, link.length_m or 0.0, link.conductivity_W_mK or 0.0
    if link.film_W_m2K is not None:
        return film_W_K(link.film_W_m2K, area_m2)
    if link.inner_diameter_m is not None and link.outer_diameter_m is not None:
        return ring_W_K(k_W_mK, length_m, link.inner_diameter_m, link.outer_diameter_m)
    pair = link.conductivities_W_mK or (0.0, 0.0)
    if link.balls is not None and link.semi_axes_m is not None:
        return link.balls * ball_W_K(*pair, *link.semi_axes_m)
    if link.gap_m is not None:
        return gap_W_K(link.gap_m, area_m2, link.touching or 0.0, *pair, link.filling_W_mK)
    return bar_W_K(k_W_mK, length_m, area_m2)


def bar_W_K(conductivity_W_mK: float, length_m: float, area_m2: float) -> float:
    """Return k A/l (Li 2022, eqs. 1 and 3; Yu et al. 2024, §3.1.2)."""
    return conductivity_W_mK * area_m2 / length_m


def ring_W_K(conductivity_W_mK: float, width_m: float, inner_m: float, outer_m: float) -> float:
    """Return 2π k b/ln(d_o/d_i), radially through a ring (Li 2022, eqs. 1 and 2; Yu et al. 2024, §3.1.2)."""
    return 2.0 * math.pi * conductivity_W_mK * width_m / math.log(outer_m / inner_m)


def film_W_K(film_W_m2K: float, area_m2: float) -> float:
    """Return h A of a film, or of a contact whose conductance per area is known (Li 2022, eq. 7)."""
    return film_W_m2K * area_m2


def gap_W_K(
    gap_m: float, area_m2: float, touching: float, first_W_mK: float, second_W_mK: float, filling_W_mK: float
) -> float:
    """Return A [s k* + (1 − s) k_f]/g of two rough faces, k* = 2 k₁ k₂/(k₁ + k₂).

    A part s of the area touches across the gap g, the rest is filled. Source: Li 2022, eq. 6, and with an
    empty gap, k_f = 0, eq. 5.
    """
    harmonic = 2.0 * first_W_mK * second_W_mK / (first_W_mK + second_W_mK)
    return area_m2 * (touching * harmonic + (1.0 - touching) * filling_W_mK) / gap_m


def ball_W_K(ball_W_mK: float, ring_W_mK: float, long_m: float, short_m: float) -> float:
    """Return the conductance of one contact between a ball and a ring, a constriction on both sides.

    R = K/(2π a k_b) + K/(2π a k_r) with the complete elliptic integral K of modulus² 1 − b²/a², a the longer
    semi-axis of the contact ellipse. For a circle R = (1/k_b + 1/k_r)/(4 a). Source: Li 2022, eq. 4, where
    a²/b² stands in the modulus, which makes the resistance b/a times as large.
    """
    from scipy.special import ellipk  # noqa: PLC0415  (start-up: only balls need it)

    a, b = max(long_m, short_m), min(long_m, short_m)
    integral = float(ellipk(1.0 - (b / a) ** 2))
    return 2.0 * math.pi * a / (integral * (1.0 / ball_W_mK + 1.0 / ring_W_mK))


ROUNDING = 1e-13
"""Rates below this part of the largest are rounding errors of 0."""


class Network(NamedTuple):
    """A network of n nodes.

    Attributes:
        capacity_J_K: Heat capacities, (n,).
        conductance_W_K: The matrix K of the links, those to the ambient on its diagonal, (n, n).
        ambient_W_K: Conductances g to the ambient, (n,).
    """

    capacity_J_K: FloatArray
    conductance_W_K: FloatArray
    ambient_W_K: FloatArray


class NodeModes(NamedTuple):
    """The network in its eigenmodes: T = `shape` ξ, ξ = `inverse` T.

    Attributes:
        decay_1_s: Decay rates, (n,).
        shape: Modes in its columns, each at most 1, (n, n).
        inverse: Inverse of `shape`, (n, n).
        input: Effect of 1 J into each node on ξ, (n, n).
        ambient: Effect of the ambient's temperature on ξ, 1/s, (n,).
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

    D scales each mode to 1 at its largest place, so that an isolated node has its temperature as its state.
    """
    root = np.sqrt(network.capacity_J_K)
    if not len(root):
        empty = np.zeros((0, 0))
        return NodeModes(np.zeros(0), empty, empty, empty, np.zeros(0))
    rates, U = np.linalg.eigh(network.conductance_W_K / np.multiply.outer(root, root))
    rates = np.where(rates > ROUNDING * np.abs(rates).max(initial=0.0), rates, 0.0)
    shape = U / root[:, None]
    largest = shape[np.argmax(np.abs(shape), axis=0), np.arange(len(root))]
    shape, inverse = shape / largest, largest[:, None] * U.T * root
    into = inverse / network.capacity_J_K
    return NodeModes(rates, shape, inverse, into, into @ network.ambient_W_K)


class Attached(NamedTuple):
    """A network beside the screw.

    Attributes:
        names: Names of the nodes, (n,).
        network: The network without the screw.
        shares: Share of each source's heat in each node, (n, m).
        ties: Links to the screw at a source: node, source, W/K.
        air: The nodes that are air along a stretch of the screw.
    """

    names: tuple[str, ...]
    network: Network
    shares: FloatArray
    ties: tuple[tuple[int, int, float], ...]
    air: tuple[tuple[int, WarmedAir], ...]

    @property
    def with_screw_at_ambient(self) -> Network:
        """The network with the screw at ambient temperature at every link."""
        to_ambient = np.zeros(len(self.names))
        for node, _, G in self.ties:
            to_ambient[node] += G
        K, g = self.network.conductance_W_K + np.diag(to_ambient), self.network.ambient_W_K + to_ambient
        return Network(self.network.capacity_J_K, K, g)


def attached(machine: Description, terms: Sequence[Term]) -> Attached:
    """Return the nodes of a machine, then one for each body and each warmed air of its effects."""
    bodies = [t for t in terms if isinstance(t, Body | WarmedAir)]
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
    for i, body in enumerate(bodies, start=len(names)):
        if isinstance(body, Body):
            ties.append((i, sources.index(body.source), body.conductance_W_K))
        to_ambient.append((i, body.loss_W_K))
    capacity = [n.capacity_J_K for n in machine.node] + [b.capacity_J_K for b in bodies]
    shares = np.zeros((len(capacity), len(sources)))
    for j, source in enumerate(machine.source):
        for name, share in source.nodes.items():
            shares[names.index(name), j] = share
    for i, body in enumerate(bodies):
        shares[len(names) + i, sources.index(body.source)] = body.heated
    air = [(i, b) for i, b in enumerate(bodies, start=len(names)) if isinstance(b, WarmedAir)]
    all_names = (*names, *(f"body at {b.source}" for b in bodies))
    return Attached(all_names, assemble(capacity, links, to_ambient), shares, tuple(ties), tuple(air))


def past_covariance(
    bodies: Attached, sigma_W: FloatArray, length_m: float, diffusivity_m2_s: float
) -> FloatArray:
    """Covariance (n, n), K², of the nodes' temperatures left by heats of unknown size before the start.

    As `past_heat_covariance` for the screw, which has the ambient's temperature here. `sigma_W` (m,) are the
    σ of the heats.
    """
    modes = node_modes(bodies.with_screw_at_ambient)
    covariance = np.zeros((len(bodies.names), len(bodies.names)))
    for gathered in gathered_s(modes.decay_1_s, length_m, diffusivity_m2_s):
        response = modes.shape @ (gathered * (modes.input @ (bodies.shares * sigma_W)))
        covariance += response @ response.T
    return covariance


SMALL = 1e-6
"""Rates of shapes below this part of the largest are neglected."""
NO_SWEEP = 0.05
"""Relative difference of stroke and nut length below which the nut counts as standing."""
STANDING_PLACES = 9


class Exchange(NamedTuple):
    """The exchange of a nut with its nodes, spread over the stroke that it sweeps.

    Attributes:
        source: Number of the nut's source.
        conductance_W_K: Conductance to all nodes together.
        stroke: The stroke.
    """

    source: int
    conductance_W_K: float
    stroke: Stretch


def exchanges_of(machine: Description, bodies: Attached) -> tuple[Exchange, ...]:
    """Return the exchange of each nut that sweeps over a stroke and is tied to nodes."""
    exchanges = []
    for j, source in enumerate(machine.source):
        G = sum(tie for _, place, tie in bodies.ties if place == j)
        if source.shape != "nut" or G == 0.0:
            continue
        stroke = mean_stretch(source, machine.screw)
        if abs(stroke.width_m - (source.length_m or 0.0)) >= NO_SWEEP * stroke.width_m:
            exchanges.append(Exchange(j, G, stroke))
    return tuple(exchanges)


class Shapes(NamedTuple):
    """The exchange of a sweeping nut with its nodes, as orthonormal shapes that decay.

    Attributes:
        source: Number of the nut's source.
        conductance_W_K: Conductance to all nodes together.
        rate_1_s: Decay rates, (e,).
        shape: The shapes, (e, N).
        swept: Squared size of the nut's column over the whole stroke.
    """

    source: int
    conductance_W_K: float
    rate_1_s: FloatArray
    shape: FloatArray
    swept: float


def shapes_of_strokes(modes: Modes, exchanges: Sequence[Exchange]) -> Iterator[Shapes]:
    """Yield the exchange of sweeping nuts beyond the exchange at the mean temperature.

    Each place under the nut exchanges separately (Li 2022, eq. 45). Over a stroke swept evenly, w = 1/stroke,
    the modes lose G/(kA) ∫ w θ_i θ_j dx. The mean temperature carries G/(kA) ∫ w θ_i dx ∫ w θ_j dx of that.
    """
    kA = modes.rod.conductance_W_m
    for j, G, stroke in exchanges:
        theta, weights = shapes_within(modes, stroke)
        weights = weights / stroke.width_m
        mean = weights @ theta
        eigenvalues, shape = np.linalg.eigh(
            (theta * weights[:, None]).T @ theta - np.multiply.outer(mean, mean)
        )
        is_large = eigenvalues > SMALL * eigenvalues.max()
        yield Shapes(j, G, G / kA * eigenvalues[is_large], shape[:, is_large].T, float(mean @ mean) / kA**2)


def spreads(
    modes: Modes, machine: Description, exchanges: Sequence[Exchange], moving: Sequence[int]
) -> Spreads:
    """Return the shapes of the sources that are `moving`."""
    m = len(machine.source)
    swept, at_rest = np.zeros(m), np.ones(m)
    sweeping = [s for s in shapes_of_strokes(modes, exchanges) if s.source in moving]
    for s in sweeping:
        source = machine.source[s.source]
        swept[s.source] = s.swept
        at_rest[s.source] = _at_rest(modes, source, mean_stretch(source, machine.screw))
    shape = np.vstack([np.zeros((0, len(modes))), *(s.shape for s in sweeping)])
    return Spreads(
        np.array(
            [sum(len(s.rate_1_s) for s in sweeping if s.source < j) for j in range(m + 1)], dtype=np.int64
        ),
        np.concatenate([np.zeros(0), *(s.rate_1_s for s in sweeping)]),
        shape,
        shape,
        swept,
        at_rest,
    )


def _at_rest(modes: Modes, source: Source, stroke: Stretch) -> float:
    """The squared size of the input column of a nut that stands, mean over its stroke."""
    nut_m, L = source.length_m or 0.0, modes.rod.length_m
    places = np.linspace(stroke.a_m, stroke.b_m, STANDING_PLACES).tolist()
    return float(np.mean([np.sum(modal_input(modes, nut_stretch(x, nut_m, L)) ** 2) for x in places]))


SMOOTHNESS = 0.25
"""Correlation length of an unknown field, as a part of the screw's length."""
PAST = (1e-3, 1e-2, 1e-1)
"""How long sources may have been on before the start, in diffusion times L²/α (a minute to hours on 1 m)."""


@cached(8)
def smooth_field_covariance(modes: Modes) -> FloatArray:
    """Covariance (N, N) of the modal amplitudes of a random field with 1 K standard deviation everywhere.

    Half of its variance is an unknown level, half an unknown shape, smooth over a quarter of the screw.
    """
    x, w = quadrature(modes.rod.length_m, (), panels=max(24, len(modes) // 2))
    kernel = _smooth_kernel(len(x), modes.rod.length_m)
    projection = (modes.theta(x) * (w * modes.rod.area_at(x))[:, None]).T / modes.rod.diffusivity_m2_s
    covariance = projection @ kernel @ projection.T
    return np.asarray((covariance + covariance.T) / 2)


@lru_cache(maxsize=4)
def _smooth_kernel(nodes: int, length_m: float) -> FloatArray:
    """The field's covariance between the nodes of the quadrature; the same for every material and film."""
    x, _ = quadrature(length_m, (), panels=nodes // NODES)
    return np.asarray(0.5 + 0.5 * np.exp(-0.5 * ((x[:, None] - x) / (SMOOTHNESS * length_m)) ** 2))


def past_heat_covariance(modes: Modes, inputs: FloatArray, sigma_W: FloatArray) -> FloatArray:
    """Covariance (N, N) of the modal amplitudes left by heats of unknown size before the start.

    A machine that has been running is not smoothly warm: the screw is hottest at the bearings. Each source
    was on for each of three times, independently, with the σ of its unknown heat now. Its effect is r_n = b_n
    (1 − e^{−Λ_n t})/Λ_n. `inputs` (N, m) are the sources in units of B, `sigma_W` (m,) the σ.
    """
    covariance = np.zeros((len(modes), len(modes)))
    for gathered in gathered_s(modes.decay_1_s, modes.rod.length_m, modes.rod.diffusivity_m2_s):
        response = inputs * gathered * sigma_W
        covariance += response @ response.T
    return covariance


def gathered_s(decay_1_s: FloatArray, length_m: float, diffusivity_m2_s: float) -> Iterator[FloatArray]:
    """Yield the response of modes (n, 1), s, to an input of 1 after each of the times in `PAST`."""
    decay = decay_1_s[:, None]
    for share in PAST:
        t = share * length_m**2 / diffusivity_m2_s
        yield held_s(decay, t)
