"""A hypothesis: a set of effects, fitted together with every free parameter and within every tolerance.

The fit is by Gauss-Newton on the whitened residuals of the open-loop prediction. Nuisance parameters are
marginalised, so a residual that they explain costs only their prior.

The free parameters' derivatives are those at the hypothesis without any effect, until the parameters are far
from it. The effects' own derivatives are updated in every step. The residual of each step is that of a full
prediction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from observer.config.effects.terms import SensorOffset, StretchFilm, Term
from observer.config.machine import Config
from observer.fit.linear import LinearFit, Marginal
from observer.fit.parameters import info_of
from observer.fit.problem import Problem, modelled_lags
from observer.frames import BoolArray, FloatArray

TRIALS = 8
"""Number of times that a diverging step is shortened."""


class Range(NamedTuple):
    """Permitted values of p parameters.

    Attributes:
        low: Lower bounds, (p,).
        high: Upper bounds, (p,).
        reach: Largest change in one step, (p,), infinite without a limit.
    """

    low: FloatArray
    high: FloatArray
    reach: FloatArray

    def step(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and the largest step from the point `theta` (p,), each (p,)."""
        return np.maximum(self.low - theta, -self.reach), np.minimum(self.high - theta, self.reach)


class Stop(NamedTuple):
    """When a fit ends.

    Attributes:
        steps: Largest number of steps.
        little: A drop of the sum of squares by less than this ends it.
        small: A step of less than so many σ of every parameter ends it.
        rival: A sum of squares to compete with. The fit ends when the remaining steps would not reach it at
            the current rate.
    """

    steps: int
    little: float
    small: float
    rival: float = np.inf


class Minimum(NamedTuple):
    """The end of a fit.

    Attributes:
        theta: Parameters, (p,).
        residual: Residual there, (n,).
        jacobian: Its derivatives nearby, (n, p), from the last slope.
    """

    theta: FloatArray
    residual: FloatArray
    jacobian: FloatArray


def minimise(
    residual: Callable[[FloatArray], FloatArray],
    slope: Callable[[FloatArray], FloatArray],
    weighed: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    allowed: Range,
    stop: Stop,
) -> Minimum:
    """Return where the sum of squares of `weighed(residual)` is least, by damped Gauss-Newton steps.

    A step that raises the sum is shortened up to eight times, then the fit ends. It also ends where values
    are not finite.

    Args:
        residual: Returns measured minus predicted, (n,), at parameters (p,).
        slope: Returns the derivatives of the prediction, (n, p), that is of the residual with its sign
            changed.
        weighed: Linear map of residuals and derivatives, such as a marginalisation.
        start: First parameters, (p,), within the bounds.
        allowed: Permitted parameters.
        stop: When to end.
    """
    theta, current, damping = start, residual(start), 0.0
    J = slope(theta)
    for left in reversed(range(stop.steps if len(theta) else 0)):
        A, b = weighed(J), weighed(current)
        before = _squares(b)
        if not (np.isfinite(A).all() and np.isfinite(before)):
            break
        linear = LinearFit.of(A, b)
        for _trial in range(TRIALS):
            step = linear.bounded_step(*allowed.step(theta), damping)
            moved = residual(theta + step)
            now = _squares(weighed(moved))
            if now <= before + 1e-9:  # not where it has overflown
                break
            damping = max(10 * damping, 1e-3)
        else:
            break
        theta, current = np.clip(theta + step, allowed.low, allowed.high), moved
        damping = damping / 10 if damping > 1e-4 else 0.0
        hopeless = (before - now) * left < now - stop.rival
        little = before - now < stop.little or np.max(np.abs(step) / (linear.sigma + 1e-12)) < stop.small
        if little or hopeless:
            break
        J = slope(theta)
    return Minimum(theta, current, -J)


def _squares(values: FloatArray) -> float:
    return float(np.sum(values**2))


NULL_ROUNDS, REFITS, STEPS = 4, 2, 10
LITTLE = 0.05
"""A drop of the deviance by less than this ends a fit."""
SMALL = 0.03
"""A step smaller than this many standard deviations of every parameter ends a fit."""
MOST_STEP = 0.5
"""Largest step of a free parameter, in its scale; beyond, its derivatives are unreliable."""
FAR = 0.2
"""Largest change of a free parameter, in its scale, before the derivatives are updated."""
NORMAL_95 = 1.96
OWN_SIGMA, MOST_SIGMA = 3.0, 4.0
"""Limits of tolerances, in σ: of one that an effect replaces, such as a sensor's offset, and of any other.

A search has some forty tolerances. One of them is beyond 4 σ on one machine in 400, which is less than the
permitted one wrong name in 100. At 3 σ it would be one machine in ten.
"""
FORM_SHARE = 0.015
"""σ of an effect's form error, relative to its parameters; positions and temperatures have none."""


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """A parameter of an effect that is fitted.

    Attributes:
        effect: Number of the effect in the configuration.
        key: Key of the parameter in its table.
        scale: Natural scale, in the parameter's unit.
        low: Lower bound.
        high: Upper bound.
        open_above: Whether the value at the upper bound is a valid result.
    """

    effect: int
    key: str
    scale: float
    low: float
    high: float
    open_above: bool = False


class FittedParameter(NamedTuple):
    """A free parameter after a fit.

    Attributes:
        key: Its key in the configuration.
        unit: Unit of the numbers, `1` for a ratio.
        before: Value before the fit.
        value: Fitted value.
        ci95: 95 % interval, within the bounds.
    """

    key: str
    unit: str
    before: float
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    With n rows of evidence, k parameters of effects, f free ones and p = f + k.

    Attributes:
        problem: Data, tolerances and free parameters.
        config: The configuration with the fitted values.
        parameters: Parameters of the effects, k of them.
        values: Their fitted values, (k,).
        residual: Whitened residual of every row, (n,); tolerances are not marginalised.
        jacobian: Its derivatives by free and effects' parameters, in units of `scale`, (n, p).
        scale: Scales of the parameters, (p,).
    """

    problem: Problem
    config: Config
    parameters: tuple[EffectParameter, ...]
    values: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    scale: FloatArray

    def marginal(self, rows: BoolArray) -> Marginal:
        """Return the map that marginalises the nuisance parameters on some rows.

        Lags of sensors that the fit itself models are not marginalised.

        Args:
            rows: True for the rows, (n,).
        """
        return self.problem.marginal(rows, modelled_lags(self.config))

    @cached_property
    def deviance(self) -> float:
        """Twice the negative log likelihood of the used rows, up to a constant: ‖(I + T Tᵀ)^{−1/2} r‖²."""
        return float(np.sum(self.remainder**2))

    @cached_property
    def deviance_of_all(self) -> float:
        """The deviance over all logs, the proof included, the parameters refitted to all of them."""
        return self.linear(np.ones(len(self.residual), np.bool_)).deviance

    @cached_property
    def remainder(self) -> FloatArray:
        """Whitened residual of the used rows with the tolerances marginalised."""
        used = self.problem.evidence.used
        return self.marginal(used)(self.residual[used])

    def within_tolerances_K(self, named: Config | None = None) -> FloatArray:
        """Return the most probable contribution of the tolerances to every row, K or µm, (n,).

        It is estimated from the used rows. Each tolerance is limited to `MOST_SIGMA`.

        Args:
            named: Configuration whose effects limit the tolerances about the same thing to `OWN_SIGMA`. None
                takes the fit's own.
        """
        return self._taken(named or self.config)[0]

    def stretch(self, named: Config | None = None) -> float:
        """Return the most probable value of the most stretched tolerance, in σ; 0 without tolerances.

        Args:
            named: As in `within_tolerances_K`.
        """
        return float(np.max(np.abs(self._taken(named or self.config)[1]), initial=0.0))

    def _taken(self, named: Config) -> tuple[FloatArray, FloatArray]:
        """The contribution of the tolerances beside a fit, K or µm, (n,), and their most probable values,
        σ, (t,).
        """
        nuisance = self.problem.nuisance
        if nuisance is None or not nuisance.columns.shape[1]:
            return np.zeros(len(self.residual)), np.zeros(0)
        counted = nuisance.except_lags(modelled_lags(self.config))
        replaced = np.array([replaces(term, named) for term in nuisance.terms])
        most = np.where(replaced, OWN_SIGMA, MOST_SIGMA)[counted]
        used = self.problem.evidence.used
        linear = LinearFit.of(nuisance.columns[used][:, counted], self.residual[used], prior_weight=1.0)
        taken = linear.bounded_step(-most, most)
        return np.asarray(nuisance.changes_K[:, counted] @ taken), taken

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of free and effects' parameters in their units, (p, p), priors and tolerances
        included.
        """
        prior_weight = np.zeros(len(self.scale))
        prior_weight[: len(self.problem.keys)] = self.problem.prior_weight
        covariance = self.linear(self.problem.evidence.used, prior_weight).covariance
        return np.asarray(covariance * np.multiply.outer(self.scale, self.scale))

    def linear(self, rows: BoolArray, prior_weight: FloatArray | float = 0.0) -> LinearFit:
        """Return the fit on some rows, linear about itself, with the tolerances marginalised.

        Args:
            rows: True for the rows, (n,).
            prior_weight: One over the prior σ of each parameter in its scale, (p,) or one for all; 0 without
                a prior.

        Returns:
            The linear fit. Its `step` (p,) is taken off the parameters, in their scales.
        """
        marginal = self.marginal(rows)
        return LinearFit.of(marginal(self.jacobian[rows]), marginal(self.residual[rows]), prior_weight)

    @property
    def half_width(self) -> FloatArray:
        """Half of the 95 % intervals of the effects' parameters, in their units, (k,)."""
        return self._half_widths[len(self.problem.keys) :]

    @property
    def half_width_free(self) -> FloatArray:
        """Half of the 95 % intervals of the free parameters, in their units, (f,)."""
        return self._half_widths[: len(self.problem.keys)]

    @property
    def free_parameters(self) -> tuple[FittedParameter, ...]:
        """The free parameters, with intervals that include the uncertainty of the nuisance parameters."""
        problem = self.problem
        before, values = problem.free_values(problem.config), problem.free_values(self.config)
        ends = np.clip([values - self.half_width_free, values + self.half_width_free], *problem.bounds)
        rows = zip(problem.keys, before.tolist(), values.tolist(), ends.T.tolist(), strict=True)
        return tuple(
            FittedParameter(key, info_of(key).unit, was, value, (low, high))
            for key, was, value, (low, high) in rows
        )

    @property
    def relative_sigma(self) -> dict[str, float]:
        """σ of each free parameter relative to its value, by key, without parameters that are 0."""
        values = self.problem.free_values(self.config).tolist()
        columns = zip(self.problem.keys, values, (self.half_width_free / NORMAL_95).tolist(), strict=True)
        return {key: sigma / abs(value) for key, value, sigma in columns if value}

    @property
    def _half_widths(self) -> FloatArray:
        return np.asarray(NORMAL_95 * np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @property
    def at_bound(self) -> bool:
        """Whether a parameter of an effect stands at a bound where it may not."""
        return any(
            min(v - p.low, np.inf if p.open_above else p.high - v) < 1e-3 * p.scale
            for v, p in zip(self.values, self.parameters, strict=True)
        )


def replaces(tolerance: Term | None, config: Config) -> bool:
    """Return whether an effect of a configuration describes the same thing as a tolerance.

    That is a constant offset of the same sensor, or another film along a stretch.

    Args:
        tolerance: Term that the tolerance adds; None if it changes values instead.
        config: Configuration with the effects.
    """
    for term in (term for effect in config.effect for term in effect.terms(config)):
        match tolerance, term:
            case SensorOffset(a, _, 0.0), SensorOffset(b, _, 0.0) if a == b:
                return True
            case StretchFilm(), StretchFilm():
                return True
    return False


def fit_null(problem: Problem, config: Config) -> Fit:
    """Fit the free parameters alone; the fit's problem holds the derivatives that all hypotheses share.

    Derivatives and tolerances are renewed up to four times, until no parameter moves by 0.5 % of its scale.

    Args:
        problem: Data and free parameters.
        config: Configuration to start from.
    """
    problem = problem.with_nuisance(config)
    for _ in range(NULL_ROUNDS):
        fit = fit_effects(problem.linearised_at(config), config, ())
        moved = np.abs(problem.free_values(fit.config) - problem.free_values(config)) / problem.scale
        config = fit.config
        if not len(moved) or moved.max() < 5e-3:
            break
    return fit_effects(problem.linearised_at(config).with_nuisance(config), config, ())


def refitted(fit: Fit) -> Fit:
    """Return a hypothesis fitted again with the tolerances at its own configuration.

    Tolerances at the null hypothesis belong to heats that compensate for the missing effect. Where they move
    a prediction by kelvins, as between rows a minute apart, that would bias the fit.

    Args:
        fit: The hypothesis, from which the fit starts.
    """
    for _ in range(REFITS):
        problem = fit.problem.linearised_at(fit.config).with_nuisance(fit.config)
        fit = fit_effects(problem, fit.config, fit.parameters)
    return fit


def fit_effects(
    problem: Problem, config: Config, parameters: Sequence[EffectParameter], rival: float = np.inf
) -> Fit:
    """Fit the free parameters and those of the effects in a configuration.

    Args:
        problem: Data, tolerances, and the shared derivatives. Derivatives by free parameters are renewed
            where these move far.
        config: The configuration with the effects, from which the fit starts.
        parameters: Parameters of the effects to fit.
        rival: Deviance to compete with. A fit that would not reach it in the remaining steps at its current
            rate is stopped.
    """
    scale = np.concatenate([problem.scale, [p.scale for p in parameters]])
    low = np.concatenate([problem.bounds[0], [p.low for p in parameters]]) / scale
    high = np.concatenate([problem.bounds[1], [p.high for p in parameters]]) / scale
    effects = [getattr(config.effect[p.effect], p.key) for p in parameters]
    theta = np.clip(np.concatenate([problem.free_values(config), effects]) / scale, low, high)
    used, f = problem.evidence.used, len(problem.keys)
    marginal = problem.marginal(used, modelled_lags(config))
    free = problem.by_free or problem.derivatives(config)
    if not parameters:
        free = replace(free, at=theta[:f])

    def at(theta: FloatArray) -> Config:
        calibrated = problem.with_free(config, theta[:f] * problem.scale)
        return with_effects(calibrated, parameters, theta[f:] * scale[f:])

    def slope(theta: FloatArray) -> FloatArray:
        nonlocal free
        if f and np.max(np.abs(theta[:f] - free.at)) > FAR:
            free = problem.derivatives(at(theta))
        return np.hstack([free.columns, _by_effects(problem, at(theta), parameters)])

    rows = len(used)
    minimum = minimise(
        lambda theta: np.concatenate([problem.residual(at(theta)), problem.from_prior(theta[:f])]),
        lambda theta: np.vstack([slope(theta), np.eye(f, len(theta)) * problem.prior_weight[:, None]]),
        lambda columns: np.concatenate([marginal(columns[:rows][used]), columns[rows:]]),
        theta,
        Range(low, high, np.where(np.arange(len(theta)) < f, MOST_STEP, np.inf)),
        Stop(STEPS, LITTLE, SMALL, rival),
    )
    values = minimum.theta[f:] * scale[f:]
    residual, jacobian = minimum.residual[:rows], minimum.jacobian[:rows]
    return Fit(problem, at(minimum.theta), tuple(parameters), values, residual, jacobian, scale)


def with_effects(config: Config, parameters: Sequence[EffectParameter], values: FloatArray) -> Config:
    """Return the configuration with other values of its effects' parameters.

    Args:
        config: The configuration with the effects.
        parameters: The parameters, k of them.
        values: Their values, (k,), which are clipped to the bounds.
    """
    effects = list(config.effect)
    for p, value in zip(parameters, values.tolist(), strict=True):
        inside = min(max(value, p.low), p.high)
        effects[p.effect] = effects[p.effect].model_copy(update={p.key: inside})
    length_m = config.screw.length_m
    return config.model_copy(update={"effect": tuple(e.resolved(length_m) for e in effects)})


def _by_effects(problem: Problem, config: Config, parameters: Sequence[EffectParameter]) -> FloatArray:
    """Derivatives (n, k) of the whitened prediction by the effects' parameters, in units of their scales."""
    if not parameters:
        return np.zeros((len(problem.evidence.run), 0))
    predicted = problem.predicted(config)
    columns = []
    for p in parameters:
        value = getattr(config.effect[p.effect], p.key)
        step = 0.02 * p.scale if value + 0.02 * p.scale <= p.high else -0.02 * p.scale
        moved = with_effects(config, [p], np.array([value + step]))
        columns.append((problem.predicted(moved) - predicted) * (p.scale / step))
    return problem.evidence.whitened(np.column_stack(columns))
