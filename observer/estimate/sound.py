"""Logs without their doubtful parts, for a fit.

A row is doubtful where an input of the model is missing, stale or rejected, or where the nut's place is not
known. A sensor is doubtful while the estimator excludes it. How good the estimates are does not matter:
before a calibration they may never be good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.errors import UserError
from observer.estimate.pipeline import MachineModel
from observer.fit.runs import joined, thinned, without_rows
from observer.frames import BoolArray, FrameBlock, Quality

SCREENED_S = 1.0
"""Least time between two rows in which sensors are compared with each other."""


class SoundFrames(NamedTuple):
    """The frames of a log without its doubtful parts, and a sentence for each part that is left out."""

    frames: FrameBlock
    left_out: tuple[str, ...]


def sound_frames(config: Config, blocks: Sequence[FrameBlock], name: str) -> SoundFrames:
    """Return the sound part of the frames of a log; `name` is named in the sentences.

    The frames are unchanged where nothing is doubtful, or every row is.
    """
    frames, machine = joined(blocks), MachineModel.of(config, learns=True)
    _, inputs = machine.drive.run(machine.drive.initial(), frames)
    test = machine.self_test()
    degraded = test.watch(test.initial(), frames, inputs)[2].degraded > 0
    frames, left_out = _without_excluded(machine, frames, name)
    if not degraded.any() or degraded.all():
        return SoundFrames(frames, left_out)
    lost_s, total_s = float(frames.dt_s[degraded].sum()), float(frames.dt_s.sum())
    causes = " and ".join(_lost_inputs(config, frames, degraded))
    sentence = (
        f"{name}: {lost_s:.0f} s of {total_s:.0f} s are left out, because {causes} could not be trusted"
    )
    return SoundFrames(without_rows(frames, degraded), (*left_out, sentence))


def _lost_inputs(config: Config, frames: FrameBlock, degraded: BoolArray) -> list[str]:
    """The inputs without a usable value in doubtful rows (K,); the nuts' positions where each has one."""
    sensors = {sensor.channel for sensor in config.sensor}
    bad = (frames.quality[degraded] != Quality.GOOD).any(axis=0)
    lost = [name for name, is_bad in zip(frames.channels, bad, strict=True) if is_bad and name not in sensors]
    return lost or list(frames.path)


def _without_excluded(
    machine: MachineModel, frames: FrameBlock, name: str
) -> tuple[FrameBlock, tuple[str, ...]]:
    """The frames without the readings of sensors while they are excluded, and a sentence about each."""
    excluded = _excluded(machine, frames)
    if not excluded.any():
        return frames, ()
    fresh, sentences = frames.fresh.copy(), []
    for sensor, rows in zip(machine.config.sensor, excluded.T, strict=True):
        if rows.any():
            fresh[rows, frames.channels.index(sensor.channel)] = False
            seconds = float(frames.dt_s[rows].sum())
            sentences.append(
                f"{name}: {sensor.name} is left out for {seconds:.0f} s, because it disagrees with the other "
                "sensors"
            )
    return replace(frames, fresh=fresh), tuple(sentences)


def _excluded(machine: MachineModel, frames: FrameBlock) -> BoolArray:
    """Which readings (K, s) are of a sensor that the estimator excludes."""
    nothing = np.zeros((len(frames), len(machine.config.sensor)), np.bool_)
    config = machine.config
    if not (config.integrity.enabled and config.estimator.screens):
        return nothing
    every = thinned(frames, max(config.estimator.period_s, SCREENED_S))
    try:
        quality = machine.pipeline().step(every).sensor_quality
    except UserError:  # no estimator for this machine, and so none that excludes
        return nothing
    row = np.searchsorted(every.time_s, frames.time_s).clip(max=len(every) - 1)
    return np.asarray((quality == Quality.EXCLUDED)[row])
