"""Possible faults of logs, as hypotheses: clocks, columns, scales, offsets, the air.

Each is fitted with every free parameter and within every tolerance. The faults are shifted inputs, two
exchanged sensors, a heat scale or an ambient for each log, offsets, and a sensor that reads a source's heat.
Most faults are linear in their own parameters, and nearly linear in the free ones. So a few Gauss-Newton
steps on existing predictions suffice, whereas the search for an effect needs a new prediction for each.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Literal

import numpy as np

from observer.config.effects.terms import AmbientShift, SensorOffset, Term
from observer.config.machine import Config
from observer.discovery.candidates import score
from observer.fit.hypothesis import Fit
from observer.fit.linear import LinearFit
from observer.fit.problem import Problem, modelled_lags
from observer.fit.tolerance import Scope, with_terms
from observer.frames import FloatArray

FaultKind = Literal[
    "heat starts late",
    "units",
    "ambient",
    "sensors exchanged",
    "heat differs between logs",
    "sensor follows the heater",
    "offsets",
    "nut's way",
]
Means = list[FloatArray]
"""Of each run (b, s, …)."""
Transform = Callable[[int, FloatArray], FloatArray]
"""Transforms the means (b, s, c) of run number i."""
Columns = Callable[[Problem, Config], list[FloatArray]]
"""Changes (n,) in K of the prediction with one unit of each parameter of a fault."""

WORTH = 3.0
"""Least score at which a hypothesis is linearised again at its fitted parameters."""
SHIFTS_S = np.concatenate([np.arange(-900.0, 0.0, 60.0), np.arange(60.0, 901.0, 60.0)])
LAST = 6
"""Half minutes at the end of a log from which it is extrapolated."""
FINER_S = (30.0, 10.0)
"""Resolutions of the time shift in later rounds."""
NEAR = 0.1
"""Largest distance from a source, as a part of the screw's length, of a sensor that follows its heat."""
SCALED = 0.1
"""Finite difference of a heat's scale."""


@dataclass(frozen=True)
class LogFault:
    """A possible fault of the logs.

    Attributes:
        kind: The kind of fault.
        indices: Numbers of the sensors, sources or runs concerned.
        transform: Changes the predicted means as the fault would.
        columns: Returns the changes of the prediction by one unit of each of the fault's parameters.
        late_s: Delay of the inputs, s; 0 for other kinds.
    """

    kind: FaultKind
    indices: tuple[int, ...] = ()
    transform: Transform = lambda _run, means: means
    columns: Columns = lambda _problem, _config: []
    late_s: float = 0.0


@dataclass(frozen=True)
class FaultFit:
    """A fault, fitted to all logs.

    Attributes:
        fault: The fault.
        drop: Fall of the deviance from that of the null hypothesis.
        left: Remaining deviance.
        values: Parameters, one for each column of `fault`, (k,).
        config: Configuration with the free parameters fitted beside it.
    """

    fault: LogFault
    drop: float
    left: float
    values: FloatArray
    config: Config

    @property
    def parameters(self) -> int:
        """The number of its parameters: one for each column, or 1 for the choice of its transform."""
        return max(len(self.values), 1)

    @property
    def score(self) -> float:
        """The drop of the deviance, less the drop required for its parameters."""
        return score(self.drop, self.parameters)


@dataclass(frozen=True)
class Linearised:
    """The problem at a configuration, where faults are fitted.

    Attributes:
        problem: Data and free parameters.
        config: The configuration.
    """

    problem: Problem
    config: Config

    @cached_property
    def means(self) -> Means:
        """Predicted means with their f derivatives, (b, s, 1 + f) of each run, K per scale."""
        return self.problem.means_with_slopes(self.config)

    def fitted(self, fault: LogFault, null: float) -> FaultFit:
        """Fit a fault with the free parameters, linear about this configuration.

        Args:
            fault: The fault.
            null: Deviance over all logs without it.
        """
        means = [fault.transform(i, m) for i, m in enumerate(self.means)]
        fit = self._linear(means, fault.columns(self.problem, self.config))
        free, left = len(self.problem.keys), fit.deviance
        values = self.problem.free_values(self.config) + fit.step[:free] * self.problem.scale
        return FaultFit(
            fault, null - left, left, fit.step[free:], self.problem.with_free(self.config, values)
        )

    def heats(self) -> dict[str, float]:
        """Return the factors on the free parameters of heats, by key.

        They are from an unbounded linear fit. Far from 1, they show a wrong unit.
        """
        problem, values = self.problem, self.problem.free_values(self.config).tolist()
        step = (self._linear(self.means).step * problem.scale).tolist()
        rows = zip(problem.keys, values, step, strict=True)
        return {key: 1.0 + by / value for key, value, by in rows if key.startswith("source.") and value > 0.0}

    def _linear(self, means: Means, additional: Sequence[FloatArray] = ()) -> LinearFit:
        """Return the linear fit of means with their derivatives to all rows, with `additional` columns
        (n,).
        """
        evidence = self.problem.evidence
        rows = evidence.rows(means)
        columns = np.column_stack([evidence.measured_degC - rows[:, 0], rows[:, 1:], *additional])
        marginal = self.problem.marginal(np.ones(len(columns), dtype=bool), modelled_lags(self.config))
        columns = marginal(evidence.whitened(columns))
        return LinearFit.of(columns[:, 1:], columns[:, 0])


def late(problem: Problem, late_s: float) -> LogFault:
    """Return the fault that inputs were recorded later than they occurred.

    Predictions beyond the end of a log are extrapolated by the slope of its last three minutes.

    Args:
        problem: The runs, for their times.
        late_s: Delay, s; negative if they were recorded too early.
    """

    def transform(run: int, means: FloatArray) -> FloatArray:
        time_s = problem.forward.runs[run].ticks.time_s
        at_s = time_s + late_s
        at = np.interp(at_s, time_s, np.arange(len(time_s)))
        low = np.minimum(at.astype(int), max(len(time_s) - 2, 0))
        high = np.minimum(low + 1, len(time_s) - 1)
        part = (at - low)[:, None, None]
        last = max(len(time_s) - 1 - LAST, 0)  # extrapolate beyond the end
        slope = (means[-1] - means[last]) / max(time_s[-1] - time_s[last], 1.0)
        beyond_s = np.maximum(at_s - time_s[-1], 0.0)[:, None, None]
        return np.asarray((1 - part) * means[low] + part * means[high] + beyond_s * slope)

    return LogFault("heat starts late", transform=transform, late_s=late_s)


def exchanged(a: int, b: int) -> LogFault:
    """Return the fault that the sensors with the numbers `a` and `b` are exchanged."""

    def transform(_run: int, means: FloatArray) -> FloatArray:
        out = means.copy()
        out[:, a], out[:, b] = means[:, b], means[:, a]
        return out

    return LogFault("sensors exchanged", (a, b), transform)


def elsewhere(runs: int) -> Iterator[LogFault]:
    """Yield the faults of the ambient: an offset common to all logs, or an offset and a drift in each.

    Args:
        runs: Number of logs. The second fault has two parameters, K and K/h, for each.
    """
    all_runs, offset, drift = tuple(range(runs)), AmbientShift(0.0, 1.0), AmbientShift(1.0, 0.0)
    yield LogFault("ambient", all_runs, columns=_of_terms([offset], "whole"))
    yield LogFault("ambient", all_runs, columns=_of_terms([offset, drift], "run"))


def offsets(config: Config) -> LogFault:
    """Return the fault of an offset of each sensor beyond its tolerance, with one parameter in K for each."""
    terms = [SensorOffset(s.name, 1.0, 0.0) for s in config.sensor]
    return LogFault("offsets", tuple(range(len(terms))), columns=_of_terms(terms, "whole"))


def _of_terms(terms: Sequence[Term], scope: Scope) -> Columns:
    """Return the columns of terms that are added to a configuration."""
    return lambda problem, config: problem.changes_K(config, ((with_terms(config, t), scope) for t in terms))


def scaled(sources: Sequence[int]) -> LogFault:
    """Return the fault of another scale of some sources' heat in each log but the first.

    Args:
        sources: Numbers of the sources, which share the scale. Each log has one parameter, relative.
    """

    def columns(problem: Problem, config: Config) -> list[FloatArray]:
        table = [
            s.model_copy(update={"scale": s.scale * (1 + SCALED)}) if i in sources else s
            for i, s in enumerate(config.source)
        ]
        changed = config.model_copy(update={"source": tuple(table)})
        return [change / SCALED for change in problem.changes_K(config, [(changed, "run")])[1:]]

    return LogFault("heat differs between logs", tuple(sources), columns=columns)


def follows(sensor: int, source: int, half_minutes: int = 0) -> LogFault:
    """Return the fault of a sensor that responds directly to a source's heat.

    Args:
        sensor: Number of the sensor.
        source: Number of the source.
        half_minutes: Latest half minute at which it responds. The fault has one parameter, K/W, for each
            delay from 0.
    """

    def columns(problem: Problem, config: Config) -> list[FloatArray]:
        heats = [
            np.repeat(h[:, source, None], len(config.sensor), 1) for h in problem.forward.heats_W(config)
        ]
        delayed = [
            [np.vstack([h[:1]] * by + [h[: len(h) - by]]) for h in heats] for by in range(half_minutes + 1)
        ]
        return [problem.by_sensor(problem.evidence.rows(means))[sensor] for means in delayed]

    return LogFault("sensor follows the heater", (sensor, source), columns=columns)


def _is_near(config: Config, sensor: int, source: int) -> bool:
    """Whether a sensor is on or next to a fixed source."""
    at, by, near_m = config.sensor[sensor], config.source[source], NEAR * config.screw.length_m
    if at.position_m is None:
        return at.on in (by.nodes or {})
    if by.position_m is not None:
        return abs(at.position_m - by.position_m) <= near_m
    if by.from_m is None or by.to_m is None:
        return False
    return by.from_m - near_m <= at.position_m <= by.to_m + near_m


def possible_faults(problem: Problem) -> Iterator[LogFault]:
    """Yield the possible faults of the logs of a problem.

    Shifted inputs and scales need a heat with a law; a scale also needs several logs. A sensor follows a heat
    only beside a fixed source.
    """
    config = problem.config
    sensors, runs = len(config.sensor), len(problem.forward.runs)
    laws = [i for i, s in enumerate(config.source) if s.law not in (None, "heat_of")]
    if laws:
        yield from (late(problem, s) for s in SHIFTS_S.tolist())
    yield from itertools.starmap(exchanged, itertools.combinations(range(sensors), 2))
    yield from elsewhere(runs)
    yield offsets(config)
    if runs > 1 and laws:
        yield from map(scaled, dict.fromkeys([tuple(laws), *((i,) for i in laws)]))
    yield from (follows(*pair) for pair in itertools.product(range(sensors), laws) if _is_near(config, *pair))


def fit_faults(null: Fit) -> list[FaultFit]:
    """Return the best fault of each kind, the highest score first.

    Args:
        null: The fit without effects or faults.
    """
    problem, without = null.problem, null.deviance_of_all
    linearised = Linearised(problem, null.config)
    best: dict[str, FaultFit] = {}
    for fault in possible_faults(problem):
        fitted = linearised.fitted(fault, without)
        best[fault.kind] = max(best.get(fault.kind, fitted), fitted, key=attrgetter("score"))
    return sorted(
        (_refined(problem, fitted, without) for fitted in best.values()),
        key=attrgetter("score"),
        reverse=True,
    )


def _refined(problem: Problem, fitted: FaultFit, null: float) -> FaultFit:
    """Return the fault linearised again at its fitted parameters.

    It starts from the calibration, which may be far off without the fault, and from the original
    configuration; the better result is returned.
    """
    if fitted.score < WORTH:
        return fitted
    ends = []
    for start in (fitted, replace(fitted, config=problem.config)):
        end = start
        for finer_s in FINER_S:
            linearised, fault = Linearised(problem, end.config), end.fault
            near = [fault]
            if fault.late_s:
                near = [late(problem, fault.late_s + i * finer_s) for i in range(-2, 3)]
            end = max((linearised.fitted(n, null) for n in near), key=lambda f: f.drop)
        ends.append(end)
    return max(ends, key=lambda f: f.drop)
