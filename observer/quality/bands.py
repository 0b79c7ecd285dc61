"""The heat that a source usually gives at its speed and temperature, and how far it is from that now.

Over windows of running, the logarithm of the ratio of the estimated heat to its law is compared with

    θ₀ + θ₁ (law / its largest − 1) + θ₂ rise / 10 K,

where θ is learnt by recursive least squares (Ljung and Söderström 1983, ch. 2) during the first hours of
running. After that θ is fixed, because wear must not be learnt. A new machine runs in, so learning forgets
its earlier hours. A fall of friction in the hours after learning, up to a tenth, counts as running in. A
later fall is a loss of preload. The residual is smoothed over hours of running. A line through it is the
trend over days.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from observer.fit.linear import LinearFit
from observer.frames import FloatArray

WINDOW_S = 600.0
"""Length of one window of running."""
LEAST_SHARE = 0.15
"""A law below this fraction of its largest heat is too small to compare with."""
SURE = 0.3
"""The largest σ of the estimate, as a fraction of the heat, at which a window counts."""
UNSURE_H = 1.0
"""Hours of running with a larger σ, after which that is reported."""
SMOOTH_H = 6.0
"""Time constant, in hours of running, for smoothing the residual."""
SETTLE_H = 20.0
"""Time constant for judging whether friction has fallen since it was learnt."""
RUN_IN = 0.1
"""The largest fall, as a logarithm, that counts as running in; beyond it the heat is low."""
RUN_IN_H = 60.0
"""Hours of running after learning during which a machine may still run in."""
ALIKE_H = 1.5
"""Correlation time of an estimate's errors: windows within it count as one."""
MEMORY_H = 15.0
"""Time constant of forgetting while learning: a new machine runs in."""
TREND_H = 60.0
"""Time constant of the trend, in hours of running."""
LEAST_DAYS = 1.0
SIGMAS = 3.0
"""How many σ beyond its band a heat has to be, whatever the deadband."""
CLEAR = 0.6
"""The fraction of the limit below which it is within its band again."""
_PRIOR_SIGMA = np.array([1.0, 0.2, 0.1])
_FLOOR = 0.07
"""Smallest seasonal scatter: the ambient film is unknown and moves heats by some per cent."""
_LEAST_RATIO = 0.02


class Window(NamedTuple):
    """Means over a window of running.

    Attributes:
        time_s: When the window ended.
        heat_W: The estimated heat.
        sigma_W: Its standard deviation.
        law_W: The heat by the law.
        rise_K: The mean temperature of the screw above the air.
        most_W: The largest heat of the law so far.
    """

    time_s: float
    heat_W: float
    sigma_W: float
    law_W: float
    rise_K: float
    most_W: float


class Band(NamedTuple):
    """The usual heat of one source, as learnt, and the present residual.

    Residuals are logarithms of the heat over the law, less the learnt ones.

    Attributes:
        theta: The learnt parameters θ, (3,).
        P: Their covariance, (3, 3).
        spread2: The variance of a window about them.
        running_h: Hours of running of all windows.
        left: The smoothed residual.
        slow: The same with a longer time constant.
        ran_in: The least value of `slow` while the machine ran in, at most 0.
        line: Fading sums 1, t, t², y, t y of a line through the residual, t in days after `at_s`, (5,).
        at_s: The time of the last window; NaN before the first.
        side: +1 above the band, −1 below, 0 within.
        most_W: The largest heat of the law.
        unsure_h: Hours of running since the last window that counted.
        unsure: The σ of the estimate in the last of them, relative to the heat.
    """

    theta: FloatArray
    P: FloatArray
    spread2: float
    running_h: float
    left: float
    slow: float
    ran_in: float
    line: FloatArray
    at_s: float
    side: int
    most_W: float
    unsure_h: float = 0.0
    unsure: float = 0.0


def nothing_known() -> Band:
    """Return the band before the first window; the prior σ of θ are 1, 0.2 and 0.1."""
    return Band(
        np.zeros(3), np.diag(_PRIOR_SIGMA**2), 0.01, 0.0, 0.0, 0.0, 0.0, np.zeros(5), math.nan, 0, 0.0
    )


def learnt(band: Band, window: Window, learn_h: float, deadband: float) -> Band:
    """Return the band after a window.

    A window with too little heat or too uncertain an estimate is not compared.

    Args:
        band: The band before.
        window: Means over the window.
        learn_h: Hours of running during which θ is learnt; beyond them the band is only compared.
        deadband: How much more than usual, as a fraction, a heat has to be.
    """
    band = band._replace(most_W=max(band.most_W, window.law_W, window.most_W))
    if window.law_W <= LEAST_SHARE * band.most_W:
        return band
    unsure = window.sigma_W / max(window.heat_W, window.law_W)
    if unsure >= SURE:
        return band._replace(unsure_h=band.unsure_h + WINDOW_S / 3600.0, unsure=unsure)
    band = band._replace(unsure_h=0.0, unsure=0.0)
    y, phi = math.log(max(window.heat_W / window.law_W, _LEAST_RATIO)), _features(window, band.most_W)
    off = y - float(phi @ band.theta)
    hours = WINDOW_S / 3600.0
    if band.running_h < learn_h:
        own2 = (window.sigma_W / window.law_W) ** 2
        band = _taken(band, phi, off, (band.spread2 + own2) * ALIKE_H / hours, hours)
    band = _smoothed(band, off, hours, learn_h)
    return _judged(_traced(band, window.time_s, off), phi, learn_h, deadband)


def more_than_usual(band: Band) -> float:
    """Return the logarithm of the heat over the usual one, of a machine that has run in."""
    return band.left - band.ran_in


def are_off_together(bands: Sequence[Band], learn_h: float, deadband: float) -> bool:
    """Return whether several heats have left their bands to one side.

    One has, and no other would be within its band again there. No nut and no bearing wears as all others do
    at once, so they have a common cause.

    Args:
        bands: The bands of the heats that share an input.
        learn_h: Hours of running during which a band is learnt; False before all are.
        deadband: How much more than usual, as a fraction, a heat has to be.
    """
    excess = [more_than_usual(band) for band in bands]
    limit = [CLEAR * _limit(band, None, deadband) for band in bands]
    sides = {0 if abs(m) < least else math.copysign(1, m) for m, least in zip(excess, limit, strict=True)}
    is_known = len(bands) > 1 and all(band.running_h >= learn_h for band in bands)
    return is_known and sides in ({1}, {-1}) and any(band.side for band in bands)


def sigma_of(band: Band, phi: FloatArray | None = None) -> float:
    """Return the σ of the smoothed residual, from the estimates and the band.

    Args:
        band: The band.
        phi: The features of a window, (3,); None for the largest heat of the law at no rise.
    """
    phi = np.array([1.0, 0.0, 0.0]) if phi is None else phi
    return math.sqrt(band.spread2 * ALIKE_H / SMOOTH_H + float(phi @ band.P @ phi) + _FLOOR**2)


def why_unsure(band: Band) -> str | None:
    """Return why a heat is neither learnt nor compared, None unless that has lasted for `UNSURE_H`."""
    if band.unsure_h < UNSURE_H:
        return None
    return (
        f"no alarm is possible: its estimate is uncertain by {band.unsure:.0%} of the heat (σ), and "
        f"{SURE:.0%} is needed; mount a sensor nearer to it, or run `observer calibrate`"
    )


def trend_per_day(band: Band) -> float | None:
    """Return by how much of itself the heat grows a day, as a logarithm; None during the first day."""
    n, t, tt, y, ty = band.line
    spread = n * tt - t * t
    if n <= 0.0 or spread < (LEAST_DAYS * n) ** 2 / 12.0:
        return None
    return float((n * ty - t * y) / spread)


def _features(window: Window, most_W: float) -> FloatArray:
    return np.array([1.0, window.law_W / most_W - 1.0, window.rise_K / 10.0])


def _taken(band: Band, phi: FloatArray, off: float, R: float, hours: float) -> Band:
    """One step of recursive least squares with a memory that fades to the prior."""
    keep = math.exp(-hours / MEMORY_H)
    prior = (1.0 - keep) * np.diag(1.0 / _PRIOR_SIGMA**2)
    information = keep * np.linalg.inv(band.P) + prior + np.outer(phi, phi) / R
    step = LinearFit.of_information(information, phi * (off / R) - prior @ band.theta)
    share = min(0.5, hours / max(hours, min(band.running_h, MEMORY_H)))
    spread2 = band.spread2 + share * (min(off * off, 0.25) - band.spread2) * (band.running_h > ALIKE_H)
    return band._replace(theta=band.theta + step.step, P=step.covariance, spread2=spread2)


def _smoothed(band: Band, off: float, hours: float, learn_h: float) -> Band:
    """Smooth what is left of a window, and note how far friction has fallen since it was learnt."""
    slow = band.slow + hours / SETTLE_H * (off - band.slow)
    since_h, fallen = band.running_h - learn_h, band.ran_in
    if since_h <= RUN_IN_H:
        fallen = min(fallen, max(slow, -RUN_IN)) if since_h > 0.5 * SETTLE_H else 0.0
    left = band.left + hours / SMOOTH_H * (off - band.left)
    return band._replace(left=left, slow=slow, ran_in=fallen, running_h=band.running_h + hours)


def _traced(band: Band, time_s: float, off: float) -> Band:
    """Add a point to the line through the residual."""
    n, t, tt, y, ty = band.line
    days = 0.0 if math.isnan(band.at_s) else (time_s - band.at_s) / 86_400.0
    fade = math.exp(-WINDOW_S / 3600.0 / TREND_H)
    moved = np.array([n, t - days * n, tt - 2.0 * days * t + days * days * n, y, ty - days * y])
    return band._replace(line=fade * moved + np.array([1.0, 0.0, 0.0, off, 0.0]), at_s=time_s)


def _judged(band: Band, phi: FloatArray, learn_h: float, deadband: float) -> Band:
    """Set whether the heat is above or below its band, with hysteresis."""
    if band.running_h < learn_h:
        return band._replace(side=0)
    limit, excess = _limit(band, phi, deadband), more_than_usual(band)
    if abs(excess) > limit:
        return band._replace(side=1 if excess > 0 else -1)
    return band._replace(side=0) if abs(excess) < CLEAR * limit else band


def _limit(band: Band, phi: FloatArray | None, deadband: float) -> float:
    return max(math.log1p(deadband), SIGMAS * sigma_of(band, phi))


def plain_of(band: Band) -> dict[str, Any]:
    """Return the band as plain data, for a state file."""
    plain = band._asdict()
    lists = {key: value.tolist() for key, value in plain.items() if isinstance(value, np.ndarray)}
    return plain | lists | {"at_s": None if math.isnan(band.at_s) else band.at_s}


def band_of(plain: Mapping[str, Any]) -> Band:
    """Return a band from plain data, as a state file holds it.

    Raises:
        ValueError: If an array has another shape or is not finite.
        KeyError: If an entry is missing.
        TypeError: If an entry has another type.
    """
    values: dict[str, Any] = {}
    for key, like in nothing_known()._asdict().items():
        if key in Band._field_defaults and key not in plain:
            continue  # written by a service that did not keep it
        value = math.nan if key == "at_s" and plain[key] is None else plain[key]
        if isinstance(like, np.ndarray):
            values[key] = np.asarray(value, float)
            if values[key].shape != like.shape or not np.isfinite(values[key]).all():
                raise ValueError(f"{key} does not fit")
        else:
            values[key] = type(like)(value)
    return Band(**values)
