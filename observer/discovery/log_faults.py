"""What may be wrong with logs, as hypotheses: clocks, columns, scales, offsets, the air.

Each is fitted with every free parameter and within every tolerance: inputs shifted in time, two sensors
exchanged, a heat scale or an ambient of its own for each log, offsets, a sensor that reads a source's heat.
Most are linear in what they add, and all are in the free parameters nearly so: a few Gauss-Newton steps on
predictions that are there already, where the search for an effect predicts anew for each.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from observer.config import Config
from observer.effects.base import Unnamed
from observer.effects.terms import AmbientShift, Offset
from observer.fit.hypothesis import Fit
from observer.fit.problem import Problem, told_lags
from observer.frames import FloatArray

What = Literal[
    "heat starts late",
    "units",
    "ambient",
    "sensors exchanged",
    "heat differs between logs",
    "sensor follows the heater",
    "offsets",
]
Means = list[FloatArray]
"""Of each run (b, s, …)."""
Change = Callable[[int, FloatArray], FloatArray]
"""What makes means (b, s, c) of run number i others."""
Columns = Callable[[Problem, Config], list[FloatArray]]
"""Changes (n,) in K of the prediction with one unit of each parameter of a hypothesis."""

PER_PARAMETER = 6.0
"""What each parameter beyond the first has to earn, as those of effects have."""
WORTH = 3.0
"""The least score from which on a hypothesis is linearised anew where it brought the parameters."""
SHIFTS_S = np.concatenate([np.arange(-900.0, 0.0, 60.0), np.arange(60.0, 901.0, 60.0)])
LAST = 6
"""Half minutes from which a log is taken on beyond its end."""
FINER_S = (30.0, 10.0)
"""By how much inputs may be shifted, and how finely that is told in later rounds."""
NEAR = 0.1
"""How far from a source, as a part of the screw's length, a sensor may sit that follows its heat."""
SCALED, DIFFERENCE = 0.1, 1e-3
"""Finite differences: of a heat's scale, and of a free parameter in its natural scale."""


@dataclass(frozen=True)
class Hypothesis:
    """What may be wrong with the logs.

    `change` puts the predicted means where the logs have them, `columns` are what its `parameters` multiply;
    `about`: the sensors, sources or runs it is about; `late_s` by how much inputs come late.
    """

    what: What
    parameters: int
    about: tuple[int, ...] = ()
    change: Change | None = None
    columns: Columns | None = None
    late_s: float = 0.0


@dataclass(frozen=True)
class Weighed:
    """A hypothesis about the logs, fitted.

    `drop`: how far it brings the deviance over all logs down from that of the null hypothesis. `values` and
    their standard deviations `sigma` (k,) are those of its columns' parameters; `left`: the deviance.
    """

    hypothesis: Hypothesis
    drop: float
    left: float
    values: FloatArray
    sigma: FloatArray
    config: Config


class Linear(NamedTuple):
    """A fit linear about a configuration: its deviance, the step (p,), and the covariance (p, p) of that."""

    deviance: float
    step: FloatArray
    covariance: FloatArray


def solved(problem: Problem, config: Config, residual: FloatArray, J: FloatArray) -> Linear:
    """The least squares of a whitened residual (n,) over all rows, tolerances marginalised."""
    marginal = problem.marginal(np.ones(len(residual), dtype=bool), told_lags(config))
    A, b = marginal(J), marginal(residual)
    step = np.linalg.lstsq(A, b, rcond=1e-8)[0]
    covariance = np.asarray(np.linalg.pinv(A.T @ A))
    return Linear(float(np.sum((b - A @ step) ** 2)), np.asarray(step), covariance)


def deviance(fit: Fit) -> float:
    """The deviance of a fitted hypothesis over all logs, its parameters brought to all of them."""
    return solved(fit.problem, fit.config, fit.residual, fit.jacobian).deviance


@dataclass(frozen=True)
class Look:
    """The problem at a configuration: predicted means with their derivatives, (b, s, 1 + f) of each run."""

    problem: Problem
    config: Config
    means: Means

    @classmethod
    def at(cls, problem: Problem, config: Config) -> Look:
        """Predict, and take the derivatives by the free parameters."""
        here, values = problem.forward(config), problem.free_values(config)
        slopes = []
        for i, scale in enumerate(problem.scale):
            step = DIFFERENCE * scale
            step = step if values[i] + step <= problem.bounds[1][i] else -step
            moved = problem.with_free(config, values + step * (np.arange(len(values)) == i))
            each = zip(problem.forward(moved), here, strict=True)
            slopes.append([(m - h) * (scale / step) for m, h in each])
        return cls(
            problem, config, [np.stack([h, *(s[i] for s in slopes)], axis=2) for i, h in enumerate(here)]
        )

    def weighed(self, hypothesis: Hypothesis, null: float) -> Weighed:
        """Fit a hypothesis, linear about here; `null` is the deviance without it."""
        change = hypothesis.change or (lambda _run, means: means)
        rows = _rows(self.problem, [change(i, m) for i, m in enumerate(self.means)])
        residual = self.problem.evidence.measured_degC - rows[:, 0]
        more = hypothesis.columns(self.problem, self.config) if hypothesis.columns else []
        columns = self.problem.evidence.whitened(np.column_stack([residual, rows[:, 1:], *more]))
        fit = solved(self.problem, self.config, columns[:, 0], columns[:, 1:])
        k = len(more)
        values = self.problem.free_values(self.config) + fit.step[: len(fit.step) - k] * self.problem.scale
        sigma = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
        return Weighed(
            hypothesis,
            null - fit.deviance,
            fit.deviance,
            fit.step[len(fit.step) - k :],
            sigma[len(sigma) - k :],
            self.problem.with_free(self.config, values),
        )

    def heats(self) -> dict[str, float]:
        """What the free parameters of heats are to be multiplied by, linear about here, without bounds."""
        problem, values = self.problem, self.problem.free_values(self.config)
        rows = _rows(problem, self.means)
        residual = problem.evidence.measured_degC - rows[:, 0]
        columns = problem.evidence.whitened(np.column_stack([residual, rows[:, 1:]]))
        step = solved(problem, self.config, columns[:, 0], columns[:, 1:]).step * problem.scale
        each = zip(problem.keys, values.tolist(), step.tolist(), strict=True)
        return {key: 1.0 + by / value for key, value, by in each if key.startswith("source.") and value > 0.0}


def _rows(problem: Problem, means: Means) -> FloatArray:
    """Pick the rows (n, c) out of means (b, s, c)."""
    e = problem.evidence
    out = np.empty((len(e.run), means[0].shape[2]))
    for i, values in enumerate(means):
        mine = e.run == i
        out[mine] = values[e.mean[mine], e.sensor[mine]]
    return out


def late(problem: Problem, late_s: float) -> Hypothesis:
    """Inputs that come so much later in the logs than they came."""

    def change(run: int, means: FloatArray) -> FloatArray:
        time_s = problem.forward.runs[run].ticks.time_s
        at_s = time_s + late_s
        at = np.interp(at_s, time_s, np.arange(len(time_s)))
        low = np.minimum(at.astype(int), max(len(time_s) - 2, 0))
        high = np.minimum(low + 1, len(time_s) - 1)
        part = (at - low)[:, None, None]
        last = max(len(time_s) - 1 - LAST, 0)  # beyond the end it goes on as it went
        slope = (means[-1] - means[last]) / max(time_s[-1] - time_s[last], 1.0)
        beyond_s = np.maximum(at_s - time_s[-1], 0.0)[:, None, None]
        return np.asarray((1 - part) * means[low] + part * means[high] + beyond_s * slope)

    return Hypothesis("heat starts late", 1, change=change, late_s=late_s)


def exchanged(a: int, b: int) -> Hypothesis:
    """Two sensors in each other's place."""

    def change(_run: int, means: FloatArray) -> FloatArray:
        out = means.copy()
        out[:, a], out[:, b] = means[:, b], means[:, a]
        return out

    return Hypothesis("sensors exchanged", 1, (a, b), change)


def elsewhere(runs: int) -> Iterator[Hypothesis]:
    """Air that is warmer or colder than it is said to be: in all logs alike, or in each and as it goes on."""

    def change(problem: Problem, config: Config, *term: AmbientShift) -> FloatArray:
        return np.asarray(problem.predicted(_with(config, *term)) - problem.predicted(config))

    def alike(problem: Problem, config: Config) -> list[FloatArray]:
        return [change(problem, config, AmbientShift(0.0, 1.0))]

    def each(problem: Problem, config: Config) -> list[FloatArray]:
        shifts = (AmbientShift(0.0, 1.0), AmbientShift(1.0, 0.0))
        return [c for s in shifts for c in problem.by_run(change(problem, config, s))]

    yield Hypothesis("ambient", 1, tuple(range(runs)), columns=alike)
    yield Hypothesis("ambient", 2 * runs, tuple(range(runs)), columns=each)


def offset(sensors: int) -> Hypothesis:
    """An offset of each sensor, beyond its tolerance."""

    def columns(problem: Problem, config: Config) -> list[FloatArray]:
        here = problem.predicted(config)
        return [problem.predicted(_with(config, Offset(s.name, 1.0, 0.0))) - here for s in config.sensor]

    return Hypothesis("offsets", sensors, tuple(range(sensors)), columns=columns)


def scaled(runs: int, sources: Sequence[int]) -> Hypothesis:
    """Another scale of some sources' heat in each log but the first."""

    def columns(problem: Problem, config: Config) -> list[FloatArray]:
        more = [
            s.model_copy(update={"scale": s.scale * (1 + SCALED)}) if i in sources else s
            for i, s in enumerate(config.source)
        ]
        moved = problem.predicted(config.model_copy(update={"source": tuple(more)}))
        return problem.by_run((moved - problem.predicted(config)) / SCALED)[1:]

    return Hypothesis("heat differs between logs", runs - 1, tuple(sources), columns=columns)


def follows(sensor: int, source: int, late: int = 0) -> Hypothesis:
    """A sensor that shows a source's heat at once; or in some shares up to so many half minutes late."""

    def columns(problem: Problem, config: Config) -> list[FloatArray]:
        heats = [
            np.repeat(h[:, source, None], len(config.sensor), 1) for h in problem.forward.heats_W(config)
        ]
        each = [[np.vstack([h[:1]] * by + [h[: len(h) - by]]) for h in heats] for by in range(late + 1)]
        return [np.where(problem.evidence.sensor == sensor, problem.evidence.rows(m), 0.0) for m in each]

    return Hypothesis("sensor follows the heater", 1 + late, (sensor, source), columns=columns)


def _with(config: Config, *terms: AmbientShift | Offset) -> Config:
    return config.model_copy(update={"effect": (*config.effect, Unnamed(terms))})


def _beside(config: Config, sensor: int, source: int) -> bool:
    """Whether a sensor sits on or right beside a source that stays in its place."""
    at, by, near_m = config.sensor[sensor], config.source[source], NEAR * config.screw.length_m
    if at.position_m is None:
        return at.on in (by.nodes or {})
    if by.position_m is not None:
        return abs(at.position_m - by.position_m) <= near_m
    if by.from_m is None or by.to_m is None:
        return False
    return by.from_m - near_m <= at.position_m <= by.to_m + near_m


def hypotheses(problem: Problem) -> Iterator[Hypothesis]:
    """Yield what may be wrong with the logs of a problem."""
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


def weigh(null: Fit) -> list[Weighed]:
    """Return the best hypothesis of each suspect, the most telling first."""
    problem, without = null.problem, deviance(null)
    first = Look.at(problem, null.config)
    best: dict[str, Weighed] = {}
    for h in hypotheses(problem):
        one = first.weighed(h, without)
        if h.what not in best or score(one) > score(best[h.what]):
            best[h.what] = one
    return sorted((_refined(problem, w, without) for w in best.values()), key=lambda w: -score(w))


def score(weighed: Weighed) -> float:
    """The drop of the deviance, less what its parameters have to earn."""
    return weighed.drop - PER_PARAMETER * (weighed.hypothesis.parameters - 1)


def _refined(problem: Problem, weighed: Weighed, null: float) -> Weighed:
    """The hypothesis linearised anew where it brought the parameters: from the calibration on, which without
    it may have gone far astray, or from the configuration as given.
    """
    if score(weighed) < WORTH:
        return weighed
    given = replace(weighed, config=problem.config)
    return max((_nearer(problem, w, null) for w in (weighed, given)), key=lambda w: w.drop)


def _nearer(problem: Problem, weighed: Weighed, null: float) -> Weighed:
    """The hypothesis after a few more rounds."""
    for finer_s in FINER_S:
        look, h = Look.at(problem, weighed.config), weighed.hypothesis
        near = [h] if not h.late_s else [late(problem, h.late_s + i * finer_s) for i in range(-2, 3)]
        weighed = max((look.weighed(n, null) for n in near), key=lambda w: w.drop)
    return weighed
