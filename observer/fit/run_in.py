"""The excess of friction over its law when work begins, and its decay, from a calibration.

A fit lets each heat that depends on speed settle with two time constants, within its law's uncertainty. The
fitted part is a curve c(t) of the running time, and the nearest s·exp(−t/τ) is written. The difference of s
between starts follows from several logs that begin cold. With one log it is a fixed share of s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer.config.effects.terms import LawFactor
from observer.config.machine import Config
from observer.config.sections import Source, law_channels
from observer.fit.hypothesis import Fit
from observer.fit.linear import LinearFit
from observer.fit.problem import modelled_lags
from observer.fit.runs import Run
from observer.fit.tolerance import SETTLING_S, SettlingFriction
from observer.frames import FloatArray

OVER_S = np.linspace(0.0, 5400.0, 19)
"""The running times over which a curve is compared with an exponential."""
TIMES_S = np.geomspace(min(SETTLING_S), max(SETTLING_S), 29)
PER_START, LEAST, FIRM = 0.2, 0.01, 2.0
"""Expected σ of the running-in from one start to the next, relative to itself and to the law.

The third number is the weight of this expectation, in differences between logs.
"""
MOST_SIGMA = 0.05
"""Largest σ of a running-in that is reported, relative to the law."""
COLD_K = 3.0
"""Largest distance from the air, offsets included, of a screw that has rested long enough to run in again."""


class Settles(NamedTuple):
    """The settling parts of a heat, one for each of c time constants `SETTLING_S`.

    Attributes:
        part: Amplitudes relative to the law, (c,).
        covariance: Their covariance, (c, c).
    """

    part: FloatArray
    covariance: FloatArray


class Fading(NamedTuple):
    """The exponential s·exp(−t/τ) nearest a curve of settling friction.

    Attributes:
        share: s, relative to the law.
        time_s: τ, s of running time.
        sigma: σ of s.
    """

    share: float
    time_s: float
    sigma: float


def nearest(settles: Settles, times_s: Sequence[float] | FloatArray = TIMES_S) -> Fading:
    """Return the exponential that is nearest a heat's settling parts over 90 minutes of running, by least
    squares.

    Args:
        settles: The settling parts.
        times_s: Time constants to choose from, s.
    """
    parts = np.exp(-OVER_S[:, None] / np.array(SETTLING_S))
    curve = parts @ settles.part
    candidates = []
    for time_s in times_s:
        shape = np.exp(-OVER_S / time_s)
        to_share = shape @ parts / (shape @ shape)
        share = float(to_share @ settles.part)
        sigma = math.sqrt(max(float(to_share @ settles.covariance @ to_share), 0.0))
        candidates.append((float(np.sum((curve - share * shape) ** 2)), Fading(share, float(time_s), sigma)))
    return min(candidates)[1]


def running_in_of(fit: Fit, runs: Sequence[Run]) -> dict[str, float]:
    """Return the running-in of heats that the logs show.

    Only logs that begin cold count. A heat is left out if none of its parameters was fitted, or if σ of its
    running-in exceeds 5 % of its law.

    Args:
        fit: A fit with friction that settles among its tolerances.
        runs: The logs of the fit.

    Returns:
        `run_in` and `run_in_tolerance`, relative to the law, and `run_in_s`, s, by full keys such as
        `source.nut.run_in`.
    """
    written: dict[str, float] = {}
    for source in fit.config.source:
        rested = [i for i, run in enumerate(runs) if begins_cold(fit.config, source, run)]
        whole = _settles(fit, source.name)
        fitted = any(key.startswith(f"source.{source.name}.") for key in fit.problem.keys)
        if not (rested and fitted) or whole is None or (fading := nearest(whole)).sigma > MOST_SIGMA:
            continue
        of_starts = [_settles(fit, source.name, i) for i in rested] if len(rested) > 1 else []
        apart = spread(fading.share, [nearest(one, [fading.time_s]) for one in of_starts if one is not None])
        written |= {
            f"source.{source.name}.run_in": fading.share,
            f"source.{source.name}.run_in_s": fading.time_s,
            f"source.{source.name}.run_in_tolerance": math.hypot(fading.sigma, apart),
        }
    return written


def spread(share: float, starts: Sequence[Fading]) -> float:
    """Return σ of the running-in from one start to the next, relative to the law.

    It combines a general expectation, counted as two differences, with the scatter of the starts beyond their
    own σ.

    Args:
        share: Running-in of all starts together.
        starts: Running-in of each start; fewer than two give the expectation alone.
    """
    before = math.hypot(PER_START * share, LEAST)
    if len(starts) < 2:
        return before
    shares, sigmas = (np.array(column) for column in zip(*((f.share, f.sigma) for f in starts), strict=True))
    apart = max(float(np.sum((shares - shares.mean()) ** 2) - (1 - 1 / len(starts)) * np.sum(sigmas**2)), 0.0)
    return math.sqrt((FIRM * before**2 + apart) / (FIRM + len(starts) - 1))


def begins_cold(config: Config, source: Source, run: Run) -> bool:
    """Return whether a run begins with a source at rest and the screw near the air's temperature.

    No thermocouple may be farther than `COLD_K` from the air. A source without a speed or power channel never
    counts as cold.

    Args:
        config: The machine.
        source: The source.
        run: The prepared log.
    """
    channels, air = law_channels(source, config.source), config.ambient
    first = dict(zip(run.frames.channels, run.frames.values[0].tolist(), strict=True))
    air_degC = first[air.channel] if air.channel is not None else air.temperature_degC or 0.0
    thermal = [sensor.kind == "temperature" for sensor in config.sensor]
    off_K = np.abs(run.start_degC[thermal] - air_degC)
    seen_K = off_K[np.isfinite(off_K)]
    rests = bool(channels) and first[channels[0]] == 0.0
    return rests and bool(len(seen_K)) and bool(seen_K.max() <= COLD_K)


def _settles(fit: Fit, source: str, run: int | None = None) -> Settles | None:
    """Return the fitted settling parts of a heat, in all runs or in one.

    None if the fit has no settling parts for this source.
    """
    nuisance, evidence = fit.problem.nuisance, fit.problem.evidence
    if nuisance is None:
        return None
    settling, part = list[int](), list[float]()
    for i, term in enumerate(nuisance.terms):
        if (
            isinstance(term, LawFactor)
            and isinstance(term.factor, SettlingFriction)
            and term.source == source
        ):
            settling.append(i)
            part.append(term.factor.part)
    if not settling:
        return None
    columns, scale = nuisance.columns[evidence.used], np.array(part)
    in_run = np.ones(len(columns), np.bool_) if run is None else evidence.run[evidence.used] == run
    of_run, of_other_runs = columns[:, settling] * in_run[:, None], columns[:, settling] * ~in_run[:, None]
    remaining = nuisance.except_lags(modelled_lags(fit.config))
    remaining[settling] = False
    tolerances = [of_run, columns[:, remaining], *([] if in_run.all() else [of_other_runs])]
    A = np.hstack([*tolerances, -fit.jacobian[evidence.used]])
    prior_weight = (np.arange(A.shape[1]) < A.shape[1] - fit.jacobian.shape[1]).astype(float)
    linear, first = LinearFit.of(A, fit.residual[evidence.used], prior_weight), slice(0, len(settling))
    return Settles(
        linear.step[first] * scale, linear.covariance[first, first] * np.multiply.outer(scale, scale)
    )
