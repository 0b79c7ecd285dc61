"""A rough machine that is probed each hour, or followed by a scale, against the same day without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.files.logs import Log
from observer.frames import FloatArray
from tests.learning.cover import estimates_of_log, log_of
from tests.learning.housings import HOUSED_CONFIG, draw_housed
from tests.learning.machines import CONFIG, GRID_M, Day, Rough, config_of, day, draw
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


class Probed(NamedTuple):
    """A day, its log with a probe's channel, and the times of the first probing of each cycle."""

    day: Day
    log: Log
    cycles_s: FloatArray


def probed(seed: int, number: int, run: str, *, housed: bool) -> Probed:
    """Run a rough machine; a probing cycle of three readings comes each hour, the first after half of one.

    `housed` has its sensors on nut and housings, by links 20 % off; else five are on the screw.
    """
    machine = draw_housed(seed, number, 0.2) if housed else draw(seed, number, Rough())
    one = day(machine, seed, number, run)
    cycles_s = np.arange(one.time_s[0] + 0.5 * EVERY_S, one.time_s[-1], EVERY_S)
    rows = np.concatenate([np.searchsorted(one.time_s, s) + 4 * np.arange(BURST) for s in cycles_s])
    at = rows[rows < len(one.time_s)]
    return Probed(one, probed_log(one, at, stream(seed, "probe", str(number))), cycles_s)


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


class Gain(NamedTuple):
    """Over what comes after the first probing: rms of error in µm and field in K, without and with the probe,
    the mean σ of the error in µm, and how often 95 % intervals of it hold.
    """

    error_um: tuple[float, float]
    field_K: tuple[float, float]
    sigma_um: tuple[float, float]
    covered: tuple[float, float]


def gain(one: Probed, *, housed: bool) -> Gain:
    """Estimate a day without and with its probe."""
    own = HOUSED_CONFIG if housed else CONFIG
    return gained(one.day, one.log, (own, own + PROBE), one.cycles_s[0] + 60.0)


def gained(day: Day, log: Log, texts: tuple[str, str], from_s: float) -> Gain:
    """Estimate a day by two configurations, and hold both against the truth from a time on."""
    late = day.time_s > from_s
    error, field, sigma, covered = [], [], [], []
    for text in texts:
        found = estimates_of_log(config_of(text), log)
        off_um = (found.error_um - day.error_um)[late, 1:]
        error.append(float(np.sqrt(np.mean(off_um**2))))
        field.append(float(np.sqrt(np.mean((found.field_degC - day.field_degC)[late] ** 2))))
        sigma.append(float(np.mean(found.error_sigma_um[late, 1:])))
        covered.append(float(np.mean(np.abs(off_um) <= 1.96 * found.error_sigma_um[late, 1:])))
    pairs = ((each[0], each[1]) for each in (error, field, sigma, covered))
    return Gain(*pairs)
