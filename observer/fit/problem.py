"""The data that all hypotheses of one search share; immutable."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from observer.config.effects.base import EffectTable
from observer.config.effects.terms import Lag, Term
from observer.config.machine import Config
from observer.fit.evidence import GROWTH_SHARE, SLOW_SHARE, Evidence, gather
from observer.fit.forward import Forward
from observer.fit.linear import Marginal
from observer.fit.parameters import bounds_of, get, scale_of, with_values
from observer.fit.prior import Prior
from observer.fit.runs import Run
from observer.fit.steps import Cache
from observer.fit.tolerance import Scope, tolerances
from observer.frames import BoolArray, FloatArray

DIFFERENCE = 1e-3
"""Finite difference, in natural scales; the prediction is free of noise, so no digits are lost."""
MOST_KEPT = 64
FAR_APART_S = 2.0
"""Rows closer together resolve a change as well as any sensor follows it."""


@dataclass(frozen=True)
class NuisanceColumns:
    """Changes of the prediction by one standard deviation of each of t nuisance parameters.

    Attributes:
        columns: Whitened changes, (n, t).
        changes_K: The same changes in K, or µm of a displacement, (n, t).
        lag_of: Name of the sensor whose lag it is, None for other parameters, (t,).
        terms: Term that the parameter adds, None if it changes a value, (t,).
    """

    columns: FloatArray
    changes_K: FloatArray
    lag_of: tuple[str | None, ...]
    terms: tuple[Term | None, ...]
    _maps: Cache[Marginal] = field(default_factory=lambda: Cache(MOST_KEPT), init=False, repr=False)

    def except_lags(self, modelled: frozenset[str]) -> BoolArray:
        """Return which parameters (t,) remain if the lags of the sensors `modelled` are part of a
        hypothesis.
        """
        return np.array([name not in modelled for name in self.lag_of], np.bool_)

    def marginal(self, rows: BoolArray, modelled: frozenset[str]) -> Marginal:
        """Return the map that marginalises the nuisance parameters on some rows; maps are cached.

        Args:
            rows: True for the rows, (n,).
            modelled: Sensors whose lag is part of a hypothesis and is not marginalised.
        """
        remaining = self.except_lags(modelled)
        key = rows.tobytes(), remaining.tobytes()
        return self._maps.get(key, lambda: Marginal.of(self.columns[rows][:, remaining]))


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of the whitened prediction by f free parameters.

    Attributes:
        columns: Derivatives per scale, (n, f).
        at: Values at which they were taken, in scales, (f,).
    """

    columns: FloatArray
    at: FloatArray


@dataclass(frozen=True)
class Problem:
    """The runs, their evidence and free parameters.

    Attributes:
        config: Configuration with the values before any fit.
        keys: The f free parameters.
        forward: Open-loop prediction of the runs.
        evidence: Measured means with their errors and roles, n rows.
        by_free: Derivatives by the free parameters, None before `linearised_at`.
        nuisance: Nuisance parameters, None before `with_nuisance`.
        tolerances_of: Yields the nuisance parameters of a configuration and a number of runs.
        prior_of: Returns the prior of the free parameters; None gives none, only bounds.
    """

    config: Config
    keys: tuple[str, ...]
    forward: Forward
    evidence: Evidence
    by_free: Derivatives | None = None
    nuisance: NuisanceColumns | None = None
    tolerances_of: Callable[[Config, int], Iterable[tuple[Config, Scope]]] = tolerances
    prior_of: Callable[[Config, Sequence[str]], Prior] | None = None

    @classmethod
    def of(cls, config: Config, keys: tuple[str, ...], runs: Sequence[Run]) -> Problem:
        """Return the problem of a search.

        Args:
            config: The configuration with which the runs were prepared.
            keys: Its free parameters.
            runs: The prepared logs; the last one, or the end of a single one, becomes the proof.
        """
        forward = Forward(config, runs)
        noise_K = np.array([s.noise for s in config.sensor])
        share = np.array([GROWTH_SHARE if s.kind == "displacement" else SLOW_SHARE for s in config.sensor])
        return cls(config, keys, forward, gather(forward.runs, noise_K, slow_share=share))

    @cached_property
    def scale(self) -> FloatArray:
        """Natural scales of the free parameters, in their units, (f,)."""
        return np.array([scale_of(self.config, key) for key in self.keys])

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the free parameters, in their units, (f,) each."""
        if self.prior is not None:
            return self.prior.low, self.prior.high
        low, high = np.array([bounds_of(self.config, key) for key in self.keys]).reshape(-1, 2).T
        return low, high

    @cached_property
    def prior(self) -> Prior | None:
        """The prior of the free parameters; None in a search, which has bounds only."""
        return None if self.prior_of is None else self.prior_of(self.config, self.keys)

    @cached_property
    def prior_weight(self) -> FloatArray:
        """Scale of each free parameter over its prior σ, (f,); 0 without a prior."""
        return np.zeros(len(self.keys)) if self.prior is None else self.scale / self.prior.sigma

    def from_prior(self, theta: FloatArray) -> FloatArray:
        """Return the distance of free parameters from the configured values, in prior σ, (f,).

        A prior acts as one more measurement of each free parameter.

        Args:
            theta: Values in scales, (f,).
        """
        return np.asarray(self.prior_weight * (self.free_values(self.config) / self.scale - theta))

    def predicted(self, config: Config) -> FloatArray:
        """Return the prediction of every row, °C, or µm of a displacement, (n,)."""
        return self.evidence.rows(self.forward(config))

    def error_K(self, config: Config) -> FloatArray:
        """Return measured minus predicted of every row, K or µm, (n,)."""
        return np.asarray(self.evidence.measured_degC - self.predicted(config))

    def residual(self, config: Config) -> FloatArray:
        """The error of every row, whitened, (n,)."""
        return self.evidence.whitened(self.error_K(config))

    def free_values(self, config: Config) -> FloatArray:
        """Return the free parameters of a configuration in their units, (f,)."""
        return np.array([get(config, key) for key in self.keys])

    def with_free(self, config: Config, values: FloatArray) -> Config:
        """Return the configuration with other free parameters.

        Args:
            config: The configuration.
            values: Values in their units, (f,), which are clipped to the bounds.
        """
        if not self.keys:
            return config
        clipped = np.clip(values, *self.bounds).tolist()
        return with_values(config, dict(zip(self.keys, clipped, strict=True)))

    def linearised_at(self, config: Config) -> Problem:
        """Return the same problem with the derivatives by the free parameters taken at a configuration.

        It costs one prediction per free parameter.
        """
        return replace(self, by_free=self.derivatives(config))

    def with_nuisance(self, config: Config) -> Problem:
        """Return the same problem with the nuisance parameters taken at a configuration.

        They are the tolerances, gains of sensors, unknown heats in outages and between rows far apart, and
        the timing of coarse rows. Each costs about one prediction.
        """
        predicted, nuisances, lag_of = self.predicted(config), list[FloatArray](), list[str | None]()
        terms = list[Term | None]()
        for changed, scope in self.tolerances_of(config, len(self.forward.runs)):
            change = self.predicted(changed) - predicted
            parts = self._by_scope(change, scope)
            nuisances += parts
            lag_of += [s.name for s in config.sensor] if scope == "lag" else [None] * len(parts)
            added = changed.effect[len(config.effect) :]
            terms += [added[0].terms(changed)[0] if added else None] * len(parts)
        sampling = [*self.forward.by_outages(config), *self.forward.by_coarse_rows(config)]
        further = [
            *self.by_gain(config, predicted),
            *self.by_timing(predicted),
            *map(self.evidence.rows, sampling),
        ]
        nuisances += further
        changes_K = np.column_stack(nuisances) if nuisances else np.zeros((len(predicted), 0))
        lags, added_terms = ((*column, *[None] * len(further)) for column in (lag_of, terms))
        return replace(self, nuisance=NuisanceColumns(self._columns(nuisances), changes_K, lags, added_terms))

    def changes_K(self, config: Config, changed: Iterable[tuple[Config, Scope]]) -> list[FloatArray]:
        """Return the changes of the prediction from a configuration to others, K or µm, (n,) each.

        Args:
            config: The configuration to compare with.
            changed: The others with their scopes. A change with the scope of a run or a sensor is split into
                one for each.
        """
        before = self.predicted(config)
        return [
            part for other, scope in changed for part in self._by_scope(self.predicted(other) - before, scope)
        ]

    def _by_scope(self, change: FloatArray, scope: Scope) -> list[FloatArray]:
        if scope == "whole":
            return [change]
        return self.by_run(change) if scope == "run" else self.by_sensor(change)

    def derivatives(self, config: Config) -> Derivatives:
        """Return the derivatives by the free parameters."""
        columns = self.evidence.rows(self.means_with_slopes(config))[:, 1:]
        return Derivatives(self.evidence.whitened(columns), self.free_values(config) / self.scale)

    def means_with_slopes(self, config: Config) -> list[FloatArray]:
        """Return the predicted means of each run with their f derivatives per scale, (b, s, 1 + f).

        Differences are one-sided, a thousandth of each scale, and stay inside the bounds.
        """
        predicted, values = self.forward(config), self.free_values(config)
        columns = [[means] for means in predicted]
        for i, scale in enumerate(self.scale):
            share = DIFFERENCE if values[i] + DIFFERENCE * scale <= self.bounds[1][i] else -DIFFERENCE
            moved = self.with_free(config, values + share * scale * (np.arange(len(values)) == i))
            for run, means in zip(columns, self.forward(moved), strict=True):
                run.append((means - run[0]) / share)
        return [np.stack(run, axis=2) for run in columns]

    def by_sensor(self, change: FloatArray) -> list[FloatArray]:
        """Split a change (n,) into one of each sensor alone."""
        sensors = range(len(self.config.sensor))
        return [np.where(self.evidence.sensor == s, change, 0.0) for s in sensors]

    def by_run(self, change: FloatArray) -> list[FloatArray]:
        """Split a change (n,) into one of each run alone."""
        return [np.where(self.evidence.run == i, change, 0.0) for i in range(len(self.forward.runs))]

    def by_gain(self, config: Config, predicted: FloatArray) -> list[FloatArray]:
        """Return the change (n,) for each thermocouple whose gain is off towards the air by the common
        tolerance.

        Sensors whose `shows` has its own tolerance or is fitted are left out.

        Args:
            config: The configuration with the tolerance.
            predicted: Its prediction, °C, (n,).
        """
        gain = config.tolerance.gain
        if gain == 0.0:
            return []
        changes = self.by_sensor(gain * (self.evidence.rows(self.forward.airs(config)) - predicted))
        return [
            c
            for c, s in zip(changes, config.sensor, strict=True)
            if s.kind == "temperature"
            and s.shows_tolerance is None
            and f"sensor.{s.name}.shows" not in self.keys
        ]

    def by_timing(self, predicted: FloatArray) -> list[FloatArray]:
        """Return the change (n,) of each coarsely sampled run by a delay of half a row.

        Only the recorder knows whether a value holds until the next row or ramps to it.

        Args:
            predicted: The prediction, °C, (n,).
        """
        changes = []
        for i, run in enumerate(self.forward.runs):
            if run.row_s < FAR_APART_S or run.coarse:  # see `Forward.by_coarse_rows`
                continue
            change = np.zeros_like(predicted)
            for s in range(len(self.config.sensor)):
                rows = np.flatnonzero((self.evidence.run == i) & (self.evidence.sensor == s))
                if len(rows) > 1:
                    change[rows] = -0.5 * run.row_s * np.gradient(predicted[rows], self.evidence.time_s[rows])
            changes.append(change)
        return changes

    def marginal(self, rows: BoolArray, modelled: frozenset[str]) -> Marginal:
        """Return the map that marginalises the nuisance parameters on some rows; the identity without any.

        Args:
            rows: True for the rows, (n,).
            modelled: Sensors whose lag is part of a hypothesis and is not marginalised.
        """
        nuisance = self.nuisance or NuisanceColumns(self._columns([]), self._columns([]), (), ())
        return nuisance.marginal(rows, modelled)

    def _columns(self, columns: Sequence[FloatArray]) -> FloatArray:
        if not columns:
            return np.zeros((len(self.evidence.run), 0))
        return self.evidence.whitened(np.column_stack(columns))


def modelled_lags(config: Config, *additional: EffectTable) -> frozenset[str]:
    """Return the names of the sensors whose lag is an effect of a configuration.

    Args:
        config: The configuration.
        additional: Further effects that count too.
    """
    terms = (term for effect in (*config.effect, *additional) for term in effect.terms(config))
    return frozenset(term.sensor for term in terms if isinstance(term, Lag))
