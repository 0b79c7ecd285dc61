"""From frames to what drives the plant: sensor rows, heats by law, known inputs, the moving nut's columns.

Pure: `run(state, frames)` returns the next state and the inputs of K steps, and K steps give the same bits
as K runs of one. What is missing is held at its last value and the step is marked, never filled in
silently.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.config import Config
from observer.effects.terms import AmbientShift, LawFactor, Offset, SpeedLoss, Term
from observer.frames import FloatArray, FrameBlock, Inputs, Quality
from observer.model.couple import surface_rate
from observer.model.law import Law, heat_law
from observer.model.plant import OFFSET, Plant
from observer.model.realise import realise
from observer.model.rod import moving, turning
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


class Drive:
    """The plant's reading of the channels; holds no state of its own."""

    def __init__(self, config: Config, plant: Plant, *, follow_nuts: bool = True) -> None:
        """Fix, once, which channel feeds which input.

        Without `follow_nuts` the moving columns are left out (M = 0): for who has them already.
        """
        self._follow_nuts = follow_nuts
        machine = realise(config)
        config = machine.config
        self._plant = plant
        self._factors = _law_factors(plant, machine.terms)
        self._losses = [t for t in machine.terms if isinstance(t, SpeedLoss)]
        self._surface_rate = surface_rate(config.screw)
        self._sensor_channels = [s.channel for s in config.sensor]
        self._laws: list[tuple[tuple[str, ...], Law]] = [
            (law_channels(s, config.source), heat_law(s, config.source, config.screw.length_m))
            for s in config.source
        ]
        ends = {"left": config.boundary.left.channel, "right": config.boundary.right.channel}
        self._known_channels = [ends.get(name) for name in plant.known_names]
        self._known_channels[0] = config.ambient.channel
        fixed = {"ambient": config.ambient.temperature_degC, "reference": config.output.reference_degC}
        fixed |= {OFFSET + s.name: _offset_K(s.name, machine.terms) for s in config.sensor}
        self._known_fixed = [fixed.get(name) for name in plant.known_names]
        rate = {OFFSET + s.name: _drift_K_h(s.name, machine.terms) for s in config.sensor}
        rate["ambient"] = sum(t.rate_K_h for t in machine.terms if isinstance(t, AmbientShift))
        self._rate_K_h = np.array([rate.get(name, 0.0) for name in plant.known_names])
        needed = [c for read, _ in self._laws for c in read]
        needed += [*self._known_channels, *(s.channel for s in plant.moving)]  # type: ignore[list-item]
        needed += [loss.speed_channel for loss in self._losses]
        self._needed = [c for c in dict.fromkeys(needed) if c is not None]

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
        at = {name: i for i, name in enumerate(frames.channels)}
        sensors = [at[c] for c in self._sensor_channels]
        quality = frames.quality[:, sensors]
        law, running_s = self._law(frames, at, state)
        law_before = _before(law, state.law_W)
        known = self._known(frames, at, state)
        begin_s = float(frames.time_s[0]) if np.isnan(state.begin_s) else state.begin_s
        hours = (frames.time_s - begin_s) / 3600.0
        hours_before = _before(hours[:, None], np.array([state.last_s - begin_s]) / 3600.0)
        z = known + hours[:, None] * self._rate_K_h
        z_before = _before(known, state.z) + hours_before * self._rate_K_h
        loss_1_s, loss_degC = self._loss(frames, at, z[:, 0])
        nuts, turns, moving_B, moving_C = self._nuts(state, frames)
        ready = np.asarray(np.isfinite(z).all(axis=1))
        inputs = Inputs(
            time_s=frames.time_s,
            dt_s=frames.dt_s,
            y_degC=frames.values[:, sensors],
            usable=frames.fresh[:, sensors] & np.equal(quality, int(Quality.GOOD)) & ready[:, None],
            quality=quality,
            law_W=(law_before + law) / 2,
            law_jump_W=law - law_before,
            z_start=np.where(np.isnan(z_before), z, z_before),
            z_end=z,
            moving_B=moving_B,
            moving_C=moving_C,
            degraded=self._degraded(frames, at),
            loss_1_s=loss_1_s,
            loss_degC=loss_degC,
        )
        last_s = float(frames.time_s[-1])
        return DriveState(law[-1], known[-1], nuts, turns, begin_s, last_s, running_s), inputs

    def _law(
        self, frames: FrameBlock, at: dict[str, int], state: DriveState
    ) -> tuple[FloatArray, FloatArray]:
        """Each source's heat by its law at each tick, (K, m), W, and how long it has run; a channel not yet
        seen means standstill.
        """
        law = np.zeros((len(frames), len(self._laws)))
        running_s = state.running_s.copy()
        for j, (channels, heat_W) in enumerate(self._laws):
            read = [frames.values[:, at[c]] for c in channels] or [np.zeros(len(frames))]
            law[:, j] = heat_W(*read)
            if self._factors[j]:
                ran = np.where(np.nan_to_num(read[0]) != 0.0, frames.dt_s, 0.0)
                ran_s = np.cumsum(np.concatenate([running_s[j : j + 1], ran]))[1:]
                running_s[j] = ran_s[-1]
            for factor in self._factors[j]:
                law[:, j] *= factor(read[0], ran_s)
            law[np.isnan(law[:, j]), j] = 0.0 if np.isnan(state.law_W[j]) else state.law_W[j]
        return law, running_s

    def _loss(
        self, frames: FrameBlock, at: dict[str, int], ambient_degC: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The rate (K,) of the losses that go with speed, 1/s, and the temperature (K,) they draw to, °C."""
        rate, drawn = np.zeros(len(frames)), np.zeros(len(frames))
        if not self._losses:
            return rate, drawn
        for loss in self._losses:
            speed_rpm = np.nan_to_num(frames.values[:, at[loss.speed_channel]])
            own = self._surface_rate * loss.film_W_m2K(speed_rpm)
            rate += own
            drawn += own * (ambient_degC if loss.temperature_degC is None else loss.temperature_degC)
        return rate, np.where(rate > 0.0, drawn / np.where(rate > 0.0, rate, 1.0), 0.0)

    def _known(self, frames: FrameBlock, at: dict[str, int], state: DriveState) -> FloatArray:
        """The known inputs at each tick, (K, p), °C; the error's reference is the first ambient unless it
        is given.
        """
        z = np.empty((len(frames), len(state.z)))
        z[:] = state.z
        for i, channel in enumerate(self._known_channels):
            if channel is not None:
                z[:, i] = frames.values[:, at[channel]]
        if np.isnan(state.z[-1]):
            known = np.flatnonzero(np.isfinite(z[:, 0]))
            if len(known):
                z[known[0] :, -1] = z[known[0], 0]
        return z

    def _nuts(
        self, state: DriveState, frames: FrameBlock
    ) -> tuple[tuple[moving.NutState, ...], tuple[PathState, ...], FloatArray, FloatArray]:
        """The averaged columns of every moving source: states, (K, M, n_x), (K, M, R)."""
        plant = self._plant
        followed = plant.moving if self._follow_nuts else ()
        B = np.empty((len(frames), len(followed), len(plant.decay_1_s)))
        C = np.empty((len(frames), len(followed), len(plant.rows.C)))
        nuts, turns = [], list(state.turns)
        for i, source in enumerate(followed):
            nut, B[:, i], C[:, i] = moving.columns(
                source.table, state.nuts[i], frames.dt_s, frames.path[source.channel]
            )
            if source.ends_fraction:
                turns[i], ends_B, ends_C = turning.columns(
                    source.table, turns[i], frames.dt_s, frames.path[source.channel]
                )
                B[:, i] += source.ends_fraction * (ends_B - B[:, i])
                C[:, i] += source.ends_fraction * (ends_C - C[:, i])
            nuts.append(nut)
        return tuple(nuts), tuple(turns), B, C

    def _degraded(self, frames: FrameBlock, at: dict[str, int]) -> NDArray[np.int8]:
        """Whether some input other than a sensor was missing, late or refused at each tick, and whether that
        was a nut's position, (K,), as in `Inputs`.
        """
        bad = np.asarray(frames.quality != int(Quality.GOOD))
        held = bad[:, [at[c] for c in self._needed]].any(axis=1)
        lost = bad[:, [at[s.channel] for s in self._plant.moving]].any(axis=1)
        return np.asarray(np.where(lost, 2, held), dtype=np.int8)


def _law_factors(
    plant: Plant, terms: Sequence[Term]
) -> list[list[Callable[[FloatArray, FloatArray], FloatArray]]]:
    """The factors on each source's law."""
    return [
        [t.factor for t in terms if isinstance(t, LawFactor) and t.source == name]
        for name in plant.source_names
    ]


def _offset_K(sensor: str, terms: Sequence[Term]) -> float:
    return sum(t.offset_K for t in terms if isinstance(t, Offset) and t.sensor == sensor)


def _drift_K_h(sensor: str, terms: Sequence[Term]) -> float:
    return sum(t.rate_K_h for t in terms if isinstance(t, Offset) and t.sensor == sensor)


def _before(now: FloatArray, first: FloatArray) -> FloatArray:
    """Return the rows (K, n) one step earlier; `first` (n,) comes before the first, itself where unknown."""
    before = np.empty_like(now)
    before[1:] = now[:-1]
    before[0] = np.where(np.isnan(first), now[0], first)
    return before
