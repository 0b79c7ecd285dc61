"""A run in ticks of ten seconds: what a search simulates, thousands of times, in place of every row.

Heats, losses and the nut's columns are averaged over each tick, so their energy is that of the rows; known
inputs are taken at its ends. Predictions are compared as means over three ticks, to which each tick
contributes the mean of its two ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from observer.config import Config
from observer.effects.terms import AmbientShift, LawFactor, Offset, SpeedLoss
from observer.fit.footprint import PLACES, Footprint, footprint
from observer.fit.runs import Run
from observer.frames import FloatArray, Inputs
from observer.model.drive import Drive
from observer.model.plant import MovingSource, Plant
from observer.model.realise import realise
from observer.model.rod import moving, turning
from observer.model.rod.path import PathState
from observer.model.rod.sources import mean_stretch
from observer.tables.laws import HeatLaw
from observer.tables.sections import Source

TICK_S = 10.0
TICKS_IN_MEAN = 3
MOST_KEPT = 64
Key = TypeVar("Key")
Value = TypeVar("Value")
INPUT_TERMS = (LawFactor, AmbientShift, Offset, SpeedLoss)


@dataclass(frozen=True, slots=True)
class Ticks:
    """How a run's rows fall into ticks and means.

    `first` (T,) the first row of each tick, `length_s` (T,) how long it lasts; `mean` (T,) the mean each
    tick belongs to; `count`, `measured_degC` (b, s) the usable values of each mean and their average, NaN
    without any; `time_s` (b,) when each mean ends, from the start of the run; `share` (T, s) the part of its
    mean's values that fell into each tick; `at_end` (T,) ticks too long (gaps) for the mean of their ends.
    """

    first: NDArray[np.int64]
    length_s: FloatArray
    mean: NDArray[np.int64]
    count: FloatArray
    measured_degC: FloatArray
    time_s: FloatArray
    share: FloatArray
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
        at_end=length_s > 1.5 * TICK_S,
    )


def means_of(ticks: Ticks, before: FloatArray, rows: FloatArray, ripple_K: FloatArray) -> FloatArray:
    """The means (b, s) of output rows (T, s) at the ticks' ends, `before` (s,) those at the start.

    `ripple_K` (T, s) is what the mean of a tick has over that of its ends.
    """
    starts = np.vstack([before, rows[:-1]])
    within = np.where(ticks.at_end[:, None], rows, 0.5 * (starts + rows) + ripple_K)
    out = np.zeros_like(ticks.measured_degC)
    np.add.at(out, ticks.mean, within * ticks.share)
    return out


class CoarseRun:
    """A run whose inputs can be had in ticks for any configuration; the nuts' paths are followed once."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.ticks = ticks_of(run)
        self._footprints: dict[tuple[int, bool], Footprint] = {}
        self._of_modes: dict[tuple[int, bool, bytes], tuple[FloatArray, FloatArray]] = {}
        self._lags: dict[tuple[int, bool, bytes], FloatArray] = {}
        self._driven: dict[str, Inputs] = {}

    def inputs(self, config: Config, plant: Plant) -> Inputs:
        """Return the inputs of the ticks, (T,)."""
        driven = self._drive(config, plant)
        T, M = len(driven), len(plant.moving)
        B, C = np.zeros((T, M, len(plant.decay_1_s))), np.zeros((T, M, len(plant.rows.C)))
        for i, source in enumerate(plant.moving):
            self._follow(config, source, i, driven.law_W)
            B[:, i], C[:, i] = source.table.mean_B, self._lag_rows(source, i)
            B[:, i, : plant.modes] = self._columns(source, i)[0]
            if source.ends_fraction:
                ends_B = self._columns(source, i, at_ends=True)[0]
                B[:, i, : plant.modes] += source.ends_fraction * (ends_B - B[:, i, : plant.modes])
                C[:, i] += source.ends_fraction * (self._lag_rows(source, i, at_ends=True) - C[:, i])
        return driven._replace(moving_B=B, moving_C=C)

    def ripple_K(self, plant: Plant, inputs: Inputs) -> FloatArray:
        """What the passing nut adds to the mean of a tick over that of its ends, (T, s).

        A pass early in a tick warms a sensor for longer than one late in it. To be asked after `inputs`.
        """
        out = np.zeros((len(inputs), len(plant.rows.C)))
        for i, source in enumerate(plant.moving):
            early_s = self._columns(source, i)[1] * (1 - source.ends_fraction)
            out += inputs.law_W[:, source.index, None] * (early_s @ plant.rows.C[:, : plant.modes].T)
        return out

    def sweep(self, plant: Plant) -> FloatArray | None:
        """The shapes (T, M, e, N) of which the squares add up to the covariance of each nut's column over
        the ticks; nothing where no nut has a body. To be asked after `inputs`.
        """
        bodies = set(plant.coupling.links.source.tolist())
        if not bodies & {m.index for m in plant.moving}:
            return None
        out = np.zeros((len(self.ticks.first), len(plant.moving), PLACES, plant.modes))
        for i, source in enumerate(plant.moving):
            if source.index in bodies:
                out[:, i] = self._footprints[i, False].swept(source.table)
        return out

    def _drive(self, config: Config, plant: Plant) -> Inputs:
        """The inputs of the ticks without the nut's columns; kept, as the film and the screw do not change
        them.
        """
        return _kept(self._driven, _driving(config), lambda: self._aggregated(config, plant))

    def _aggregated(self, config: Config, plant: Plant) -> Inputs:
        drive = Drive(config, plant, follow_nuts=False)
        fine = drive.run(drive.initial(), self.run.frames)[1]
        first, length_s = self.ticks.first, np.maximum(self.ticks.length_s, 1e-9)

        def mean(values: FloatArray) -> FloatArray:
            weight = fine.dt_s if values.ndim == 1 else fine.dt_s[:, None]
            over = length_s if values.ndim == 1 else length_s[:, None]
            return np.asarray(np.add.reduceat(values * weight, first, axis=0) / over)

        last = np.append(first[1:], len(fine)) - 1
        loss = mean(fine.loss_1_s)
        drawn = mean(fine.loss_1_s * fine.loss_degC)
        return fine.part(0, len(first))._replace(
            time_s=fine.time_s[last],
            dt_s=self.ticks.length_s,
            law_W=mean(fine.law_W),
            z_start=fine.z_start[first],
            z_end=fine.z_end[last],
            loss_1_s=loss,
            loss_degC=np.where(loss > 0, drawn / np.where(loss > 0, loss, 1.0), 0.0),
        )

    def _follow(self, config: Config, source: MovingSource, i: int, law_W: FloatArray) -> None:
        """Follow a nut's path, weighted by its heat when it is first asked for."""
        frames, first = self.run.frames, self.ticks.first
        for at_ends in (False, True) if source.ends_fraction else (False,):
            known = self._footprints.get((i, at_ends))
            if known is None or not known.holds(source.table):
                heat_W = np.repeat(np.abs(law_W[:, source.index]), np.diff([*first, len(frames)]))
                stroke = mean_stretch(config.source[source.index], config.screw)
                self._footprints[i, at_ends] = footprint(
                    self.run, first, source.table, source.channel, stroke, frames.dt_s * (heat_W + 1e-6),
                    at_ends=at_ends,
                )  # fmt: skip

    def _columns(
        self, source: MovingSource, i: int, *, at_ends: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """The nut's input columns (T, N), and how much earlier than evenly (T, N) they came."""
        table = source.table
        shape = (table.mu_1_m, table.phase, table.scale, np.array(table.conductance_W_m))
        key = (i, at_ends, b"".join(a.tobytes() for a in shape))
        return _kept(self._of_modes, key, lambda: self._footprints[i, at_ends].of_modes(table))

    def _lag_rows(self, source: MovingSource, i: int, *, at_ends: bool = False) -> FloatArray:
        """The output columns (T, R) of the nut's lag."""
        table, frames, first = source.table.of_lag(), self.run.frames, self.ticks.first

        def averaged() -> FloatArray:
            path = frames.path[source.channel]
            if at_ends:
                rows = turning.columns(table, PathState(), frames.dt_s, path)[2]
            else:
                rows = moving.columns(table, moving.start(table), frames.dt_s, path)[2]
            over_s = np.maximum(np.add.reduceat(frames.dt_s, first), 1e-9)
            return np.asarray(np.add.reduceat(rows * frames.dt_s[:, None], first) / over_s[:, None])

        key = (i, at_ends, table.table_C.tobytes() + table.mean_C.tobytes())
        return _kept(self._lags, key, averaged)


def _kept(store: dict[Key, Value], key: Key, work_out: Callable[[], Value]) -> Value:
    """What is in the store under a key, or is worked out and put there; a full store begins anew."""
    if key not in store:
        if len(store) >= MOST_KEPT:
            store.clear()
        store[key] = work_out()
    return store[key]


def _driving(config: Config) -> str:
    """What of a configuration decides the heats, losses and known inputs, as a key."""
    machine = realise(config)
    laws = [heat_parts(s) for s in machine.config.source]
    own = [e for e in config.effect if any(isinstance(t, INPUT_TERMS) for t in e.terms(config))]
    lost = any(isinstance(t, SpeedLoss) for t in machine.terms)
    loss = (machine.config.screw, config.surface) if lost else None
    return repr((laws, own, loss, config.ambient, config.boundary, config.output.reference_degC))


def heat_parts(source: Source) -> tuple[object, ...]:
    """The keys of a source that make up its heat law."""
    return tuple(getattr(source, key) for key in (*HeatLaw.model_fields, "stroke_m"))
