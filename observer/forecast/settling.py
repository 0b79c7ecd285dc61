"""Where the screw settles under a program, and when."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import repeat

import numpy as np

from observer.estimators.kalman import KalmanEstimator
from observer.forecast.ahead import HOUR_S, Runner
from observer.forecast.program import Program
from observer.frames import BoolArray, EstimateBlock, FloatArray

STEP_S = 30.0
MOST_S = 24.0 * HOUR_S
_PART = 20
_STILL_K = 1e-3  # per part of ten minutes
_DRAWS, _SEED, _Z95 = 12, 0, 1.96


@dataclass(frozen=True, slots=True)
class Settled:
    """The state to which the mean of the program leads, at g points.

    Attributes:
        field_degC: Temperature, °C, (g,).
        error_um: Thermal error, µm, (g,), or (0,) without an expansion coefficient.
        after_s: Time from which on every point of the travel is within the limit, s. None if not in a day, or
            without an error.
        field_sigma_K: σ of the settled field, K, (g,); None if not computed.
        error_sigma_um: σ of the settled error, µm, (g,); None if not computed.
        between_s: 95 % interval of `after_s`, s, within a day; None if not computed.
    """

    field_degC: FloatArray
    error_um: FloatArray
    after_s: float | None
    field_sigma_K: FloatArray | None = None
    error_sigma_um: FloatArray | None = None
    between_s: tuple[float, float] | None = None


def settling(begin: Runner, program: Program, travel: BoolArray, within_um: float) -> Settled:
    """Follow the mean program until the field changes by less than 1 mK in ten minutes, at most for a day.

    Args:
        begin: The runner at the present moment; its covariance is not used.
        program: The program.
        travel: True for the places of the grid that count, (g,).
        within_um: Distance from the settled error that counts as settled, µm.
    """
    parts = list[EstimateBlock]()
    bins = program.mean.at(np.zeros(_PART, np.int64))._replace(dt_s=np.full(_PART, STEP_S))
    exact = replace(begin, state=replace(begin.state, P=np.zeros_like(begin.state.P)))
    for part in exact.follow(repeat(bins)):
        parts.append(part)
        still = np.abs(part.field_degC[-1] - part.field_degC[0]).max() < _STILL_K
        if still or part.time_s[-1] >= MOST_S:
            break
    error_um = parts[-1].error_um[-1]
    return Settled(parts[-1].field_degC[-1], error_um, _settled_after_s(parts, error_um, travel, within_um))


def _settled_after_s(
    parts: Sequence[EstimateBlock], at_um: FloatArray, travel: BoolArray, within_um: float
) -> float | None:
    """Return the first moment from which on every point is within the limit, 0 if it always is, None if
    never.
    """
    if not at_um.size:
        return None
    time_s, path_um = (np.concatenate(c) for c in zip(*((p.time_s, p.error_um) for p in parts), strict=True))
    outside = np.flatnonzero((np.abs(path_um - at_um)[:, travel] > within_um).any(axis=1))
    if not len(outside):
        return 0.0
    return None if outside[-1] + 1 >= len(time_s) else float(time_s[outside[-1] + 1])


def draws(begin: Runner, program: Program) -> list[Runner]:
    """Return random runners that represent all present uncertainty: each has another state, machine, and
    heats.

    Heats have a lasting error, which includes the program's variation in an hour. If they drift, they also
    have an hour's drift that dies away in one hour, like run-in. Draws come in pairs of opposite sign, always
    the same ones.

    Args:
        begin: The runner at the present moment.
        program: The program.
    """
    state, plant, n_x = begin.state, begin.plant, len(begin.plant.decay_1_s)
    free = np.flatnonzero(plant.estimated)
    heats = slice(n_x, n_x + len(free))
    fading = begin
    if begin.drifts:
        faded = replace(plant, heat_decay_1_s=np.full(len(free), 1.0 / HOUR_S))
        fading = replace(begin, plant=faded, estimator=KalmanEstimator(faded, begin.settings))
    mean_W = np.abs(program.mean.law_W[0] * begin.heats.ratio + begin.heats.extra_W)
    share = (mean_W / max(float(mean_W.sum()), 1e-12))[free]
    drift_W = np.sqrt(plant.random_walk_W2_s * HOUR_S)
    P = state.P.copy()
    varies = program.noise_W2_s / HOUR_S
    if begin.drifts:
        P[heats, heats] += varies * np.outer(share, share)
    values, axes = np.linalg.eigh(P)
    half = np.random.default_rng(_SEED).standard_normal((_DRAWS // 2, len(P) + len(free)))
    runners = []
    for draw in np.concatenate([half, -half]):
        x = state.x_hat + axes @ (np.sqrt(np.maximum(values, 0.0)) * draw[: len(P)])
        extra_W = begin.heats.extra_W.copy()
        if begin.drifts:
            extra_W[free] += x[heats]
            x[heats] = drift_W * draw[len(P) :]
        else:  # what heats have beside their laws is in the state, and dies away
            extra_W[free] += np.sqrt(varies) * share * draw[-1]
        means = begin.heats._replace(extra_W=extra_W)
        runners.append(replace(fading, state=replace(state, x_hat=x), heats=means))
    return runners


def settling_of_all(
    begins: Sequence[tuple[float, Runner]], program: Program, travel: BoolArray, within_um: float
) -> Settled:
    """Return the settled state of weighted runners, with σ and the 95 % interval of its time from draws.

    Field and error are means over the runners, the time is their median.

    Args:
        begins: Runners with weights that add up to 1.
        program: The program.
        travel: As in `settling`.
        within_um: As in `settling`.
    """
    weight = np.array([w for w, _ in begins])
    means = [settling(begin, program, travel, within_um) for _, begin in begins]
    drawn = [
        settling(draw, program, travel, within_um) for _, begin in begins for draw in draws(begin, program)
    ]

    def sigma(values: Callable[[Settled], FloatArray | float], mean: FloatArray | float) -> FloatArray:
        squares = (np.array([values(d) for d in drawn]) - mean) ** 2
        return np.asarray(np.sqrt(np.repeat(weight / _DRAWS, _DRAWS) @ squares))

    field_degC, error_um = (
        weight @ np.array([getattr(m, n) for m in means]) for n in ("field_degC", "error_um")
    )
    sigmas = sigma(lambda s: s.field_degC, field_degC), sigma(lambda s: s.error_um, error_um)
    times_s = sorted(
        (m.after_s, w) for m, w in zip(means, weight.tolist(), strict=True) if m.after_s is not None
    )
    if len(times_s) < len(means):
        return Settled(field_degC, error_um, None, *sigmas)
    each_s, shares = np.array(times_s).T
    after_s = float(np.interp(0.5, np.cumsum(shares) - 0.5 * shares, each_s))
    reach_s = _Z95 * float(sigma(lambda s: MOST_S if s.after_s is None else s.after_s, after_s))
    between_s = max(after_s - reach_s, 0.0), min(after_s + reach_s, MOST_S)
    return Settled(field_degC, error_um, after_s, *sigmas, between_s)
