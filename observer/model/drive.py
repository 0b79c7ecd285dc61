"""From frames to what drives the plant: sensor rows, heats by law, known inputs, the moving nut's columns.

Pure: `run(state, frames)` returns the next state and the inputs of K steps, and K steps give the same bits
as K runs of one. What is missing is held at its last value and the step is marked, never filled in
silently.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from observer.config import Config
from observer.frames import BoolArray, FloatArray, FrameBlock, Inputs, Quality
from observer.model.heat.law import heat_law, law_channel
from observer.model.plant import Plant
from observer.model.rod import moving


@dataclass(frozen=True, slots=True)
class DriveState:
    """What the drive remembers between steps.

    `law_W` (m,) and `z` (p,), NaN before they are first known; `nuts`, one state per moving source.
    """

    law_W: FloatArray
    z: FloatArray
    nuts: tuple[moving.NutState, ...]


class Drive:
    """The plant's reading of the channels; holds no state of its own."""

    def __init__(self, config: Config, plant: Plant) -> None:
        """Fix, once, which channel feeds which input."""
        self._plant = plant
        self._sensor_channels = [s.channel for s in config.sensor]
        self._laws: list[tuple[str | None, Callable[[FloatArray], FloatArray]]] = [
            (law_channel(s), heat_law(s)) for s in config.source
        ]
        ends = {"left": config.boundary.left.channel, "right": config.boundary.right.channel}
        self._known_channels = [ends.get(name) for name in plant.known_names]
        self._known_channels[0] = config.ambient.channel
        fixed = {"ambient": config.ambient.temperature_degC, "reference": config.output.reference_degC}
        self._known_fixed = [fixed.get(name) for name in plant.known_names]
        needed = [c for c, _ in self._laws] + self._known_channels + [s.channel for s in plant.moving]
        self._needed = [c for c in dict.fromkeys(needed) if c is not None]

    def initial(self) -> DriveState:
        """Return the state before the first frame."""
        z = np.array([np.nan if fixed is None else fixed for fixed in self._known_fixed])
        return DriveState(
            np.full(len(self._laws), np.nan), z, tuple(moving.start(s.table) for s in self._plant.moving)
        )

    def run(self, state: DriveState, frames: FrameBlock) -> tuple[DriveState, Inputs]:
        """Return the state after K frames and the inputs of the K steps they end."""
        at = {name: i for i, name in enumerate(frames.channels)}
        sensors = [at[c] for c in self._sensor_channels]
        quality = frames.quality[:, sensors]
        law = self._law(frames, at, state)
        law_before = _before(law, state.law_W)
        z = self._known(frames, at, state)
        z_before = _before(z, state.z)
        nuts, moving_B, moving_C = self._nuts(state, frames)
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
        )
        return DriveState(law[-1], z[-1], nuts), inputs

    def _law(self, frames: FrameBlock, at: dict[str, int], state: DriveState) -> FloatArray:
        """Each source's heat by its law at each tick, (K, m), W; a channel not yet seen means standstill."""
        law = np.zeros((len(frames), len(self._laws)))
        for j, (channel, heat_W) in enumerate(self._laws):
            if channel is not None:
                law[:, j] = heat_W(frames.values[:, at[channel]])
                law[np.isnan(law[:, j]), j] = 0.0 if np.isnan(state.law_W[j]) else state.law_W[j]
        return law

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
    ) -> tuple[tuple[moving.NutState, ...], FloatArray, FloatArray]:
        """The averaged columns of every moving source: states, (K, M, n_x), (K, M, R)."""
        plant = self._plant
        B = np.empty((len(frames), len(plant.moving), len(plant.decay_1_s)))
        C = np.empty((len(frames), len(plant.moving), len(plant.rows.C)))
        nuts = []
        for i, source in enumerate(plant.moving):
            nut, B[:, i], C[:, i] = moving.columns(
                source.table, state.nuts[i], frames.dt_s, frames.path[source.channel]
            )
            nuts.append(nut)
        return tuple(nuts), B, C

    def _degraded(self, frames: FrameBlock, at: dict[str, int]) -> BoolArray:
        """Whether some input other than a sensor was missing, late or refused at each tick, (K,)."""
        needed = [at[c] for c in self._needed]
        bad = np.asarray(frames.quality != int(Quality.GOOD))
        return np.asarray(bad[:, needed].any(axis=1))


def _before(now: FloatArray, first: FloatArray) -> FloatArray:
    """Return the rows (K, n) one step earlier; `first` (n,) comes before the first, itself where unknown."""
    before = np.empty_like(now)
    before[1:] = now[:-1]
    before[0] = np.where(np.isnan(first), now[0], first)
    return before
