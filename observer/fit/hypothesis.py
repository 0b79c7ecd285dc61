"""A hypothesis: a set of effects, fitted together with every free parameter and within every tolerance.

The fit is by Gauss and Newton on the whitened residuals of the open-loop prediction; tolerances are
marginalised, so a residual that they explain costs what its share of their standard deviations costs and no
more. The free parameters' derivatives are those at the hypothesis without any effect, until they are far from
there; the effects' own are taken anew in every step, and each step's residual is that of a real prediction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from observer.config import Config
from observer.effects.base import EffectTable
from observer.effects.terms import Lag
from observer.fit.evidence import Evidence
from observer.fit.forward import Forward
from observer.fit.parameters import bounds_of, get, replaced, scale_of
from observer.fit.tolerance import tolerances
from observer.frames import BoolArray, FloatArray

NULL_ROUNDS, STEPS, TRIALS = 4, 10, 8
LITTLE = 0.05
"""A drop of the deviance by less than this ends a fit."""
SMALL = 0.03
"""A step of this many standard deviations of every parameter ends a fit."""
MOST_STEP = 0.5
"""How far a free parameter may go in one step, in its scale: beyond, its derivatives mean little."""
FAR = 0.2
"""How far a free parameter may go, in its scale, before the derivatives are taken anew."""
DIFFERENCE = 1e-3
NORMAL_95 = 1.96


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of an effect that is fitted: which effect and key, a natural scale, and its bounds."""

    effect: int
    key: str
    scale: float
    low: float
    high: float


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    `config` carries effects and free parameters; `values` (k,) those of the effects' parameters; `residual`
    (n,) the whitened residual of every row, tolerances not taken off; `jacobian` (n, p) its derivatives by
    free and effects' parameters, in units of their scales `scale` (p,).
    """

    problem: Problem
    config: Config
    parameters: tuple[Parameter, ...]
    values: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    scale: FloatArray

    def marginal(self, rows: BoolArray) -> Marginal:
        """The map that marginalises the tolerances on some rows, but for lags that the fit itself tells."""
        return self.problem.marginal(rows, told_lags(self.config))

    @cached_property
    def deviance(self) -> float:
        """Twice the negative log likelihood of what may be used, up to a constant."""
        return float(np.sum(self.remainder**2))

    @cached_property
    def remainder(self) -> FloatArray:
        """The used rows' whitened residual with the tolerances marginalised."""
        used = self.problem.evidence.used
        return self.marginal(used)(self.residual[used])

    @cached_property
    def covariance(self) -> FloatArray:
        """The covariance (p, p) of free and effects' parameters in their units."""
        used = self.problem.evidence.used
        J = self.marginal(used)(self.jacobian[used])
        return np.asarray(np.linalg.pinv(J.T @ J) * np.multiply.outer(self.scale, self.scale))

    @property
    def half_width(self) -> FloatArray:
        """Half of the 95 % intervals (k,) of the effects' parameters."""
        return self._half_widths()[len(self.scale) - len(self.parameters) :]

    @property
    def half_width_free(self) -> FloatArray:
        """Half of the 95 % intervals (f,) of the free parameters."""
        return self._half_widths()[: len(self.scale) - len(self.parameters)]

    def _half_widths(self) -> FloatArray:
        return np.asarray(NORMAL_95 * np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @property
    def at_bound(self) -> bool:
        """Whether a parameter of an effect stands at a bound."""
        return any(
            min(v - p.low, p.high - v) < 1e-3 * p.scale
            for v, p in zip(self.values, self.parameters, strict=True)
        )


class Problem:
    """Everything hypotheses of one search share: the runs, their evidence, free parameters, tolerances."""

    def __init__(self, config: Config, keys: Sequence[str], forward: Forward, evidence: Evidence) -> None:
        self.config, self.keys, self.forward, self.evidence = config, tuple(keys), forward, evidence
        self.scale = np.array([scale_of(config, key) for key in keys])
        bounds = np.array([bounds_of(config, key) for key in keys]).reshape(-1, 2)
        self.low, self.high = bounds.T
        self.nuisance, self.nuisance_at = np.zeros((len(evidence.run), 0)), np.zeros(0)
        self.tolerance = np.zeros((len(evidence.run), 0))
        self._lag_of: tuple[str | None, ...] = ()
        self._marginals: dict[tuple[bytes, frozenset[str]], Marginal] = {}

    def predicted(self, config: Config) -> FloatArray:
        """The prediction of every row, (n,), °C."""
        return self.evidence.rows(self.forward(config))

    def residual(self, config: Config) -> FloatArray:
        """Measured minus predicted of every row, whitened, (n,)."""
        return self.evidence.whitened(self.evidence.measured_degC - self.predicted(config))

    def free_values(self, config: Config) -> FloatArray:
        """The free parameters of a configuration."""
        return np.array([get(config, key) for key in self.keys])

    def with_free(self, config: Config, values: FloatArray) -> Config:
        """The configuration with other free parameters, kept within their bounds."""
        if not self.keys:
            return config
        clipped = np.clip(values, self.low, self.high).tolist()
        return replaced(config, dict(zip(self.keys, clipped, strict=True)))

    def prepare(self, config: Config, *, slack: bool) -> None:
        """Take the derivatives by the free parameters at a configuration, and by the tolerances if asked."""
        here = self.predicted(config)
        self.nuisance, self.nuisance_at = self.by_free(config), self.free_values(config) / self.scale
        if slack:
            slacks: list[FloatArray] = []
            lag_of: list[str | None] = []
            for changed, kind in tolerances(config):
                change = self.predicted(changed) - here
                own = self.by_sensor(change) if kind != "screw" else [change]
                slacks += own
                lag_of += [s.name for s in config.sensor] if kind == "lag" else [None] * len(own)
            gaps = [self.evidence.rows(change) for change in self.forward.by_gaps(config)]
            slacks, lag_of = [*slacks, *gaps], [*lag_of, *[None] * len(gaps)]
            self.tolerance, self._lag_of = self._columns(slacks), tuple(lag_of)
            self._marginals.clear()

    def by_free(self, config: Config) -> FloatArray:
        """Derivatives (n, f) of the whitened prediction by the free parameters, in units of their scales."""
        here, values, columns = self.predicted(config), self.free_values(config), []
        for i, scale in enumerate(self.scale):
            step = DIFFERENCE * scale
            step = step if values[i] + step <= self.high[i] else -step
            moved = values + step * (np.arange(len(values)) == i)
            columns.append((self.predicted(self.with_free(config, moved)) - here) * (scale / step))
        return self._columns(columns)

    def by_sensor(self, change: FloatArray) -> list[FloatArray]:
        """Split a change (n,) into one of each sensor alone."""
        sensors = range(len(self.config.sensor))
        return [np.where(self.evidence.sensor == s, change, 0.0) for s in sensors]

    def marginal(self, rows: BoolArray, told: frozenset[str]) -> Marginal:
        """Return the map that marginalises the tolerances on some rows, but for the lags of some sensors."""
        key = rows.tobytes(), told
        if key not in self._marginals:
            kept = np.flatnonzero([name not in told for name in self._lag_of])
            self._marginals[key] = Marginal.of(self.tolerance[rows][:, kept])
        return self._marginals[key]

    def _columns(self, columns: Sequence[FloatArray]) -> FloatArray:
        if not columns:
            return np.zeros((len(self.evidence.run), 0))
        return self.evidence.whitened(np.column_stack(columns))


def told_lags(config: Config, *more: EffectTable) -> frozenset[str]:
    """The sensors whose lag an effect of a configuration tells, or one more effect would."""
    terms = (term for effect in (*config.effect, *more) for term in effect.terms(config))
    return frozenset(term.sensor for term in terms if isinstance(term, Lag))


@dataclass(frozen=True, slots=True)
class Marginal:
    """(I + T Tᵀ)^{-1/2} = I − Q diag(1 − 1/√(1 + σ²)) Qᵀ for tolerances T = Q diag(σ) Vᵀ, (n, t)."""

    Q: FloatArray
    taken: FloatArray

    @classmethod
    def of(cls, T: FloatArray) -> Marginal:
        """Work it out for the whitened columns of the tolerances."""
        Q, sigma, _ = np.linalg.svd(T, full_matrices=False)
        return cls(Q, 1 - 1 / np.sqrt(1 + sigma**2))

    def __call__(self, columns: FloatArray) -> FloatArray:
        """Apply it to columns (n,) or (n, c)."""
        return np.asarray(columns - (self.Q * self.taken) @ (self.Q.T @ columns))


def fit_null(problem: Problem, config: Config) -> Fit:
    """Fit the free parameters alone, and take the derivatives that all hypotheses share."""
    for _ in range(NULL_ROUNDS):
        problem.prepare(config, slack=not problem.tolerance.size)
        fit = fit_effects(problem, config, ())
        moved = np.abs(problem.free_values(fit.config) - problem.free_values(config)) / problem.scale
        config = fit.config
        if not len(moved) or moved.max() < 5e-3:
            break
    problem.prepare(config, slack=True)
    return fit_effects(problem, config, ())


def fit_effects(
    problem: Problem, config: Config, parameters: Sequence[Parameter], rival: float = np.inf
) -> Fit:
    """Fit the free parameters and those of the effects in `config`, from where they stand.

    `rival` is a deviance to compete with: a fit that at its pace would not get there in the steps that are
    left is given up where it is.
    """
    scale = np.concatenate([problem.scale, [p.scale for p in parameters]])
    low = np.concatenate([problem.low, [p.low for p in parameters]]) / scale
    high = np.concatenate([problem.high, [p.high for p in parameters]]) / scale
    effects = [getattr(config.effect[p.effect], p.key) for p in parameters]
    theta = np.clip(np.concatenate([problem.free_values(config), effects]) / scale, low, high)
    used, f = problem.evidence.used, len(problem.keys)
    marginal = problem.marginal(used, told_lags(config))

    def at(theta: FloatArray) -> Config:
        calibrated = problem.with_free(config, theta[:f] * problem.scale)
        return with_effects(calibrated, parameters, theta[f:] * scale[f:])

    def cost(residual: FloatArray) -> float:
        return float(np.sum(marginal(residual[used]) ** 2))

    residual, damping = problem.residual(at(theta)), 0.0
    free, of = problem.nuisance, problem.nuisance_at
    if len(parameters) == 0:
        of = theta[:f]

    def jacobian() -> FloatArray:
        nonlocal free, of
        if f and np.max(np.abs(theta[:f] - of)) > FAR:
            free, of = problem.by_free(at(theta)), theta[:f]
        return np.hstack([free, _by_effects(problem, at(theta), parameters)])

    J = jacobian()
    for left in reversed(range(STEPS if len(theta) else 0)):
        A, b = marginal(J[used]), marginal(residual[used])
        before = cost(residual)
        if not (np.isfinite(A).all() and np.isfinite(before)):
            break
        for _trial in range(TRIALS):
            reach = np.where(np.arange(len(theta)) < f, MOST_STEP, np.inf)
            bounds = np.maximum(low - theta, -reach), np.minimum(high - theta, reach)
            step, sigma = _bounded_step(A, b, *bounds, damping)
            there = problem.residual(at(theta + step))
            if cost(there) <= before + 1e-9:  # not where it has overflown
                break
            damping = max(10 * damping, 1e-3)
        else:
            break
        theta, residual = np.clip(theta + step, low, high), there
        damping = damping / 10 if damping > 1e-4 else 0.0
        now = cost(residual)
        hopeless = (before - now) * left < now - rival
        if np.max(np.abs(step) / sigma) < SMALL or before - now < LITTLE or hopeless:
            break
        J = jacobian()
    values = theta[len(problem.keys) :] * scale[len(problem.keys) :]
    return Fit(problem, at(theta), tuple(parameters), values, residual, -J, scale)


def with_effects(config: Config, parameters: Sequence[Parameter], values: FloatArray) -> Config:
    """The configuration with other values of its effects' parameters."""
    effects = list(config.effect)
    for p, value in zip(parameters, values.tolist(), strict=True):
        inside = min(max(value, p.low), p.high)
        effects[p.effect] = effects[p.effect].model_copy(update={p.key: inside})
    length_m = config.screw.length_m
    return config.model_copy(update={"effect": tuple(e.resolved(length_m) for e in effects)})


def _by_effects(problem: Problem, config: Config, parameters: Sequence[Parameter]) -> FloatArray:
    """Derivatives (n, k) of the whitened prediction by the effects' parameters, in units of their scales."""
    if not parameters:
        return np.zeros((len(problem.evidence.run), 0))
    here = problem.predicted(config)
    columns = []
    for p in parameters:
        value = getattr(config.effect[p.effect], p.key)
        step = 0.02 * p.scale if value + 0.02 * p.scale <= p.high else -0.02 * p.scale
        moved = with_effects(config, [p], np.array([value + step]))
        columns.append((problem.predicted(moved) - here) * (p.scale / step))
    return problem.evidence.whitened(np.column_stack(columns))


def _bounded_step(
    A: FloatArray, b: FloatArray, low: FloatArray, high: FloatArray, damping: float
) -> tuple[FloatArray, FloatArray]:
    """The damped step that minimises ‖b − A step‖² + damping ‖D step‖² within bounds, D the columns' lengths,
    and each parameter's standard deviation (Levenberg 1944; Marquardt 1963).
    """
    from scipy.optimize import lsq_linear  # noqa: PLC0415 - slow to import

    R = np.asarray(np.linalg.qr(np.column_stack([A, b]), mode="r"))
    p = A.shape[1]
    bounds = (np.minimum(low, 0.0) - 1e-12, np.maximum(high, 0.0) + 1e-12)
    damp = np.diag(np.sqrt(damping) * np.linalg.norm(R[:p, :p], axis=0))
    solved = lsq_linear(np.vstack([R[:p, :p], damp]), np.concatenate([R[:p, p], np.zeros(p)]), bounds=bounds)
    sigma = np.sqrt(np.maximum(np.diag(np.linalg.pinv(R[:p, :p].T @ R[:p, :p])), 0.0)) + 1e-12
    return np.asarray(solved.x), sigma
