"""A run in the steps of a prediction: its rows or, thousands of times in a search, ticks of ten seconds.

Heats, losses and the nut's columns are averaged over each tick, so their energy is that of the rows. Known
inputs are taken at its ends. Predictions are compared as means over three ticks. Each tick contributes its
mean at the time of its values.

The input column of a mode cos(μ x − φ) is the mean of that cosine over the positions that the nut covers.
This is a smooth function of μ, which a table at evenly spaced μ gives to a millionth. So the path is followed
once, and a hypothesis that changes the modes costs a product of matrices.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from observer.config.effects.terms import INPUT_TERMS, SpeedLoss
from observer.config.laws import HeatLaw
from observer.config.machine import Config
from observer.config.sections import Source
from observer.fit.runs import TICK_S, Run, mean_over, means_of, rows_of, ticks_of
from observer.frames import FloatArray, Inputs
from observer.model.drive import Drive, Driving
from observer.model.plant import MovingSource, Plant
from observer.model.realise import realise
from observer.model.rod import moving
from observer.model.rod.modes import Stretch, mean_stretch
from observer.model.rod.moving import NutTable
from observer.model.simulate import Means

PER_MODE = 4
"""Tabulated wave numbers per π/L."""
NEIGHBOURS = 8
"""Number of them that an interpolation takes."""
PLACES = 33
"""Positions along the screw among which the nut's time in a tick is distributed."""
PARTS, POINT_M = 32, 1e-6
"""Number of parts of a nut that exchanges place by place, and the length of a place."""


class Footprint(NamedTuple):
    """A nut's path over the T ticks of a run, for G tabulated wave numbers.

    Attributes:
        step_1_m: Distance of the wave numbers, 1/m.
        waves: Means over each tick, weighted by the nut's heat, of cos(μ(x − L/2)) and then of its sine, (T,
            2G).
        early_s: ∫ of them × (½ − t/τ) dt over each tick of length τ, s, (T, 2G). It is positive where they
            come early in the tick.
    """

    step_1_m: float
    waves: FloatArray
    early_s: FloatArray

    def of_modes(self, table: NutTable) -> tuple[FloatArray, FloatArray]:
        """Return the footprint on a plant's modes.

        Args:
            table: Table of the nut with N wave numbers and phases.

        Returns:
            The input columns over the ticks, (T, N), and their `early_s`, s, (T, N).
        """
        G = self.waves.shape[1] // 2
        to_modes = interpolation(table.mu_1_m / self.step_1_m, G)
        turned = table.mu_1_m * table.screw_m / 2 - table.phase
        scale = table.scale / table.conductance_W_m
        weights = np.vstack([to_modes * (scale * np.cos(turned)), to_modes * (-scale * np.sin(turned))])
        return self.waves @ weights, self.early_s @ weights


def swept(plant: Plant, table: NutTable, present: FloatArray, out: FloatArray) -> None:
    """Fill in shapes whose squares add up to the covariance, over a tick, of the column of a place under a
    nut.

    Each place under the nut exchanges heat with the place of the screw it covers (Li 2022, eq. 45).

    Args:
        plant: The model.
        table: Table of the nut.
        present: Share of each tick that the nut spends at places from end to end, (T, PLACES).
        out: Result, (T, PLACES, N), overwritten.
    """
    places_m = np.linspace(0.0, table.screw_m, PLACES).tolist()
    one_place = replace(table, nut_m=POINT_M)
    columns = np.array([moving.columns_at(one_place, [x])[0] for x in places_m])
    columns = columns if plant.basis is None else columns @ plant.basis.V.T
    columns = np.ascontiguousarray(columns[:, : plant.modes])
    under = present @ _under_nut(table.nut_m, table.screw_m)
    np.subtract(columns, (under @ columns)[:, None], out=out)
    out *= np.sqrt(under)[:, :, None]


def _under_nut(nut_m: float, screw_m: float) -> FloatArray:
    """Return the share (PLACES, PLACES) of a nut at one place that is over each.

    The share between two places is divided among them, which spreads it by a sixth of their squared distance,
    as in `presence`. The nut is taken to be so much shorter that its spread is that of the whole.
    """
    apart_m = screw_m / (PLACES - 1)
    length_m = math.sqrt(max(nut_m**2 - 12 * 2 * apart_m**2 / 6, 0.0))
    along_m = length_m * (np.arange(PARTS) + 0.5 - PARTS / 2) / PARTS
    places_m = np.linspace(0.0, screw_m, PLACES)
    at = np.clip(places_m[:, None] + along_m, 0.0, screw_m) / apart_m
    near = np.maximum(1.0 - np.abs(at[:, :, None] - np.arange(PLACES)), 0.0)
    return np.asarray(near.mean(axis=1))


def footprint(
    run: Run,
    first: NDArray[np.int64],
    nut: MovingSource,
    highest: int,
    stroke: Stretch,
    weight: FloatArray,
    *,
    at_ends: bool = False,
) -> Footprint:
    """Return a nut's path through the ticks of a run.

    Args:
        run: The prepared log.
        first: First row of each tick, (T,).
        nut: The moving source.
        highest: Highest mode, counted from 1, that the result serves.
        stroke: Stretch that the nut is spread over while its position is unknown.
        weight: Weight of each row, (K,).
        at_ends: Whether the nut is placed at both ends of its actual stroke, for heat at the reversals.
    """
    frames, step_1_m = run.frames, np.pi / (nut.table.screw_m * PER_MODE)
    waves, path = _wave_table(nut.table, highest, step_1_m, stroke), frames.path[nut.channel]
    rows = moving.from_unknown(waves, frames.dt_s, path, at_ends=at_ends)[0][:, :-1]
    count = np.diff([*first, len(frames)])
    number = np.repeat(np.arange(len(first)), count)
    begin_s = np.append(frames.time_s[0], frames.time_s[first[1:] - 1])[number]
    length_s = np.maximum(np.add.reduceat(frames.dt_s, first), 1e-9)
    middle = (frames.time_s - frames.dt_s / 2 - begin_s) / length_s[number]
    early_s = np.add.reduceat(rows * (frames.dt_s * (0.5 - middle))[:, None], first)
    return Footprint(step_1_m, mean_over(rows, weight, first), early_s)


def interpolation(place: FloatArray, size: int) -> FloatArray:
    """Return weights that interpolate a table by polynomials over eight neighbours.

    Args:
        place: Places to interpolate at, in steps of the table, (N,).
        size: Number of entries of the table.

    Returns:
        Weights (size, N), which add up to 1 for each place.
    """
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
    """Return the share of each tick that a nut spends at places from end to end, (T, PLACES).

    A position between two places is shared linearly.

    Args:
        run: The prepared log.
        first: First row of each tick, (T,).
        table: Table of the nut.
        channel: Its position channel.
        stroke: Stretch that the nut is spread over while its position is unknown.
    """
    share = np.eye(PLACES)
    anywhere = np.linspace(stroke.a_m, stroke.b_m, 4 * PLACES) / table.screw_m * (PLACES - 1)
    even = np.mean([np.interp(anywhere, np.arange(PLACES), row) for row in share], axis=1)
    at_once = 1e9
    table = replace(table.of_lag(), lag_decay_1_s=at_once, table_C=share, mean_C=even)
    rows = moving.from_unknown(table, run.frames.dt_s, run.frames.path[channel])[1]
    return mean_over(rows, run.frames.dt_s, first)


Value = TypeVar("Value")


class Cache(Generic[Value]):
    """The most recently used results of a pure function, by key.

    Args:
        most: Number of results that are stored; the one unused for longest goes first.
    """

    def __init__(self, most: int) -> None:
        self._most, self._store = most, dict[Hashable, Value]()

    def get(self, key: Hashable, work_out: Callable[[], Value]) -> Value:
        """Return the result for a key; `work_out` is called only if it is not stored."""
        value = self._store.pop(key) if key in self._store else work_out()
        self._store[key] = value
        if len(self._store) > self._most:
            del self._store[next(iter(self._store))]
        return value


MOST_KEPT, MOST_ROWS_KEPT = 16, 2


class SteppedRun:
    """A run with its inputs for any configuration, in ticks or row by row.

    For ticks the nuts' paths are followed once, each row weighted by the nut's heat in the initial
    configuration. Row by row is exact and, with close rows, some tens of times slower.

    Args:
        run: The prepared log.
        config: The initial configuration.
        plant: Its model.
        tick_s: Length of a tick, s; 0 is row by row.

    Attributes:
        run: The prepared log.
        ticks: Its steps and means.
    """

    def __init__(self, run: Run, config: Config, plant: Plant, *, tick_s: float = TICK_S) -> None:
        self.run, self._by_row = run, tick_s == 0.0
        self.ticks = rows_of(run) if self._by_row else ticks_of(run, tick_s)
        ends = np.append(self.ticks.first[1:], len(run.frames)) - 1
        self._ends_s = run.frames.time_s[ends]
        self._rows_kept, self._driven = Cache[Inputs](MOST_ROWS_KEPT), Cache[Driving](MOST_KEPT)
        self._footprints, self._presences = Cache[Footprint](MOST_KEPT), Cache[FloatArray](MOST_KEPT)
        self._of_modes = Cache[tuple[FloatArray, FloatArray]](MOST_KEPT)
        self._sweeps = Cache[FloatArray](MOST_KEPT)
        self._lags = Cache[FloatArray](MOST_KEPT)
        sources = realise(config).config.source
        self._strokes = [mean_stretch(sources[m.index], config.screw) for m in plant.moving]
        self._weight = [] if self._by_row else self._weights(config, plant)

    @property
    def row_s(self) -> float:
        """Median distance of its rows, s."""
        return float(np.median(self.run.frames.dt_s[1:])) if len(self.run.frames) > 1 else 0.0

    @property
    def coarse(self) -> bool:
        """Whether its rows are farther apart than 15 s: the time of a change between them is unknown."""
        return self.row_s > 1.5 * TICK_S

    def inputs(self, config: Config, plant: Plant, key: str, driven_by: str) -> Inputs:
        """Return the inputs of the T steps; by ticks they have no readings.

        Args:
            config: The configuration.
            plant: Its model.
            key: Key of the configuration, for the cache of rows.
            driven_by: Key returned by `driving`, for the cache of ticks.
        """
        if self._by_row:
            return self._rows_kept.get(key, lambda: self._rows(config, plant))
        driven = self._driven.get(driven_by, lambda: self._aggregated(config, plant))
        T, M = len(self.ticks.first), len(plant.moving)
        B, C = np.zeros((T, M, len(plant.decay_1_s))), np.zeros((T, M, len(plant.rows.C)))
        for i, source in enumerate(plant.moving):
            columns, waves = np.tile(source.table.mean_B, (T, 1)), len(source.table.mu_1_m)
            columns[:, :waves], C[:, i] = self._columns(plant, i)[0], self._lag_rows(source, i)
            if source.ends_fraction:
                ends_B = self._columns(plant, i, at_ends=True)[0]
                columns[:, :waves] += source.ends_fraction * (ends_B - columns[:, :waves])
                C[:, i] += source.ends_fraction * (self._lag_rows(source, i, at_ends=True) - C[:, i])
            B[:, i] = columns @ source.table.turn.T if len(source.table.turn) else columns
        unread = np.zeros((T, 0))
        return Inputs(
            time_s=self._ends_s,
            dt_s=self.ticks.length_s,
            y_degC=unread,
            usable=unread.astype(bool),
            quality=unread.astype(np.int8),
            moving_B=B,
            moving_C=C,
            degraded=np.zeros(T, dtype=np.int8),
            **driven._asdict(),
        )

    def means(self, plant: Plant, inputs: Inputs, rows: Means) -> FloatArray:
        """Return the predicted half-minute means, °C or µm, (b, s).

        Args:
            plant: The model.
            inputs: Inputs of the steps.
            rows: Output rows of the steps, (T, s).
        """
        if self._by_row:
            return self.run.means(rows.ends)
        return means_of(self.ticks, rows, self.ripple_K(plant, inputs, rows.passed_W))

    def ripple_K(self, plant: Plant, inputs: Inputs, passed_W: FloatArray) -> FloatArray:
        """Return the contribution of passing nuts to the means of the ticks, K or µm, (T, s).

        A pass early in a tick warms a sensor for longer than one late in it, less the decay within the tick.

        Args:
            plant: The model.
            inputs: Inputs of the ticks.
            passed_W: Heat that each nut's body passes on, W, (T, M).
        """
        length_s, index = np.unique(inputs.dt_s, return_inverse=True)
        decay = np.exp(-0.5 * length_s[:, None] * plant.decay_1_s)[index]
        out = np.zeros((len(inputs), len(plant.rows.C)))
        for i, source in enumerate(plant.moving):
            early_s = self._columns(plant, i)[1] * (1 - source.ends_fraction)
            turn = source.table.turn[:, : early_s.shape[1]]
            early_s = early_s @ turn.T if len(turn) else plant.of_screw(early_s)
            heat_W = inputs.law_W[:, source.index] + passed_W[:, i]
            out += heat_W[:, None] * ((decay * early_s) @ plant.rows.C.T)
        return out

    def sweep(self, plant: Plant) -> FloatArray | None:
        """Return shapes whose squares add up to the covariance of each nut's column over the ticks, (T, M, e,
        N).

        Args:
            plant: The model.

        Returns:
            The shapes. None where no nut has a body, and row by row, because a nut hardly moves within a row.
        """
        bodies = set(plant.coupling.links.source.tolist())
        on = tuple(i for i, m in enumerate(plant.moving) if m.index in bodies)
        if self._by_row or not on:
            return None

        def shapes() -> FloatArray:
            out = np.zeros((len(self.ticks.first), len(plant.moving), PLACES, plant.modes))
            for i in on:
                swept(plant, plant.moving[i].table, self._present(plant.moving[i], i), out[:, i])
            return out

        key = (on, *(_shape_of(plant.moving[i].table) + _mixing_of(plant, i) for i in on))
        return self._sweeps.get(key, shapes)

    def _rows(self, config: Config, plant: Plant) -> Inputs:
        drive = Drive(config, plant)
        return drive.run(drive.initial(), self.run.frames)[1]

    def _aggregated(self, config: Config, plant: Plant) -> Driving:
        """The inputs of the ticks, (T,), without the nuts."""
        fine, row_s = Drive(config, plant).open_loop(self.run.frames), self.run.frames.dt_s
        first = self.ticks.first
        last = np.append(first[1:], len(row_s)) - 1
        loss = mean_over(fine.loss_1_s, row_s, first)
        drawn = mean_over(fine.loss_1_s * fine.loss_degC, row_s, first)
        return Driving(
            law_W=mean_over(fine.law_W, row_s, first),
            law_jump_W=fine.law_jump_W[first],
            z_start=fine.z_start[first],
            z_end=fine.z_end[last],
            loss_1_s=loss,
            loss_degC=np.where(loss > 0, drawn / np.where(loss > 0, loss, 1.0), 0.0),
        )

    def _weights(self, config: Config, plant: Plant) -> list[FloatArray]:
        """The weight of each row of each nut's path, (K,)."""
        heat_W = np.abs(self._aggregated(config, plant).law_W)
        heat_W = np.repeat(heat_W, np.diff([*self.ticks.first, len(self.run.frames)]), axis=0)
        return [self.run.frames.dt_s * (heat_W[:, m.index] + 1e-6) for m in plant.moving]

    def _footprint(self, plant: Plant, i: int, *, at_ends: bool = False) -> Footprint:
        """The contribution of a nut's path to the ticks, for any number of modes up to the plant's."""
        source = plant.moving[i]
        highest = max(plant.mode_index[-1], len(source.table.mu_1_m))
        return self._footprints.get(
            (i, at_ends, highest),
            lambda: footprint(
                self.run, self.ticks.first, source, highest, self._strokes[i], self._weight[i],
                at_ends=at_ends,
            ),
        )  # fmt: skip

    def _present(self, source: MovingSource, i: int) -> FloatArray:
        """The share (T, PLACES) of each tick that a nut spends at places from end to end."""
        return self._presences.get(
            i,
            lambda: presence(self.run, self.ticks.first, source.table, source.channel, self._strokes[i]),
        )

    def _columns(self, plant: Plant, i: int, *, at_ends: bool = False) -> tuple[FloatArray, FloatArray]:
        """The nut's input columns (T, N), and how much earlier than evenly (T, N) they came."""
        table = plant.moving[i].table
        key = (i, at_ends, _shape_of(table))
        return self._of_modes.get(key, lambda: self._footprint(plant, i, at_ends=at_ends).of_modes(table))

    def _lag_rows(self, source: MovingSource, i: int, *, at_ends: bool = False) -> FloatArray:
        """The output columns (T, R) of the nut's lag."""
        table, frames = source.table.of_lag(), self.run.frames

        def averaged() -> FloatArray:
            path = frames.path[source.channel]
            rows = moving.from_unknown(table, frames.dt_s, path, at_ends=at_ends)[1]
            return mean_over(rows, frames.dt_s, self.ticks.first)

        key = (i, at_ends, table.table_C.tobytes() + table.mean_C.tobytes())
        return self._lags.get(key, averaged)


def _shape_of(table: NutTable) -> bytes:
    """A key of the parts of a nut's table that its input columns depend on."""
    shape = (table.mu_1_m, table.phase, table.scale, np.array(table.conductance_W_m))
    return b"".join(a.tobytes() for a in shape)


def _mixing_of(plant: Plant, i: int) -> bytes:
    """A key of the modes that a nut's cosines make up; rounding errors of a basis do not change it."""
    mixing = plant.moving[i].table.turn
    if not len(mixing):
        return b""
    if plant.basis is not None:
        mixing = plant.basis.V @ mixing
    return (np.round(mixing[: plant.modes], 6) + 0.0).tobytes()  # -0.0 becomes 0.0


def driving(config: Config) -> str:
    """Return a key of the parts of a configuration that determine heats, losses and known inputs.

    Two configurations with equal keys have the same inputs, whatever their films and conductivities.
    """
    machine = realise(config)
    laws = [heat_parts(s) for s in machine.config.source]
    effects = [e for e in config.effect if any(isinstance(t, INPUT_TERMS) for t in e.terms(config))]
    lost = any(isinstance(t, SpeedLoss) for t in machine.terms)
    still = config.surface.model_copy(update={"convection_W_m2K": 0.0})
    loss = (machine.config.screw, still) if lost else None
    air = (config.ambient, config.boundary, config.bed, config.output.reference_degC)
    return repr((laws, effects, loss, *air))


def heat_parts(source: Source) -> tuple[object, ...]:
    """Return the values of the keys that make up a source's heat law, in a fixed order."""
    return tuple(getattr(source, key) for key in (*HeatLaw.model_fields, "stroke_m"))
