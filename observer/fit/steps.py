"""A run in the steps of a prediction: its rows, or, thousands of times in a search, ticks of ten seconds.

Heats, losses and the nut's columns are averaged over each tick, so their energy is that of the rows; known
inputs are taken at its ends. Predictions are compared as means over three ticks, to which each tick
contributes its own, taken when its values came.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.config import Config
from observer.effects.terms import INPUT_TERMS, SpeedLoss
from observer.fit.footprint import PLACES, Footprint, footprint, presence, swept
from observer.fit.kept import Kept
from observer.fit.runs import BLOCK_S, Run, mean_over
from observer.frames import FloatArray, Inputs
from observer.model.drive import Drive, Driving
from observer.model.plant import MovingSource, Plant
from observer.model.realise import realise
from observer.model.rod import moving
from observer.model.rod.moving import NutTable
from observer.model.rod.static import mean_stretch
from observer.model.simulate import Means
from observer.tables.laws import HeatLaw
from observer.tables.sections import Source

TICK_S = 10.0
TICKS_IN_MEAN = 3
MOST_KEPT, MOST_ROWS_KEPT = 16, 2


@dataclass(frozen=True, slots=True)
class Ticks:
    """How a run's rows fall into ticks and means.

    `first` (T,) the first row of each tick, `length_s` (T,) how long it lasts; `mean` (T,) the mean each
    tick belongs to; `count`, `measured_degC` (b, s) the usable values of each mean and their average, NaN
    without any; `time_s` (b,) when each mean ends, from the start of the run; `share` (T, s) the part of its
    mean's values that fell into each tick, and `late` (T, s) how much later than evenly, as a share of the
    tick; `at_end` (T,) ticks too long (gaps) for the mean of their ends.
    """

    first: NDArray[np.int64]
    length_s: FloatArray
    mean: NDArray[np.int64]
    count: FloatArray
    measured_degC: FloatArray
    time_s: FloatArray
    share: FloatArray
    late: FloatArray
    at_end: NDArray[np.bool_]


def ticks_of(run: Run) -> Ticks:
    """Cut a run into ticks."""
    frames = run.frames
    since_s = frames.time_s - frames.time_s[0]
    number = np.maximum(np.ceil(since_s / TICK_S - 1e-9).astype(np.int64) - 1, 0)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    number = number[first]
    length_s = np.add.reduceat(frames.dt_s, first)
    means, mean = np.unique(number // TICKS_IN_MEAN, return_inverse=True)
    per_tick = np.add.reduceat(run.usable, first, axis=0, dtype=float)
    total = np.add.reduceat(np.where(run.usable, run.values_degC, 0.0), first, axis=0)
    begin_s = since_s[first] - frames.dt_s[first]
    came_s = np.add.reduceat(np.where(run.usable, since_s[:, None], 0.0), first, axis=0)
    middle_s = np.where(per_tick > 0, came_s / np.maximum(per_tick, 1.0) - begin_s[:, None], 0.0)
    starts = np.flatnonzero(np.diff(mean, prepend=-1))
    count = np.add.reduceat(per_tick, starts, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        measured = np.add.reduceat(total, starts, axis=0) / count
        share = np.where(count[mean] > 0, per_tick / np.maximum(count[mean], 1.0), 0.0)
    return Ticks(
        first=first,
        length_s=length_s,
        mean=mean,
        count=count,
        measured_degC=measured,
        time_s=(means + 1) * (TICKS_IN_MEAN * TICK_S),
        share=share,
        late=middle_s / np.maximum(length_s, 1e-9)[:, None] - 0.5,
        at_end=length_s > 1.5 * TICK_S,
    )


def means_of(ticks: Ticks, rows: Means, ripple_K: FloatArray) -> FloatArray:
    """The means (b, s) of output rows (T, s); `ripple_K` (T, s) is what passing nuts add to them."""
    within = rows.means + ticks.late * rows.way + ripple_K
    out = np.zeros_like(ticks.measured_degC)
    np.add.at(out, ticks.mean, np.where(ticks.at_end[:, None], rows.ends, within) * ticks.share)
    return out


def rows_of(run: Run) -> Ticks:
    """Return a run's rows as ticks, and its blocks as their means."""
    rows = np.arange(len(run.frames))
    mean = np.repeat(np.arange(len(run.first)), np.diff([*run.first, len(rows)]))
    number = np.floor((run.frames.time_s[run.first] - run.frames.time_s[0]) / BLOCK_S)
    return Ticks(
        first=rows,
        length_s=run.frames.dt_s,
        mean=mean,
        count=run.count,
        measured_degC=run.measured_degC,
        time_s=(number + 1) * BLOCK_S,
        share=run.usable / np.maximum(run.count[mean], 1.0),
        late=np.zeros(run.usable.shape),
        at_end=np.ones(len(rows), dtype=bool),
    )


class SteppedRun:
    """A run whose inputs can be had for any configuration: in ticks, or, exact and some tens of times slower,
    row by row.

    For ticks the nuts' paths are followed once, each row of them weighed by the nut's heat at the
    configuration that the run is made with.
    """

    def __init__(self, run: Run, config: Config, plant: Plant, *, by_row: bool = False) -> None:
        self.run, self._by_row = run, by_row
        self.ticks = rows_of(run) if by_row else ticks_of(run)
        ends = np.append(self.ticks.first[1:], len(run.frames)) - 1
        self._ends_s = run.frames.time_s[ends]
        self._rows_kept, self._driven = Kept[Inputs](MOST_ROWS_KEPT), Kept[Driving](MOST_KEPT)
        self._footprints, self._presences = Kept[Footprint](MOST_KEPT), Kept[FloatArray](MOST_KEPT)
        self._of_modes = Kept[tuple[FloatArray, FloatArray]](MOST_KEPT)
        self._sweeps = Kept[FloatArray](MOST_KEPT)
        self._lags = Kept[FloatArray](MOST_KEPT)
        sources = realise(config).config.source
        self._strokes = [mean_stretch(sources[m.index], config.screw) for m in plant.moving]
        self._weight = [] if by_row else self._weights(config, plant)

    @property
    def row_s(self) -> float:
        """How far its rows usually are apart."""
        return float(np.median(self.run.frames.dt_s[1:])) if len(self.run.frames) > 1 else 0.0

    @property
    def coarse(self) -> bool:
        """Whether its rows are further apart than ticks: what changed between them changed at any time."""
        return self.row_s > 1.5 * TICK_S

    def inputs(self, config: Config, plant: Plant, key: str, driven_by: str) -> Inputs:
        """Return the inputs of the steps, (T,); `key` says the configuration, and `driven_by` what of it
        `driving` tells.
        """
        if self._by_row:
            return self._rows_kept.get(key, lambda: self._rows(config, plant))
        driven = self._driven.get(driven_by, lambda: self._aggregated(config, plant))
        T, M = len(self.ticks.first), len(plant.moving)
        B, C = np.zeros((T, M, len(plant.decay_1_s))), np.zeros((T, M, len(plant.rows.C)))
        for i, source in enumerate(plant.moving):
            B[:, i], C[:, i] = source.table.mean_B, self._lag_rows(source, i)
            B[:, i, : plant.modes] = self._columns(plant, i)[0]
            if source.ends_fraction:
                ends_B = self._columns(plant, i, at_ends=True)[0]
                B[:, i, : plant.modes] += source.ends_fraction * (ends_B - B[:, i, : plant.modes])
                C[:, i] += source.ends_fraction * (self._lag_rows(source, i, at_ends=True) - C[:, i])
            if len(source.table.turn):
                B[:, i] = B[:, i] @ source.table.turn.T
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
        """The means (b, s) of output rows (T, s)."""
        if self._by_row:
            return self.run.means(rows.ends)
        return means_of(self.ticks, rows, self.ripple_K(plant, inputs))

    def ripple_K(self, plant: Plant, inputs: Inputs) -> FloatArray:
        """What the passing nut adds to the mean of a tick beside its mean heat, (T, s).

        A pass early in a tick warms a sensor for longer than one late in it, by what of it is not lost
        again within the tick.
        """
        length_s, which = np.unique(inputs.dt_s, return_inverse=True)
        kept = np.exp(-0.5 * length_s[:, None] * plant.decay_1_s)[which]
        out = np.zeros((len(inputs), len(plant.rows.C)))
        for i, source in enumerate(plant.moving):
            early_s = self._columns(plant, i)[1] * (1 - source.ends_fraction)
            out += inputs.law_W[:, source.index, None] * ((kept * plant.of_screw(early_s)) @ plant.rows.C.T)
        return out

    def sweep(self, plant: Plant) -> FloatArray | None:
        """The shapes (T, M, e, N) of which the squares add up to the covariance of each nut's column over
        the ticks; nothing where no nut has a body, and row by row, for within one a nut hardly moves.
        """
        bodies = set(plant.coupling.links.source.tolist())
        on = tuple(i for i, m in enumerate(plant.moving) if m.index in bodies)
        if self._by_row or not on:
            return None

        def shapes() -> FloatArray:
            out = np.zeros((len(self.ticks.first), len(plant.moving), PLACES, plant.modes))
            for i in on:
                swept(plant.moving[i].table, self._present(plant.moving[i], i), out[:, i])
            return out

        key = (on, *(_shape_of(plant.moving[i].table) for i in on))
        return self._sweeps.get(key, shapes)

    def _rows(self, config: Config, plant: Plant) -> Inputs:
        drive = Drive(config, plant)
        return drive.run(drive.initial(), self.run.frames)[1]

    def _aggregated(self, config: Config, plant: Plant) -> Driving:
        """What drives the ticks, (T,), without the nuts."""
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
        """How much each row of each nut's path counts, (K,)."""
        heat_W = np.abs(self._aggregated(config, plant).law_W)
        heat_W = np.repeat(heat_W, np.diff([*self.ticks.first, len(self.run.frames)]), axis=0)
        return [self.run.frames.dt_s * (heat_W[:, m.index] + 1e-6) for m in plant.moving]

    def _footprint(self, plant: Plant, i: int, *, at_ends: bool = False) -> Footprint:
        """What a nut's path leaves in the ticks, for any modes up to as many as the plant has."""
        source, highest = plant.moving[i], plant.mode_index[-1]
        return self._footprints.get(
            (i, at_ends, highest),
            lambda: footprint(
                self.run, self.ticks.first, source.table, highest, source.channel, self._strokes[i],
                self._weight[i], at_ends=at_ends,
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
    """What of a nut's table its input columns depend on, as a key."""
    shape = (table.mu_1_m, table.phase, table.scale, np.array(table.conductance_W_m))
    return b"".join(a.tobytes() for a in shape)


def driving(config: Config) -> str:
    """What of a configuration decides the heats, losses and known inputs, as a key."""
    machine = realise(config)
    laws = [heat_parts(s) for s in machine.config.source]
    own = [e for e in config.effect if any(isinstance(t, INPUT_TERMS) for t in e.terms(config))]
    lost = any(isinstance(t, SpeedLoss) for t in machine.terms)
    still = config.surface.model_copy(update={"convection_W_m2K": 0.0})
    loss = (machine.config.screw, still) if lost else None
    return repr((laws, own, loss, config.ambient, config.boundary, config.output.reference_degC))


def heat_parts(source: Source) -> tuple[object, ...]:
    """The keys of a source that make up its heat law."""
    return tuple(getattr(source, key) for key in (*HeatLaw.model_fields, "stroke_m"))
