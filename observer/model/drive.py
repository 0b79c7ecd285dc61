"""From frames to what drives the plant: sensor rows, heats by law, known inputs, the moving nut's columns.

Pure: `run(state, frames)` returns the next state and the inputs of K steps, and K steps give the same bits
as K runs of one. What is missing is held at its last value and the step is marked, never filled in
silently.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.config import Config
from observer.effects.terms import AmbientShift, LawFactor, Offset, SpeedLoss
from observer.frames import BoolArray, FloatArray, FrameBlock, Inputs, QualityArray
from observer.kernels import drive_on, record
from observer.kernels.layout import packed
from observer.model.couple import surface_rate
from observer.model.law import Law, heat_law
from observer.model.plant import AMBIENT, LEFT, OFFSET, REFERENCE, RIGHT, Plant
from observer.model.realise import realise
from observer.model.rod import moving
from observer.model.rod.path import PathState
from observer.tables.sections import law_channels


@dataclass(frozen=True, slots=True)
class DriveState:
    """What the drive remembers between steps.

    `law_W` (m,) and `z` (p,), NaN before they are first known; `nuts` and `turns`, one state per moving
    source; the time `begin_s` of the first frame, NaN before it, that of the last, and for how long each
    law's channel has not been zero, `running_s` (m,), counted only where a factor of the law asks for it.
    """

    law_W: FloatArray
    z: FloatArray
    nuts: tuple[moving.NutState, ...]
    turns: tuple[PathState, ...]
    begin_s: float
    last_s: float
    running_s: FloatArray


class Driving(NamedTuple):
    """What drives the open loop through K steps; each as in `Inputs`."""

    law_W: FloatArray
    law_jump_W: FloatArray
    z_start: FloatArray
    z_end: FloatArray
    loss_1_s: FloatArray
    loss_degC: FloatArray


class Drive:
    """The plant's reading of the channels; holds no state of its own."""

    def __init__(self, config: Config, plant: Plant) -> None:
        """Fix, once, which channel feeds which input."""
        machine = realise(config)
        config = machine.config
        self._plant = plant
        self._factors = [
            [t.factor for t in machine.terms if isinstance(t, LawFactor) and t.source == name]
            for name in plant.source_names
        ]
        self._losses = [t for t in machine.terms if isinstance(t, SpeedLoss)]
        self._surface_rate = surface_rate(config.screw)
        self._sensor_channels = [s.channel for s in config.sensor]
        self._laws: list[tuple[tuple[str, ...], Law]] = [
            (law_channels(s, config.source), heat_law(s, config.source, config.screw.length_m))
            for s in config.source
        ]
        self._known = plant.known
        read = {
            AMBIENT: config.ambient.channel,
            LEFT: config.boundary.left.channel,
            RIGHT: config.boundary.right.channel,
        }
        self._known_channels = [read.get(name) for name in plant.known_names]
        rate = {AMBIENT: sum(t.rate_K_h for t in machine.terms if isinstance(t, AmbientShift))}
        shift = {AMBIENT: sum(t.offset_K for t in machine.terms if isinstance(t, AmbientShift))}
        fixed = {AMBIENT: config.ambient.temperature_degC, REFERENCE: config.output.reference_degC}
        offsets = [t for t in machine.terms if isinstance(t, Offset)]
        for s in config.sensor:
            own = [t for t in offsets if t.sensor == s.name]
            fixed[OFFSET + s.name] = sum(t.offset_K for t in own)
            rate[OFFSET + s.name] = sum(t.rate_K_h for t in own)
        self._known_fixed = [fixed.get(name) for name in plant.known_names]
        self._shift_K = np.array([shift.get(name, 0.0) for name in plant.known_names])
        self._rate_K_h = np.array([rate.get(name, 0.0) for name in plant.known_names])
        needed = [c for read, _ in self._laws for c in read]
        needed += [*self._known_channels, *(s.channel for s in plant.moving)]  # type: ignore[list-item]
        needed += [loss.speed_channel for loss in self._losses]
        self._needed = [c for c in dict.fromkeys(needed) if c is not None]
        self._channels: tuple[str, ...] | None = None  # of the last frames, and where they hold what is read
        self._own = threading.local()

    def initial(self) -> DriveState:
        """Return the state before the first frame."""
        z = np.array([np.nan if fixed is None else fixed for fixed in self._known_fixed])
        return DriveState(
            law_W=np.full(len(self._laws), np.nan),
            z=z,
            nuts=tuple(moving.start(s.table) for s in self._plant.moving),
            turns=tuple(PathState() for _ in self._plant.moving),
            begin_s=np.nan,
            last_s=np.nan,
            running_s=np.zeros(len(self._laws)),
        )

    def run(self, state: DriveState, frames: FrameBlock) -> tuple[DriveState, Inputs]:
        """Return the state after K frames and the inputs of the K steps they end."""
        told, begin_s, running_s = self._told(state, frames)
        nuts, turns, moving_B, moving_C = self._nuts(state, frames)
        inputs = Inputs(
            frames.time_s, frames.dt_s, told.y_degC, told.usable, told.sensor_quality, told.law_W,
            told.jump_W, told.z_start, told.z_end, moving_B, moving_C, told.degraded,
            *self._loss(frames, told.z_end[:, self._known.ambient]),
        )  # fmt: skip
        last_s = float(frames.time_s[-1])
        return DriveState(told.law[-1], told.known[-1], nuts, turns, begin_s, last_s, running_s), inputs

    def open_loop(self, frames: FrameBlock) -> Driving:
        """Return what drives a plant through a log from its first frame on, but for where nuts are."""
        told, _, _ = self._told(self.initial(), frames)
        losses = self._loss(frames, told.z_end[:, self._known.ambient])
        return Driving(told.law_W, told.jump_W, told.z_start, told.z_end, *losses)

    def _told(self, state: DriveState, frames: FrameBlock) -> tuple[DriveDesk, float, FloatArray]:
        """What drives the plant in K steps and what sensors say, the first frame's time, and how long each
        law has run.
        """
        if frames.channels is not self._channels:
            self._channels, self._read = frames.channels, record(self._places(frames.channels))
        own, sizes = self._own, (len(self._sensor_channels), len(self._laws), len(state.z))
        if len(frames) != 1:
            desk = _desk(frames, *sizes)
            desk_record = record(desk)
        elif not hasattr(own, "desk") or own.desk.values.shape != frames.values.shape:
            desk = own.desk = DriveDesk._make(array.copy() for array in _desk(frames, *sizes))
            desk_record = own.record = record(desk)
        else:
            desk, desk_record = own.desk, own.record
            desk.time_s[:], desk.values[:] = frames.time_s, frames.values
            desk.fresh[:], desk.quality[:] = frames.fresh, frames.quality
        desk.law_before_W[:], desk.z_before[:] = state.law_W, state.z
        running_s = self._law(desk.law, frames, state)
        begin_s = float(frames.time_s[0]) if math.isnan(state.begin_s) else state.begin_s
        drive_on(self._read, desk_record, begin_s, state.last_s)
        if len(frames) == 1:
            desk = DriveDesk._make([*desk[:6], *[array.copy() for array in desk[6:]]])
        return desk, begin_s, running_s

    def _places(self, channels: tuple[str, ...]) -> ColumnsRead:
        """Where frames of these channels hold what is read."""
        at: dict[str | None, int] = {name: i for i, name in enumerate(channels)}
        self._law_columns = [[at[c] for c in read] for read, _ in self._laws]
        self._loss_columns = [at[loss.speed_channel] for loss in self._losses]

        def columns(names: Sequence[str]) -> NDArray[np.int64]:
            return np.array([at[name] for name in names], np.int64)

        return ColumnsRead(
            columns(self._sensor_channels),
            np.array([-1 if c is None else at[c] for c in self._known_channels], np.int64),
            self._shift_K,
            self._rate_K_h,
            columns(self._needed),
            columns([s.channel for s in self._plant.moving]),
            self._known.ambient,
            -1 if self._known.reference is None else self._known.reference,
        )

    def _law(self, law: FloatArray, frames: FrameBlock, state: DriveState) -> FloatArray:
        """Fill in each source's heat by law at each tick, (K, m), W, NaN while not known; return for how long
        each has run.
        """
        running_s = state.running_s
        for j, (columns, (_, heat_W)) in enumerate(zip(self._law_columns, self._laws, strict=True)):
            read = [frames.values[:, i] for i in columns] or [np.zeros(len(frames))]
            law[:, j] = heat_W(*read)
            if factors := self._factors[j]:
                ran = np.where(np.nan_to_num(read[0]) != 0.0, frames.dt_s, 0.0)
                ran_s = np.cumsum(np.concatenate([running_s[j : j + 1], ran]))[1:]
                running_s = running_s.copy()
                running_s[j] = ran_s[-1]
                for factor in factors:
                    law[:, j] *= factor(read[0], ran_s)
        return running_s

    def _loss(self, frames: FrameBlock, ambient_degC: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The rate (K,) of the losses that go with speed, 1/s, and the temperature (K,) they draw to, °C."""
        rate, drawn = np.zeros(len(frames)), np.zeros(len(frames))
        if not self._losses:
            return rate, drawn
        for loss, column in zip(self._losses, self._loss_columns, strict=True):
            speed_rpm = np.nan_to_num(frames.values[:, column])
            own = self._surface_rate * loss.film_W_m2K(speed_rpm)
            rate += own
            drawn += own * (ambient_degC if loss.temperature_degC is None else loss.temperature_degC)
        return rate, np.where(rate > 0.0, drawn / np.where(rate > 0.0, rate, 1.0), 0.0)

    def _averaging(self, nut: int, steps: int) -> moving.Averaging:
        """What the averaging of a nut's columns works on; for a single step it is kept."""
        if steps != 1:
            return moving.Averaging(self._plant.moving[nut].table, steps)
        if not hasattr(self._own, "nuts"):
            self._own.nuts = [moving.Averaging(s.table, 1) for s in self._plant.moving]
        return self._own.nuts[nut]  # type: ignore[no-any-return]

    def _nuts(
        self, state: DriveState, frames: FrameBlock
    ) -> tuple[tuple[moving.NutState, ...], tuple[PathState, ...], FloatArray, FloatArray]:
        """The averaged columns of every moving source: states, (K, M, n_x), (K, M, R)."""
        plant = self._plant
        B, C, nuts, turns = [], [], [], list(state.turns)
        for i, source in enumerate(plant.moving):
            path = frames.path[source.channel]
            nut, own_B, own_C = self._averaging(i, len(frames)).columns(state.nuts[i], frames.dt_s, path)
            if source.ends_fraction:
                turns[i], ends_B, ends_C = moving.columns_at_ends(source.table, turns[i], frames.dt_s, path)
                own_B = own_B + source.ends_fraction * (ends_B - own_B)
                own_C = own_C + source.ends_fraction * (ends_C - own_C)
            nuts.append(nut)
            B.append(own_B)
            C.append(own_C)
        moving_B = _stacked(B, len(frames), len(plant.decay_1_s))
        moving_C = _stacked(C, len(frames), len(plant.rows.C))
        return tuple(nuts), tuple(turns), moving_B, moving_C


class ColumnsRead(NamedTuple):
    """The columns of the frames that hold sensors (s,), known inputs (p,), what else the model needs, and
    nuts' positions (M,); −1 is a known input that no channel tells. `shift_K` (p,) is how far those are from
    what is told, and `rate_K_h` (p,) how fast they drift from there;
    `ambient` and `reference` are two of them, −1 where there is none.
    """

    sensors: NDArray[np.int64]
    known: NDArray[np.int64]
    shift_K: FloatArray
    rate_K_h: FloatArray
    needed: NDArray[np.int64]
    nuts: NDArray[np.int64]
    ambient: int
    reference: int


class DriveDesk(NamedTuple):
    """What the kernel reads of K frames and of the state, and what it fills in.

    Names and shapes as in `FrameBlock`, `DriveState` and `Inputs`; `law` (K, m) and `known` (K, p) are heats
    by law and known inputs at the ticks.
    """

    time_s: FloatArray
    values: FloatArray
    fresh: BoolArray
    quality: QualityArray
    law_before_W: FloatArray
    z_before: FloatArray
    law: FloatArray
    known: FloatArray
    z_start: FloatArray
    z_end: FloatArray
    law_W: FloatArray
    jump_W: FloatArray
    y_degC: FloatArray
    usable: BoolArray
    sensor_quality: QualityArray
    degraded: NDArray[np.int8]


def _desk(frames: FrameBlock, s: int, m: int, p: int) -> DriveDesk:
    """The desk of some frames, on their memory."""
    k = len(frames)
    given = (packed(a) for a in (frames.time_s, frames.values, frames.fresh, frames.quality))
    numbers = (np.empty(size) for size in (m, p, (k, m), *3 * [(k, p)], *2 * [(k, m)], (k, s)))
    flags = np.empty((k, s), np.bool_), np.empty((k, s), np.int8), np.empty(k, np.int8)
    return DriveDesk._make([*given, *numbers, *flags])


def _stacked(columns: list[FloatArray], steps: int, width: int) -> FloatArray:
    """Columns (K, width) of M sources as (K, M, width)."""
    if len(columns) == 1:
        return columns[0][:, None]
    return np.stack(columns, axis=1) if columns else np.empty((steps, 0, width))
