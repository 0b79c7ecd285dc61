"""A nut's columns over the ticks of a run, for any modes.

The input column of a mode cos(μ x − φ) is the mean of that cosine over the places that the nut covers: a
smooth function of μ, which a table at evenly spaced μ gives to a millionth. So the path is followed once, and
a hypothesis that changes the modes costs a product of matrices.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.fit.runs import Run, mean_over
from observer.frames import FloatArray
from observer.model.rod import moving
from observer.model.rod.moving import NutTable
from observer.model.rod.static import Stretch

PER_MODE = 4
"""Tabulated wave numbers per π/L."""
NEIGHBOURS = 8
"""How many of them an interpolation takes."""
PLACES = 33
"""Places along the screw among which the nut's time in a tick is shared out."""


class Footprint(NamedTuple):
    """What a nut's path leaves in the ticks of a run, for G tabulated wave numbers.

    `waves` (T, 2G): the mean over each tick, weighted by the nut's heat, of cos(μ(x − L/2)) and of its sine;
    `early_s` (T, 2G): ∫ of them × (½ − t/τ) dt over each tick of length τ, how much earlier than evenly they
    came.
    """

    step_1_m: float
    waves: FloatArray
    early_s: FloatArray

    def of_modes(self, table: NutTable) -> tuple[FloatArray, FloatArray]:
        """The means (T, N) of a table's columns over the ticks, and how much earlier (T, N) they came."""
        G = self.waves.shape[1] // 2
        to_modes = interpolation(table.mu_1_m / self.step_1_m, G)
        turned = table.mu_1_m * table.screw_m / 2 - table.phase
        scale = table.scale / table.conductance_W_m
        weights = np.vstack([to_modes * (scale * np.cos(turned)), to_modes * (-scale * np.sin(turned))])
        return self.waves @ weights, self.early_s @ weights


def swept(table: NutTable, present: FloatArray, out: FloatArray) -> None:
    """Fill `out` (T, PLACES, N) with shapes of which the squares add up to the covariance of a nut's column
    over a tick, of which it spends the shares `present` (T, PLACES) at places from end to end.
    """
    places_m = np.linspace(0.0, table.screw_m, PLACES).tolist()
    columns = np.array([moving.columns_at(table, [x])[0][: len(table.mu_1_m)] for x in places_m])
    np.subtract(columns, (present @ columns)[:, None], out=out)
    out *= np.sqrt(present)[:, :, None]


def footprint(
    run: Run,
    first: NDArray[np.int64],
    table: NutTable,
    highest: int,
    channel: str,
    stroke: Stretch,
    weight: FloatArray,
    *,
    at_ends: bool = False,
) -> Footprint:
    """Follow a nut's path through the ticks that begin at the rows `first` (T,), for modes up to number
    `highest`, counted from 1.

    `stroke` is the stretch it counts as spread over while its place is not known; `weight` (K,) how much
    each row counts; `at_ends` that the nut is taken to stand at both ends of its real stroke.
    """
    frames, step_1_m = run.frames, np.pi / (table.screw_m * PER_MODE)
    waves, path = _wave_table(table, highest, step_1_m, stroke), frames.path[channel]
    rows = moving.from_unknown(waves, frames.dt_s, path, at_ends=at_ends)[0][:, :-1]
    count = np.diff([*first, len(frames)])
    number = np.repeat(np.arange(len(first)), count)
    begin_s = np.append(frames.time_s[0], frames.time_s[first[1:] - 1])[number]
    length_s = np.maximum(np.add.reduceat(frames.dt_s, first), 1e-9)
    middle = (frames.time_s - frames.dt_s / 2 - begin_s) / length_s[number]
    early_s = np.add.reduceat(rows * (frames.dt_s * (0.5 - middle))[:, None], first)
    return Footprint(step_1_m, mean_over(rows, weight, first), early_s)


def interpolation(place: FloatArray, size: int) -> FloatArray:
    """Weights (size, N) that interpolate at `place` (N,), in units of the table's steps, by polynomials."""
    begin = np.clip(np.floor(place).astype(np.int64) - NEIGHBOURS // 2 + 1, 0, size - NEIGHBOURS)
    nodes = np.arange(NEIGHBOURS)
    apart = (place - begin)[:, None, None] - np.where(np.eye(NEIGHBOURS, dtype=bool), 0.0, nodes)
    away = nodes[:, None] - nodes
    others = np.where(np.eye(NEIGHBOURS, dtype=bool), 1.0, apart / np.where(away == 0, 1, away))
    weights = np.zeros((size, len(place)))
    weights[begin[:, None] + nodes, np.arange(len(place))[:, None]] = others.prod(axis=2)
    return weights


def _wave_table(table: NutTable, highest: int, step_1_m: float, stroke: Stretch) -> NutTable:
    """The table of a nut whose modes are the tabulated waves: cosines, then sines, about the middle (see
    `kernels.moving.add_waves`).
    """
    G = highest * PER_MODE + 1 + 2 * NEIGHBOURS  # mode n lies within [n − 1, n] π/L, whatever the ends
    mu = np.tile(step_1_m * np.arange(G), 2)
    waves = replace(
        table,
        mu_1_m=mu,
        phase=np.zeros(0),
        lag=2 * G,
        table_C=np.zeros((2, 0)),
        mean_B=np.zeros(2 * G + 1),
        mean_C=np.zeros(0),
        turn=np.zeros((0, 0)),
    )
    whole = replace(waves, nut_m=stroke.width_m)
    return replace(waves, mean_B=moving.columns_at(whole, [(stroke.a_m + stroke.b_m) / 2])[0])


def presence(
    run: Run, first: NDArray[np.int64], table: NutTable, channel: str, stroke: Stretch
) -> FloatArray:
    """Return the share (T, PLACES) of each tick that a nut spends at places from end to end.

    A place between two counts for both, the nearer the more.
    """
    share = np.eye(PLACES)
    anywhere = np.linspace(stroke.a_m, stroke.b_m, 4 * PLACES) / table.screw_m * (PLACES - 1)
    even = np.mean([np.interp(anywhere, np.arange(PLACES), row) for row in share], axis=1)
    at_once = 1e9
    table = replace(table.of_lag(), lag_decay_1_s=at_once, table_C=share, mean_C=even)
    rows = moving.from_unknown(table, run.frames.dt_s, run.frames.path[channel])[1]
    return mean_over(rows, run.frames.dt_s, first)
