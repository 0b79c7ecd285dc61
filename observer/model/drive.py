"""Convert frames to the inputs of the plant: sensor rows, heats by law, known inputs, columns of moving nuts.

Pure: `run(state, frames)` returns the next state and the inputs of K steps, and K steps give the same bits
as K runs of one. A missing value keeps its last value, and the step is marked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.config.effects.terms import AmbientShift, LawFactor, SensorOffset, SpeedLoss
from observer.config.machine import Config
from observer.config.sections import law_channels
from observer.frames import BoolArray, FloatArray, FrameBlock, Inputs, NutPath, QualityArray
from observer.kernels import fill_inputs, record
from observer.kernels.layout import Records, packed
from observer.model.law import Law, heat_law
from observer.model.plant import AMBIENT, BED, LEFT, OFFSET, REFERENCE, RIGHT, MovingSource, Plant
from observer.model.realise import realise
from observer.model.rod import moving
from observer.model.rod.screw import surface_rate


@dataclass(frozen=True, slots=True)
class DriveState:
    """The state of the drive between steps.

    Attributes:
        law_W: Heats by law, NaN before the first values, (m,).
        z: Known inputs, NaN before the first values, (p,).
        nuts: State of each moving source.
        turns: Path memory of each moving source.
        begin_s: Time of the first frame, NaN before it.
        last_s: Time of the last frame, NaN before it.
        running_s: Total time with each law's channel not zero, (m,); counted only for laws with factors.
    """

    law_W: FloatArray
    z: FloatArray
    nuts: tuple[moving.NutState, ...]
    turns: tuple[Records, ...]
    begin_s: float
    last_s: float
    running_s: FloatArray


class Driving(NamedTuple):
    """The inputs of the open loop in K steps.

    Attributes:
        law_W: Heats by law, mean over each step, W, (K, m).
        law_jump_W: Their change since the step before, W, (K, m).
        z_start: Known inputs at the beginning of each step, °C, (K, p).
        z_end: Known inputs at its end, °C, (K, p).
        loss_1_s: Rate of the uniform loss by speed, 1/s, (K,).
        loss_degC: Temperature that it approaches, °C, (K,).
    """

    law_W: FloatArray
    law_jump_W: FloatArray
    z_start: FloatArray
    z_end: FloatArray
    loss_1_s: FloatArray
    loss_degC: FloatArray


class Drive:
    """The plant's reading of the channels; has no state of its own.

    Attributes:
        losses: Losses that depend on the speed.
        displaces: Whether a sensor measures displacement.
        read: Record of `ColumnsRead` for the last channels; None before any.
    """

    def __init__(self, config: Config, plant: Plant) -> None:
        """Assign the channels to the inputs.

        Args:
            config: The machine with its effects.
            plant: Its model.

        Raises:
            ConfigError: If an effect is impossible on this machine.
        """
        machine = realise(config)
        config = machine.config
        self._plant = plant
        self._factors = [
            [t.factor for t in machine.terms if isinstance(t, LawFactor) and t.source == s.own_or_followed]
            for s in config.source
        ]
        self.losses = [t for t in machine.terms if isinstance(t, SpeedLoss)]
        self._surface_rate = surface_rate(config.screw)
        self._sensor_channels = [s.channel for s in config.sensor]
        self._scale = np.array([s.channel_scale for s in config.sensor])
        self.displaces = not plant.thermal.all()
        self._laws: list[tuple[tuple[str, ...], Law]] = [
            (law_channels(s, config.source), heat_law(s, config.source, config.screw.length_m))
            for s in config.source
        ]
        self._known = plant.known
        read = {
            AMBIENT: config.ambient.channel,
            LEFT: config.boundary.left.channel,
            RIGHT: config.boundary.right.channel,
            BED: None if config.bed is None else config.bed.channel,
        }
        self._known_channels = [read.get(name) for name in plant.known_names]
        rate = {AMBIENT: sum(t.rate_K_h for t in machine.terms if isinstance(t, AmbientShift))}
        shift = {AMBIENT: sum(t.offset_K for t in machine.terms if isinstance(t, AmbientShift))}
        fixed = {AMBIENT: config.ambient.temperature_degC, REFERENCE: config.output.reference_degC}
        offsets = [t for t in machine.terms if isinstance(t, SensorOffset)]
        for s in config.sensor:
            sensor_offsets = [t for t in offsets if t.sensor == s.name]
            fixed[OFFSET + s.name] = sum(t.offset_K for t in sensor_offsets)
            rate[OFFSET + s.name] = sum(t.rate_K_h for t in sensor_offsets)
        self._known_fixed = [fixed.get(name) for name in plant.known_names]
        self._shift_K = np.array([shift.get(name, 0.0) for name in plant.known_names])
        self._rate_K_h = np.array([rate.get(name, 0.0) for name in plant.known_names])
        required = [c for read, _ in self._laws for c in read]
        required += [*self._known_channels, *(s.channel for s in plant.moving)]  # type: ignore[list-item]
        for loss in self.losses:
            required += [loss.speed_channel, loss.temperature_channel]  # type: ignore[list-item]
        self._needed = [c for c in dict.fromkeys(required) if c is not None]
        self._channels: tuple[str, ...] | None = None  # of the last frames, and where they hold what is read
        self.read: Any = None

    def initial(self) -> DriveState:
        """Return the state before the first frame: constants known, channels NaN."""
        z = np.array([np.nan if fixed is None else fixed for fixed in self._known_fixed])
        return DriveState(
            law_W=np.full(len(self._laws), np.nan),
            z=z,
            nuts=tuple(moving.start(s.table) for s in self._plant.moving),
            turns=tuple(moving.no_path_yet() for _ in self._plant.moving),
            begin_s=np.nan,
            last_s=np.nan,
            running_s=np.zeros(len(self._laws)),
        )

    def run(self, state: DriveState, frames: FrameBlock) -> tuple[DriveState, Inputs]:
        """Return the state after K frames and the inputs of the K steps they end.

        Args:
            state: The state after the frame before.
            frames: At least one frame with all channels that the model reads.

        Raises:
            KeyError: If a channel that the model reads is missing.
        """
        desk, begin_s, running_s = self._driven(state, frames)
        nuts, turns, moving_B, moving_C = self._nuts(state, frames)
        inputs = Inputs(
            frames.time_s, frames.dt_s, desk.y_degC, desk.usable, desk.sensor_quality, desk.law_W,
            desk.jump_W, desk.z_start, desk.z_end, moving_B, moving_C, desk.degraded,
            *self.loss(frames.values, desk.z_end[:, self._known.ambient]),
        )  # fmt: skip
        last_s = float(frames.time_s[-1])
        return DriveState(desk.law[-1], desk.z[-1], nuts, turns, begin_s, last_s, running_s), inputs

    def open_loop(self, frames: FrameBlock) -> Driving:
        """Return the inputs of a plant in a log, without readings and columns of nuts.

        Args:
            frames: The log from its first frame on; running times begin at 0.
        """
        desk, _, _ = self._driven(self.initial(), frames)
        losses = self.loss(frames.values, desk.z_end[:, self._known.ambient])
        return Driving(desk.law_W, desk.jump_W, desk.z_start, desk.z_end, *losses)

    def _driven(self, state: DriveState, frames: FrameBlock) -> tuple[DriveDesk, float, FloatArray]:
        """Inputs and readings of K steps, the time of the first frame, and the running time of each law."""
        self.set_channels(frames.channels)
        desk = _desk(frames, state, len(self._sensor_channels))
        running_s = self.heats(desk.law, frames.values, frames.dt_s, state.running_s)
        begin_s = float(frames.time_s[0]) if math.isnan(state.begin_s) else state.begin_s
        fill_inputs(self.read, record(desk), begin_s, state.last_s)
        self.displace(desk.time_s, desk.y_degC, desk.usable, begin_s)
        return desk, begin_s, running_s

    def displace(self, time_s: FloatArray, y_degC: FloatArray, usable: BoolArray, begin_s: float) -> None:
        """Convert the readings of displacements to µm, in place, and mark which of them are usable.

        An estimate starts from temperatures. So a displacement is usable after the first frame, once a
        thermocouple has had a value.

        Args:
            time_s: Times of the frames, s, (K,).
            y_degC: Readings in the units of their channels, (K, s).
            usable: True for readings that may correct, (K, s), changed in place.
            begin_s: Time of the first frame, s.
        """
        if self.displaces:
            thermal = self._plant.thermal
            y_degC *= self._scale
            started = np.isfinite(y_degC[:, thermal]).any(axis=1) & (time_s > begin_s)
            usable[:, ~thermal] &= started[:, None]

    def set_channels(self, channels: tuple[str, ...]) -> None:
        """Find the columns of frames with these channels; nothing happens for the same tuple as before.

        Raises:
            KeyError: If a channel that the model reads is missing.
        """
        if channels is not self._channels:
            self._channels, self.read = channels, record(self._places(channels))

    def _places(self, channels: tuple[str, ...]) -> ColumnsRead:
        """The columns of frames with these channels."""
        at: dict[str | None, int] = {name: i for i, name in enumerate(channels)}
        self._law_columns = [[at[c] for c in read] for read, _ in self._laws]
        self._loss_columns = [(at.get(x.speed_channel), at.get(x.temperature_channel)) for x in self.losses]

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

    def heats(
        self,
        law: FloatArray,
        values: FloatArray,
        dt_s: FloatArray,
        running_s: FloatArray,
    ) -> FloatArray:
        """Fill in the heats by the laws at each tick, W, NaN before the first value.

        Args:
            law: Heats of all m sources, W, (K, m), changed in place.
            values: Values of the channels, (K, channels).
            dt_s: Lengths of the steps, s, (K,).
            running_s: Running time of each law before, s, (m,).

        Returns:
            The running time of each law after the last tick, s, (m,).
        """
        for j in range(len(self._laws)):
            read = [values[:, i] for i in self._law_columns[j]] or [np.zeros(len(values))]
            law[:, j] = self._laws[j][1](*read)
            if factors := self._factors[j]:
                ran = np.where(np.nan_to_num(read[0]) != 0.0, dt_s, 0.0)
                ran_s = np.cumsum(np.concatenate([running_s[j : j + 1], ran]))[1:]
                running_s = running_s.copy()
                running_s[j] = ran_s[-1]
                for factor in factors:
                    law[:, j] *= factor(read[0], ran_s)
        return running_s

    def loss(self, values: FloatArray, ambient_degC: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the rate of the losses by speed, 1/s, (K,), and the temperature that they approach, °C,
        (K,).

        Args:
            values: Values of the channels, (K, channels). A missing speed counts as 0. A measured temperature
                is replaced by the ambient's before its first value.
            ambient_degC: Temperature of the air, °C, (K,).
        """
        rate, drawn = np.zeros(len(values)), np.zeros(len(values))
        if not self.losses:
            return rate, drawn
        for loss, (speed, measured) in zip(self.losses, self._loss_columns, strict=True):
            speed_rpm = np.zeros(len(values)) if speed is None else np.nan_to_num(values[:, speed])
            own_rate_1_s = self._surface_rate * loss.film_W_m2K(speed_rpm)
            rate += own_rate_1_s
            if measured is None:
                drawn += own_rate_1_s * (
                    ambient_degC if loss.temperature_degC is None else loss.temperature_degC
                )
            else:
                drawn += own_rate_1_s * np.where(
                    np.isnan(values[:, measured]), ambient_degC, values[:, measured]
                )
        return rate, np.where(rate > 0.0, drawn / np.where(rate > 0.0, rate, 1.0), 0.0)

    def _nuts(
        self, state: DriveState, frames: FrameBlock
    ) -> tuple[tuple[moving.NutState, ...], tuple[Records, ...], FloatArray, FloatArray]:
        """The averaged columns of every moving source: states, (K, M, n_x), (K, M, R)."""
        plant = self._plant
        B, C, nuts, turns = [], [], [], list(state.turns)
        for i, source in enumerate(plant.moving):
            path = frames.path[source.channel]
            nut, mean_B, mean_C = moving.columns(source.table, state.nuts[i], frames.dt_s, path)
            if source.ends_fraction:
                turns[i], mean_B, mean_C = turned(source, turns[i], frames.dt_s, path, mean_B, mean_C)
            nuts.append(nut)
            B.append(mean_B)
            C.append(mean_C)
        moving_B = _stacked(B, len(frames), len(plant.decay_1_s))
        moving_C = _stacked(C, len(frames), len(plant.rows.C))
        return tuple(nuts), tuple(turns), moving_B, moving_C


class ColumnsRead(NamedTuple):
    """Columns of the frames that the model reads.

    Attributes:
        sensors: Columns of the sensors, (s,).
        inputs: Columns of the known inputs, −1 without a channel, (p,).
        shift_K: Offsets of the known inputs from their channels, (p,).
        rate_K_h: Rates of these offsets, (p,).
        required: Columns of all the model's inputs.
        nuts: Columns of the nuts' positions, (M,).
        ambient: Number of the ambient among the known inputs.
        reference: Number of the reference among them, −1 without one.
    """

    sensors: NDArray[np.int64]
    inputs: NDArray[np.int64]
    shift_K: FloatArray
    rate_K_h: FloatArray
    required: NDArray[np.int64]
    nuts: NDArray[np.int64]
    ambient: int
    reference: int


class DriveDesk(NamedTuple):
    """Inputs and outputs of the kernel for K frames; other names and shapes as in `FrameBlock` and `Inputs`.

    Attributes:
        law_before_W: Heats by law after the frame before, W, (m,).
        z_before: Known inputs after the frame before, (p,).
        law: Heats by law at the ticks, W, (K, m).
        z: Known inputs at the ticks, (K, p).
        jump_W: Change of the laws since the step before, W, (K, m).
        degraded: 1 where an input is missing or held, (K,).
    """

    time_s: FloatArray
    values: FloatArray
    fresh: BoolArray
    quality: QualityArray
    law_before_W: FloatArray
    z_before: FloatArray
    law: FloatArray
    z: FloatArray
    z_start: FloatArray
    z_end: FloatArray
    law_W: FloatArray
    jump_W: FloatArray
    y_degC: FloatArray
    usable: BoolArray
    sensor_quality: QualityArray
    degraded: NDArray[np.int8]


def _desk(frames: FrameBlock, state: DriveState, s: int) -> DriveDesk:
    """The desk of some frames and a state; both share their memory."""
    k, m, p = len(frames), len(state.law_W), len(state.z)
    read = (frames.time_s, frames.values, frames.fresh, frames.quality, state.law_W, state.z)
    numbers = (np.empty((k, width)) for width in (m, p, p, p, m, m, s))
    flags = np.empty((k, s), np.bool_), np.empty((k, s), np.int8), np.empty(k, np.int8)
    return DriveDesk._make([*map(packed, read), *numbers, *flags])


def turned(
    source: MovingSource, turn: Records, dt_s: FloatArray, path: NutPath, B: FloatArray, C: FloatArray
) -> tuple[Records, FloatArray, FloatArray]:
    """Return the averaged columns of a nut of which a share of the heat enters at the reversals.

    Args:
        source: The nut; the share is its `ends_fraction`.
        turn: Memory of its path.
        dt_s: Lengths of the steps, s, (K,).
        path: Samples of its position.
        B: Input columns along the path, (K, n_x).
        C: Output columns along the path, (K, R).

    Returns:
        The memory after the last step, and the columns.
    """
    turn, ends_B, ends_C = moving.columns_at_ends(source.table, turn, dt_s, path)
    return turn, B + source.ends_fraction * (ends_B - B), C + source.ends_fraction * (ends_C - C)


def _stacked(columns: list[FloatArray], steps: int, width: int) -> FloatArray:
    """Columns (K, width) of M sources as (K, M, width)."""
    if len(columns) == 1:
        return columns[0][:, None]
    return np.stack(columns, axis=1) if columns else np.empty((steps, 0, width))
