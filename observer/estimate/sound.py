"""Logs without their doubtful parts, for a fit.

A row is doubtful if an input of the model is missing, stale or rejected, or if the nut's position is unknown.
A sensor is doubtful while the estimator excludes it. The quality of the estimates has no influence, because
it may never be good before a calibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.errors import UserError
from observer.estimate.pipeline import MachineModel
from observer.fit.runs import joined, thinned, without_rows
from observer.frames import BoolArray, FrameBlock, Quality

SCREENED_S = 1.0
"""Shortest time between two rows in which sensors are compared with each other."""


class SoundFrames(NamedTuple):
    """The frames of a log without its doubtful parts.

    Attributes:
        frames: The frames.
        left_out: A sentence for each omitted part: the log, its duration, and the reason.
    """

    frames: FrameBlock
    left_out: tuple[str, ...]


def sound_frames(config: Config, blocks: Sequence[FrameBlock], name: str) -> SoundFrames:
    """Return the sound part of the frames of a log.

    The frames are unchanged if no row or every row is doubtful.

    Args:
        config: The configuration.
        blocks: The frames of the log, in order.
        name: The log's name, for the sentences.
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
    """Return the inputs without a usable value in doubtful rows (K,), else the nuts' positions."""
    sensors = {sensor.channel for sensor in config.sensor}
    bad = (frames.quality[degraded] != Quality.GOOD).any(axis=0)
    lost = [name for name, is_bad in zip(frames.channels, bad, strict=True) if is_bad and name not in sensors]
    return lost or list(frames.path)


def _without_excluded(
    machine: MachineModel, frames: FrameBlock, name: str
) -> tuple[FrameBlock, tuple[str, ...]]:
    """Return the frames without the readings of excluded sensors, and a sentence about each sensor."""
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
    """Return the mask (K, s) of readings of a sensor while the estimator excludes it."""
    not_excluded = np.zeros((len(frames), len(machine.config.sensor)), np.bool_)
    config = machine.config
    if not (config.integrity.enabled and config.estimator.screens):
        return not_excluded
    compared = thinned(frames, max(config.estimator.period_s, SCREENED_S))
    try:
        quality = machine.pipeline().step(compared).sensor_quality
    except UserError:  # no estimator for this machine, and so none that excludes
        return not_excluded
    row = np.searchsorted(compared.time_s, frames.time_s).clip(max=len(compared) - 1)
    return np.asarray((quality == Quality.EXCLUDED)[row])
