"""Fit the free parameters of a configuration to logs, by the error of the open-loop prediction.

The heat of every source comes from its law, nothing corrects the prediction on the way (an estimator would
absorb what is wrong), and the parameters minimise the weighted squares of what is left of the 30 s means.
Pure: logs come in as frames. (Output-error method; Ljung 1999, §7.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from observer.config import Config
from observer.errors import LogError
from observer.fit.identifiability import Obstacle, describe, distinguishable
from observer.fit.interval import covariance, half_width
from observer.fit.parameters import bounds_of, free_keys, get, kind_of, replaced, scale_of
from observer.fit.response import Predictor
from observer.fit.runs import Run, prepare
from observer.frames import FloatArray, FrameBlock

STEP = 1e-3
"""Finite difference, in natural scales; the prediction is free of noise, so this costs no digits."""
LEAST_S = 300.0
AT_BOUND = 1e-4
"""Distance from a bound, in natural scales."""
Progress = Callable[[int, float], None]


@dataclass(frozen=True, slots=True)
class Fitted:
    """A parameter, the value it had, the one that fits best, and its 95 % interval."""

    key: str
    unit: str
    before: float
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Gap:
    """Root mean square of measurement minus open-loop prediction, 30 s means, in K."""

    before_rms_K: float
    after_rms_K: float


@dataclass(frozen=True, slots=True)
class Calibration:
    """What a calibration found.

    `config` carries the fitted values; `obstacles` says which free parameters these logs cannot tell (these
    keep their values) or tell badly, and why. `gap` is over all sensors, `per_sensor` by name.
    """

    config: Config
    fitted: tuple[Fitted, ...]
    obstacles: tuple[Obstacle, ...]
    gap: Gap
    per_sensor: dict[str, Gap]
    evaluations: int

    @property
    def values(self) -> dict[str, float]:
        """The fitted values by key."""
        return {f.key: f.value for f in self.fitted}


def calibrate(
    config: Config, runs: Sequence[Sequence[FrameBlock]], progress: Progress = lambda _count, _rms_K: None
) -> Calibration:
    """Fit the free parameters of a configuration to one or more runs, each with its own initial state.

    `progress(evaluations, rms_K)` is called after each prediction. Raises `ConfigError` where a free key
    does not exist, `LogError` where the logs are too short, or tell none of the parameters.
    """
    keys = free_keys(config)
    prepared = [prepare(config, blocks, f"log {i + 1}") for i, blocks in enumerate(runs)]
    _long_enough(prepared)
    misfit = Misfit(config, keys, prepared, progress)
    told, obstacles = distinguishable(config, keys, misfit.jacobian(misfit.start), prepared)
    if not told:
        raise LogError(" ".join(["the logs tell none of the free parameters:", *map(describe, obstacles)]))
    misfit = misfit.only(told)
    u = _minimise(misfit)
    fitted = _intervals(misfit, u)
    after = misfit.config_at(u)
    overall, per_sensor = _gaps(config, misfit.residuals_K(misfit.start), misfit.residuals_K(u))
    return Calibration(
        after, fitted, obstacles + _doubts(misfit, fitted), overall, per_sensor, misfit.evaluations
    )


class Misfit:
    """The weighted residuals as a function of u, the parameters in units of their natural scales."""

    def __init__(
        self,
        config: Config,
        keys: tuple[str, ...],
        runs: Sequence[Run],
        progress: Progress,
        predictor: Predictor | None = None,
    ) -> None:
        """Fix scales, bounds and weights."""
        self._config, self.keys, self.runs, self._progress = config, keys, runs, progress
        self._predict = predictor or Predictor(config, runs)
        self.evaluations = 0
        self.scale = np.array([scale_of(config, key) for key in keys])
        self.start = np.array([get(config, key) for key in keys]) / self.scale
        self.low, self.high = np.array([bounds_of(config, key) for key in keys]).T / self.scale
        noise_K = np.array([s.noise_K for s in config.sensor])
        self._weight = np.vstack([np.sqrt(_full(run)) / noise_K for run in runs])

    def only(self, keys: tuple[str, ...]) -> Misfit:
        """The same misfit with fewer parameters; what was simulated is kept."""
        return Misfit(self._config, keys, self.runs, self._progress, self._predict)

    def config_at(self, u: FloatArray) -> Config:
        """The configuration with these parameters."""
        return replaced(self._config, dict(zip(self.keys, (u * self.scale).tolist(), strict=True)))

    def residuals_K(self, u: FloatArray) -> list[FloatArray]:
        """Measured minus predicted 30 s means of each run, (b, s); NaN where nothing was measured."""
        predicted = self._predict(self.config_at(u))
        return [run.measured_degC - p for run, p in zip(self.runs, predicted, strict=True)]

    def weighted(self, u: FloatArray) -> FloatArray:
        """The residuals in units of their noise, (n, s) over all runs; 0 where nothing was measured."""
        residual_K = np.vstack(self.residuals_K(u))
        self.evaluations += 1
        self._progress(self.evaluations, _rms(residual_K))
        return np.asarray(np.where(self._weight > 0, residual_K, 0.0) * self._weight)

    def __call__(self, u: FloatArray) -> FloatArray:
        """The weighted residuals in one row, (n s,)."""
        return self.weighted(u).ravel()

    def jacobian(self, u: FloatArray) -> FloatArray:
        """Their derivatives (n s, p), by a difference that stays inside the bounds."""
        here = self(u)
        columns = []
        for i in range(len(u)):
            step = STEP if u[i] + STEP <= self.high[i] else -STEP
            there = u.copy()
            there[i] += step
            columns.append((self(there) - here) / step)
        return np.column_stack(columns)


def _minimise(misfit: Misfit) -> FloatArray:
    from scipy.optimize import least_squares  # noqa: PLC0415 - slow to import

    start = np.clip(misfit.start, misfit.low, misfit.high)
    found = least_squares(
        misfit, start, jac=misfit.jacobian, bounds=(misfit.low, misfit.high), ftol=1e-9, xtol=1e-7, gtol=1e-12
    )
    return np.asarray(found.x)


def _intervals(misfit: Misfit, u: FloatArray) -> tuple[Fitted, ...]:
    """The fitted parameters with 95 % intervals that allow for residuals which resemble their neighbours."""
    residual = misfit.weighted(u)
    J = misfit.jacobian(u).reshape(*residual.shape, len(u))
    cov, freedom = covariance(J, residual, [len(run.first) for run in misfit.runs])
    reach = half_width(cov, freedom)
    fitted = []
    for i, key in enumerate(misfit.keys):
        scale = float(misfit.scale[i])
        low, high = (
            float(np.clip(u[i] + sign * reach[i], misfit.low[i], misfit.high[i])) for sign in (-1, 1)
        )
        before, value = float(misfit.start[i]) * scale, float(u[i]) * scale
        fitted.append(Fitted(key, kind_of(key).unit, before, value, (low * scale, high * scale)))
    return tuple(fitted)


def _doubts(misfit: Misfit, fitted: Sequence[Fitted]) -> tuple[Obstacle, ...]:
    """What is fitted but not to be relied on: values at their bounds, intervals as wide as the parameter."""
    doubts = []
    for f, scale, low, high in zip(fitted, misfit.scale, misfit.low, misfit.high, strict=True):
        if min(abs(f.value / scale - low), abs(f.value / scale - high)) < AT_BOUND:
            doubts.append(
                Obstacle(
                    f.key,
                    f"the fit runs into its bound of {f.value:.5g} {f.unit}",
                    "check the model and the log",
                )
            )
        elif f.ci95[1] - f.ci95[0] > 2 * scale:
            doubts.append(
                Obstacle(
                    f.key, "its interval is as wide as the parameter itself", "add longer or livelier runs"
                )
            )
    return tuple(doubts)


def _full(run: Run) -> FloatArray:
    """How many values each mean has, (b, s), and 0 where it has less than half of the usual number."""
    usual = np.median(run.count[run.count > 0])
    return np.where(run.count >= 0.5 * usual, run.count, 0.0)


def _gaps(
    config: Config, before_K: Sequence[FloatArray], after_K: Sequence[FloatArray]
) -> tuple[Gap, dict[str, Gap]]:
    before, after = np.vstack(before_K), np.vstack(after_K)
    per_sensor = {
        s.name: Gap(_rms(before[:, i]), _rms(after[:, i]))
        for i, s in enumerate(config.sensor)
        if np.isfinite(before[:, i]).any()
    }
    return Gap(_rms(before), _rms(after)), per_sensor


def _rms(residual_K: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(residual_K**2)))


def _long_enough(runs: Sequence[Run]) -> None:
    longest = max((run.duration_s for run in runs), default=0.0)
    if longest < LEAST_S:
        raise LogError(
            f"the longest log lasts {longest:.0f} s and a calibration needs {LEAST_S:.0f} s at the least; "
            "record from a standstill through warming up to cooling down"
        )
