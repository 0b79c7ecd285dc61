"""Uncertain parameters of the bodies beside the screw.

They are the conductance of each link, the heat capacity of each node, and the division of a source's heat
between nodes and screw.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from observer.config.effects.terms import Term
from observer.config.machine import Config
from observer.config.sections import AMBIENT, Link
from observer.frames import FloatArray
from observer.model.extend import wide, with_learning
from observer.model.generator import Constant, generator
from observer.model.learning import Change, Nuisance, Parameter, no_change
from observer.model.network import (
    NodeModes,
    Shapes,
    attached,
    conductance_W_K,
    exchanges_of,
    node_modes,
    shapes_of_strokes,
)
from observer.model.plant import Plant
from observer.model.reduce import FullModel
from observer.model.rod.modes import Modes


def with_rough_network(
    plant: Plant,
    config: Config,
    described: Sequence[Link],
    terms: Sequence[Term],
    constant: Constant,
    full: FullModel,
    modes: Modes,
) -> Plant:
    """Return a plant with nodes, with all the parameters that its estimator learns or considers.

    Args:
        plant: The model with its couplings, not yet in its own modes.
        config: The machine, whose links lead to places on the screw.
        described: Links as configured, which lead to the sources there and carry tolerances and names.
        terms: Terms of the effects.
        constant: Constant couplings that are added to the plant's generator.
        full: The full model.
        modes: Modes of the screw.
    """
    bodies = attached(config, terms)
    network_modes = node_modes(bodies.network)
    shapes = list(shapes_of_strokes(modes, exchanges_of(config, bodies)))
    node_states = _NodeStates(plant, config, network_modes, shapes)
    rough = [
        *node_states.links(config, described),
        *node_states.capacities(config, constant),
        *node_states.divisions(config),
    ]
    plant = with_learning(plant, config, full, modes, rough)
    if plant.learning is None or node_states.apart:
        return plant
    arrays = plant.learning.arrays.described_on(node_states.temperatures, node_states.inverse)
    return replace(plant, learning=replace(plant.learning, arrays=arrays))


class _NodeStates:
    """The nodes among the states of a plant.

    With V = `temperatures` (n_x, n_x) and its `inverse`, V x has the temperature of each node as a state. If
    the nodes are `apart`, without links to each other, each already is a state.
    """

    def __init__(
        self, plant: Plant, config: Config, network_modes: NodeModes, shapes: Sequence[Shapes]
    ) -> None:
        n_x, nodes, first = len(plant.decay_1_s), len(network_modes.shape), plant.lag_slice.stop
        node_slice = slice(first, first + nodes)
        self._plant, self._names, self._shapes = plant, [n.name for n in config.node], shapes
        self._read, self._into = np.zeros((nodes, n_x)), np.zeros((nodes, n_x))
        self._read[:, node_slice], self._into[:, node_slice] = network_modes.shape, network_modes.input.T
        self.temperatures, self.inverse = np.eye(n_x), np.eye(n_x)
        self.temperatures[node_slice, node_slice], self.inverse[node_slice, node_slice] = (
            network_modes.shape,
            network_modes.inverse,
        )
        self.apart = bool((np.count_nonzero(network_modes.shape, axis=1) == 1).all())
        self._first = first

    def links(self, config: Config, described: Sequence[Link]) -> Iterator[Parameter]:
        """Yield a parameter for each link: the relative error of its conductance.

        Links to moving nuts are numbered as in the plant's coupling.
        """
        moving, tied = [self._plant.source_names[m.index] for m in self._plant.moving], 0
        for link, described_link in zip(config.link, described, strict=True):
            sigma, name = config.tolerance.of_link(described_link.tolerance), f"{described_link.key}.factor"
            change = self._passing(link)
            if not set(link.between).isdisjoint(moving):
                change, tied = change._replace(link=tied), tied + 1
            yield Parameter(
                Nuisance.LINK, 0, sigma, change, name, described_link.factor, described_link.factor
            )

    def capacities(self, config: Config, constant: Constant) -> Iterator[Parameter]:
        """Yield a parameter for each node: the relative error of its heat capacity."""
        A, E = generator(self._plant) + constant.A, self._plant.E + constant.E
        for i, node in enumerate(config.node):
            sigma, C_J_K = config.tolerance.of_capacity(node.tolerance), node.capacity_J_K
            name = f"node.{node.name}.capacity_J_K"
            yield Parameter(Nuisance.CAPACITY, i, sigma, self._storing(i, C_J_K, A, E), name, C_J_K, C_J_K)

    def divisions(self, config: Config) -> Iterator[Parameter]:
        """Yield a parameter for each source that heats screw and nodes.

        It is the part of the screw's heat that enters the nodes instead.
        """
        unchanged = no_change(len(self._plant.decay_1_s), len(self._plant.known_names))
        for source in config.source:
            if source.nodes and source.screw_share > 0.0:
                shares = [source.nodes.get(name, 0.0) for name in self._names]
                into = np.asarray(shares) @ self._into[: len(shares)] / sum(shares)
                sigma = config.tolerance.division / source.screw_share
                index = self._plant.source_names.index(source.name)
                change = unchanged._replace(into=into, divided=index)
                yield Parameter(Nuisance.DIVISION, index, sigma, change, f"source.{source.name}.division")

    def _passing(self, link: Link) -> Change:
        """The effect of doubling a link's conductance: dx/dt grows by G v d x.

        The row d reads the temperature difference, and the column v is the effect of 1 J passed. A moving nut
        is spread over its stroke.
        """
        plant, G = self._plant, conductance_W_K(link)
        unchanged = no_change(len(plant.decay_1_s), len(plant.known_names))
        first, second = sorted(link.between, key=lambda end: end not in self._names)
        node = self._names.index(first)
        row, into, inputs = self._read[node], -self._into[node], unchanged.inputs.copy()
        if second in self._names:
            other = self._names.index(second)
            row, into = row - self._read[other], into + self._into[other]
        elif second == AMBIENT:
            inputs[plant.known.ambient] = -G * into
        else:
            source = plant.source_names.index(second)
            under, foot = self._under(source)
            row, into = row - under, into + foot
            inputs = -G * np.multiply.outer(plant.coupling.under_F[source], into)
        columns, rows = [G * into], [row]
        for shapes in (s for s in self._shapes if second == plant.source_names[s.source]):
            # a nut exchanges place by place; of its conductances this one is a part
            wide_shape, part = wide(shapes.shape, len(row)), G / shapes.conductance_W_K
            columns += list(-part * shapes.rate_1_s[:, None] * wide_shape)
            rows += list(wide_shape)
        return unchanged._replace(into=np.array(columns), feedback_row=np.array(rows), inputs=inputs)

    def _storing(self, node: int, capacity_J_K: float, A: FloatArray, E: FloatArray) -> Change:
        """The effect of doubling a node's capacity: all its temperature changes are slower."""
        plant, row, into = self._plant, self._read[node], -capacity_J_K * self._into[node]
        state = int(np.argmax(np.abs(row))) if self.apart else self._first + node
        heats = np.zeros(len(row))
        heats[state] = -1.0
        inputs = np.multiply.outer(row @ E, into)
        unchanged = no_change(len(plant.decay_1_s), len(plant.known_names))
        return unchanged._replace(into=into, feedback_row=row @ A, heats=heats, inputs=inputs)

    def _under(self, source: int) -> tuple[FloatArray, FloatArray]:
        """The row (n_x,) that reads the screw under a source, and the effect (n_x,) of 1 J there."""
        plant, c = self._plant, self._plant.coupling
        state = np.arange(len(plant.decay_1_s))
        foot = c.place_gain[source] * np.where(state < plant.lag_slice.stop, plant.B[:, source], 0.0)
        under = c.under_C[source] + c.conductance_W_m * np.where(state < plant.modes, foot, 0.0)
        return under, foot
