"""Possible faults of logs, as hypotheses: clocks, columns, scales, offsets, the air.

Each is fitted with every free parameter and within every tolerance: inputs shifted in time, two sensors
exchanged, a heat scale or an ambient of its own for each log, offsets, a sensor that reads a source's heat.
Most are linear in what they add, and nearly linear in the free parameters: a few Gauss-Newton steps on
existing predictions suffice, where the search for an effect needs a new prediction for each.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from observer.config import Config
from observer.effects.base import Unnamed
from observer.effects.terms import AmbientShift, SensorOffset
from observer.fit.hypothesis import Fit
from observer.fit.problem import Problem, modelled_lags
from observer.frames import FloatArray
from observer.linear_fit import LinearFit

What = Literal[
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
Change = Callable[[int, FloatArray], FloatArray]
"""Transforms the means (b, s, c) of run number i."""
Columns = Callable[[Problem, Config], list[FloatArray]]
"""Changes (n,) in K of the prediction with one unit of each parameter of a hypothesis."""

PER_PARAMETER = 6.0
"""Drop of the deviance required for each parameter beyond the first, as for effects."""
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
    """What may be wrong with the logs.

    `change` transforms the predicted means as the fault would, `columns` are what its `parameters` multiply;
    `about`: the sensors, sources or runs concerned; `late_s` the delay of the inputs.
    """

    what: What
    parameters: int
    about: tuple[int, ...] = ()
    change: Change | None = None
    columns: Columns | None = None
    late_s: float = 0.0


@dataclass(frozen=True)
class FaultFit:
    """A hypothesis about the logs, fitted.

    `drop`: by how much it lowers the deviance over all logs from that of the null hypothesis. `values` and
    their standard deviations `sigma` (k,) belong to its columns' parameters; `left`: the remaining deviance.
    """

    hypothesis: LogFault
    drop: float
    left: float
    values: FloatArray
    sigma: FloatArray
    config: Config


def deviance(fit: Fit) -> float:
    """The deviance of a fitted hypothesis over all logs, its parameters refitted to all of them."""
    return fit.linear(np.ones(len(fit.residual), dtype=bool)).deviance


@dataclass(frozen=True)
class Linearised:
    """The problem at a configuration: predicted means with their derivatives, (b, s, 1 + f) of each run."""

    problem: Problem
    config: Config
    means: Means

    @classmethod
    def at(cls, problem: Problem, config: Config) -> Linearised:
        """Predict, and take the derivatives by the free parameters."""
        here, slopes = problem.forward(config), []
        for moved, per in problem.differences(config):
            slopes.append([(m - h) * per for m, h in zip(problem.forward(moved), here, strict=True)])
        means = [np.stack([h, *(s[i] for s in slopes)], axis=2) for i, h in enumerate(here)]
        return cls(problem, config, means)

    def fitted(self, hypothesis: LogFault, null: float) -> FaultFit:
        """Fit a hypothesis, linear about here; `null` is the deviance without it."""
        change = hypothesis.change or (lambda _run, means: means)
        more = hypothesis.columns(self.problem, self.config) if hypothesis.columns else []
        fit = self._linear([change(i, m) for i, m in enumerate(self.means)], more)
        free, left = len(self.problem.keys), fit.deviance
        values = self.problem.free_values(self.config) + fit.step[:free] * self.problem.scale
        fitted = self.problem.with_free(self.config, values)
        return FaultFit(hypothesis, null - left, left, fit.step[free:], fit.sigma[free:], fitted)

    def heats(self) -> dict[str, float]:
        """The factors on the free parameters of heats, from an unbounded linear fit about here."""
        problem, values = self.problem, self.problem.free_values(self.config).tolist()
        step = (self._linear(self.means).step * problem.scale).tolist()
        each = zip(problem.keys, values, step, strict=True)
        return {key: 1.0 + by / value for key, value, by in each if key.startswith("source.") and value > 0.0}

    def _linear(self, means: Means, more: Sequence[FloatArray] = ()) -> LinearFit:
        """The fit of means with their derivatives to all rows, beside `more` columns (n,)."""
        evidence = self.problem.evidence
        rows = evidence.rows(means)
        columns = np.column_stack([evidence.measured_degC - rows[:, 0], rows[:, 1:], *more])
        marginal = self.problem.marginal(np.ones(len(columns), dtype=bool), modelled_lags(self.config))
        columns = marginal(evidence.whitened(columns))
        return LinearFit.of(columns[:, 1:], columns[:, 0])


def late(problem: Problem, late_s: float) -> LogFault:
    """Inputs recorded so much later than they occurred."""

    def change(run: int, means: FloatArray) -> FloatArray:
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

    return LogFault("heat starts late", 1, change=change, late_s=late_s)


def exchanged(a: int, b: int) -> LogFault:
    """Two exchanged sensors."""

    def change(_run: int, means: FloatArray) -> FloatArray:
        out = means.copy()
        out[:, a], out[:, b] = means[:, b], means[:, a]
        return out

    return LogFault("sensors exchanged", 1, (a, b), change)


def elsewhere(runs: int) -> Iterator[LogFault]:
    """Air warmer or colder than stated: by the same in all logs, or by an offset and a drift in each."""

    def alike(problem: Problem, config: Config) -> list[FloatArray]:
        return [changed(problem, config, AmbientShift(0.0, 1.0))]

    def each(problem: Problem, config: Config) -> list[FloatArray]:
        shifts = (AmbientShift(0.0, 1.0), AmbientShift(1.0, 0.0))
        return [c for s in shifts for c in problem.by_run(changed(problem, config, s))]

    yield LogFault("ambient", 1, tuple(range(runs)), columns=alike)
    yield LogFault("ambient", 2 * runs, tuple(range(runs)), columns=each)


def offset(sensors: int) -> LogFault:
    """An offset of each sensor, beyond its tolerance."""

    def columns(problem: Problem, config: Config) -> list[FloatArray]:
        return [changed(problem, config, SensorOffset(s.name, 1.0, 0.0)) for s in config.sensor]

    return LogFault("offsets", sensors, tuple(range(sensors)), columns=columns)


def changed(problem: Problem, config: Config, term: AmbientShift | SensorOffset) -> FloatArray:
    """The change (n,) of the prediction with one more term, K."""
    more = config.model_copy(update={"effect": (*config.effect, Unnamed((term,)))})
    return np.asarray(problem.predicted(more) - problem.predicted(config))


def scaled(runs: int, sources: Sequence[int]) -> LogFault:
    """Another scale of some sources' heat in each log but the first."""

    def columns(problem: Problem, config: Config) -> list[FloatArray]:
        more = list(config.source)
        for i in sources:
            more[i] = more[i].model_copy(update={"scale": more[i].scale * (1 + SCALED)})
        moved = problem.predicted(config.model_copy(update={"source": tuple(more)}))
        return problem.by_run((moved - problem.predicted(config)) / SCALED)[1:]

    return LogFault("heat differs between logs", runs - 1, tuple(sources), columns=columns)


def follows(sensor: int, source: int, late: int = 0) -> LogFault:
    """A sensor that responds to a source's heat at once, or partly up to so many half minutes late."""

    def columns(problem: Problem, config: Config) -> list[FloatArray]:
        heats = [
            np.repeat(h[:, source, None], len(config.sensor), 1) for h in problem.forward.heats_W(config)
        ]
        each = [[np.vstack([h[:1]] * by + [h[: len(h) - by]]) for h in heats] for by in range(late + 1)]
        return [np.where(problem.evidence.sensor == sensor, problem.evidence.rows(m), 0.0) for m in each]

    return LogFault("sensor follows the heater", 1 + late, (sensor, source), columns=columns)


def _beside(config: Config, sensor: int, source: int) -> bool:
    """Whether a sensor sits on or right beside a source that does not move."""
    at, by, near_m = config.sensor[sensor], config.source[source], NEAR * config.screw.length_m
    if at.position_m is None:
        return at.on in (by.nodes or {})
    if by.position_m is not None:
        return abs(at.position_m - by.position_m) <= near_m
    if by.from_m is None or by.to_m is None:
        return False
    return by.from_m - near_m <= at.position_m <= by.to_m + near_m


def hypotheses(problem: Problem) -> Iterator[LogFault]:
    """Yield the possible faults of the logs of a problem."""
    config = problem.config
    sensors, runs = len(config.sensor), len(problem.forward.runs)
    laws = [i for i, s in enumerate(config.source) if s.law not in (None, "heat_of")]
    if laws:
        yield from (late(problem, s) for s in SHIFTS_S.tolist())
    yield from itertools.starmap(exchanged, itertools.combinations(range(sensors), 2))
    yield from elsewhere(runs)
    yield offset(sensors)
    if runs > 1 and laws:
        yield from (scaled(runs, each) for each in dict.fromkeys([tuple(laws), *((i,) for i in laws)]))
    yield from (follows(*pair) for pair in itertools.product(range(sensors), laws) if _beside(config, *pair))


def fit_faults(null: Fit) -> list[FaultFit]:
    """Return the best hypothesis for each kind of fault, the highest score first."""
    problem, without = null.problem, deviance(null)
    first = Linearised.at(problem, null.config)
    best: dict[str, FaultFit] = {}
    for h in hypotheses(problem):
        one = first.fitted(h, without)
        best[h.what] = max(best.get(h.what, one), one, key=score)
    return sorted((_refined(problem, w, without) for w in best.values()), key=score, reverse=True)


def score(fitted: FaultFit) -> float:
    """The drop of the deviance, less that required for its parameters."""
    return fitted.drop - PER_PARAMETER * (fitted.hypothesis.parameters - 1)


def _refined(problem: Problem, fitted: FaultFit, null: float) -> FaultFit:
    """The hypothesis linearised again at its fitted parameters: starting from the calibration, which may be
    far off without it, or from the configuration as given.
    """
    if score(fitted) < WORTH:
        return fitted
    ends = []
    for start in (fitted, replace(fitted, config=problem.config)):
        end = start
        for finer_s in FINER_S:
            look, h = Linearised.at(problem, end.config), end.hypothesis
            near = [late(problem, h.late_s + i * finer_s) for i in range(-2, 3)] if h.late_s else [h]
            end = max((look.fitted(n, null) for n in near), key=lambda w: w.drop)
        ends.append(end)
    return max(ends, key=lambda w: w.drop)
