"""A rough machine that is probed each hour, or followed by a scale, against the same day without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from observer.files.logs import Log
from tests.learning.cover import estimates_of_log, judged_estimates, log_of
from tests.learning.housings import draw_housed
from tests.learning.machines import GRID_M, Day, Rough, config_of, day, draw
from tests.logs.machines import probe
from tests.truth.machine.machine import stream

PROBE_M, NOISE_UM, ZERO_UM = 0.9, 0.7, 1.0
EVERY_S, BURST = 3600.0, 3
PROBE = probe("probe", PROBE_M, NOISE_UM, ZERO_UM, occasional=True)
LEAD_UM, PLAY_UM, SCALE_NOISE_UM = 1.7, 4.0, 1.0
SCALE = """
[[sensor]]
name = "scale"
kind = "displacement"
channel = "scale_um"
along = "nut"
noise_um = 1.0
zero_um = 3.0
"""


def probed(seed: int, number: int, run: str, *, housed: bool = False) -> tuple[Day, Log]:
    """Run a rough machine, with the log of a probe: three readings each hour, the first after half of one.

    `housed` has its sensors on nut and housings, by links 20 % off; else five are on the screw.
    """
    machine = draw_housed(seed, number, 0.2) if housed else draw(seed, number, Rough())
    one = day(machine, seed, number, run)
    cycles_s = np.arange(one.time_s[0] + 0.5 * EVERY_S, one.time_s[-1], EVERY_S)
    rows = np.concatenate([np.searchsorted(one.time_s, s) + 4 * np.arange(BURST) for s in cycles_s])
    at = rows[rows < len(one.time_s)]
    return one, probed_log(one, at, stream(seed, "probe", str(number)))


def probed_log(one: Day, at: NDArray[np.int64], rng: np.random.Generator) -> Log:
    """A day as its user's log with readings of a probe in rows `at`."""
    log, readings = log_of(one), np.full(len(one.time_s), np.nan)
    zero_um = ZERO_UM * rng.standard_normal()
    true_um = np.array([np.interp(PROBE_M, GRID_M, row) for row in one.error_um[at]])
    readings[at] = true_um + zero_um + NOISE_UM * rng.standard_normal(len(at))
    values = np.column_stack([log.values, readings])
    return replace(log, path=Path("probed.csv"), channels=(*log.channels, "probe_um"), values=values)


def scaled_log(one: Day, rng: np.random.Generator) -> Log:
    """A day as its user's log with a scale less an encoder: also the screw's errors of lead, and on the way
    back the play of the drive.
    """
    log = log_of(one)
    true_um = [np.interp(at_m, GRID_M, row) for at_m, row in zip(one.nut_m, one.error_um, strict=True)]
    turns, phases = 2.0 * np.pi * one.nut_m / 0.6, rng.uniform(0.0, 2.0 * np.pi, 3)
    lead_um = sum(
        LEAD_UM * rng.standard_normal() * np.sin(k * turns + phase) for k, phase in enumerate(phases, 1)
    )
    back = np.diff(one.nut_m, prepend=one.nut_m[0]) < 0.0
    noise_um = SCALE_NOISE_UM * rng.standard_normal(len(back))
    values = np.column_stack([log.values, true_um + lead_um - PLAY_UM * back + noise_um])
    return replace(log, path=Path("scaled.csv"), channels=(*log.channels, "scale_um"), values=values)


def gained(
    day: Day, log: Log, text: str, more: str, from_s: float
) -> list[dict[str, tuple[float, float, float]]]:
    """How a day is judged without and with more sensors in the configuration: see `judged`."""
    found = (estimates_of_log(config_of(one), log) for one in (text, text + more))
    return [judged_estimates(block, day, from_s) for block in found]
