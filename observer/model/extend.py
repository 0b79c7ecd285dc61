"""A plant with more states than screw and sources have: nodes beside the screw, sensors that lag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.model.network.network import Attached, NodeModes
from observer.model.plant import Plant
from observer.tables.sections import Description


class States(NamedTuple):
    """e states that decay by themselves: `decay_1_s` (e,), input rows `B` (e, m) and `E` (e, p).

    They start at `seen` (e, n_x) of the states before them, give or take `prior_P` (e, e), of which
    `smooth_P` (e, e) is there with a machine at rest too; `uniform` (e,): their values in a machine at 1 °C.
    """

    decay_1_s: FloatArray
    B: FloatArray
    E: FloatArray
    seen: FloatArray
    prior_P: FloatArray
    smooth_P: FloatArray
    uniform: FloatArray


def node_states(
    plant: Plant,
    beside: Attached,
    own: NodeModes,
    places: FloatArray,
    mean: FloatArray,
    past_P: FloatArray,
) -> States:
    """Return the states of the nodes' own modes.

    A node starts at the temperature of the screw where it touches it, `places` (m, n_x), else at the
    screw's mean (n_x,): give or take as much as that itself, and what heats before the start have left,
    `past_P` (n, n).
    """
    n = len(beside.names)
    start = np.tile(mean, (n, 1))
    for node, source, _ in beside.ties:
        start[node] = places[source]
    apart = np.diag(np.einsum("ia,ab,ib->i", start, plant.smooth_P, start))
    E = np.zeros((n, len(plant.known_names)))
    E[:, plant.known.ambient] = own.ambient
    return States(
        decay_1_s=own.decay_1_s,
        B=own.input @ beside.shares,
        E=E,
        seen=own.inverse @ start,
        prior_P=own.inverse @ (apart + past_P) @ own.inverse.T,
        smooth_P=own.inverse @ apart @ own.inverse.T,
        uniform=own.inverse.sum(axis=1),
    )


def lag_states(seen: FloatArray, sources: int, known: int) -> States:
    """Return the states of sensors that lag behind `seen` (e, n_x), at which they start."""
    e = len(seen)
    none = np.zeros((e, e))
    return States(np.zeros(e), np.zeros((e, sources)), np.zeros((e, known)), seen, none, none, np.ones(e))


def extended(plant: Plant, more: States) -> Plant:
    """Return the plant with more states at its end."""
    if not len(more.seen):
        return plant
    first = len(plant.decay_1_s)
    n_x = first + len(more.seen)
    J = np.vstack([np.eye(first), more.seen])
    prior, smooth = J @ plant.prior_P @ J.T, J @ plant.smooth_P @ J.T
    prior[first:, first:] += more.prior_P
    smooth[first:, first:] += more.smooth_P
    return replace(
        plant,
        decay_1_s=np.concatenate([plant.decay_1_s, more.decay_1_s]),
        B=np.vstack([plant.B, more.B]),
        E=np.vstack([plant.E, more.E]),
        rows=replace(plant.rows, C=wide(plant.rows.C, n_x)),
        moving=tuple(  # they heat the new states too, wherever they are
            s.with_table(mean_B=np.concatenate([s.table.mean_B, more.B[:, s.index]])) for s in plant.moving
        ),
        uniform=np.concatenate([plant.uniform, more.uniform]),
        prior_P=prior,
        smooth_P=smooth,
        field_noise_Q=np.pad(plant.field_noise_Q, (0, n_x - first)),
    )


def reading_nodes(plant: Plant, machine: Description, beside: Attached, own: NodeModes, first: int) -> Plant:
    """Return the plant whose sensors on nodes read those; the nodes' states begin at `first`."""
    on = {i: beside.names.index(s.on) for i, s in enumerate(machine.sensor) if s.on is not None}
    plant = _reading_no_more(plant, list(on))
    for sensor, node in on.items():
        plant.rows.C[sensor, first : first + len(beside.names)] = own.shape[node]
    return plant


def lagging(plant: Plant, sensors: Sequence[int]) -> Plant:
    """Return the plant whose `sensors` read the last states, one each."""
    plant = _reading_no_more(plant, sensors)
    for i, sensor in enumerate(sensors):
        plant.rows.C[sensor, plant.rows.C.shape[1] - len(sensors) + i] = 1.0
    return plant


def padded(vector: FloatArray, size: int) -> FloatArray:
    """Return the vector with zeros behind it."""
    return np.concatenate([vector, np.zeros(size - len(vector))])


def wide(matrix: FloatArray, columns: int) -> FloatArray:
    """Return the matrix with columns of zeros behind it."""
    return np.hstack([matrix, np.zeros((len(matrix), columns - matrix.shape[1]))])


def _reading_no_more(plant: Plant, sensors: Sequence[int]) -> Plant:
    """The plant whose `sensors` see no state and no input any more, but for their own offsets."""
    C, F = plant.rows.C.copy(), plant.rows.F.copy()
    C[list(sensors)] = 0.0
    F[list(sensors)] = np.where(plant.known.offset, F[list(sensors)], 0.0)
    moving = tuple(
        s.with_table(mean_C=_without(s.table.mean_C, sensors), table_C=_without(s.table.table_C, sensors))
        for s in plant.moving
    )
    return replace(plant, rows=replace(plant.rows, C=C, F=F), moving=moving)


def _without(columns: FloatArray, sensors: Sequence[int]) -> FloatArray:
    """A lag's output column, or a table of them, with those sensors' entries at zero."""
    out = columns.copy()
    out[..., list(sensors)] = 0.0
    return out
