"""The parts of a fit by hand: evidence, tolerances, the problem and its hypotheses, without any machine."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from observer.config.effects.terms import Lag, SensorOffset, StretchFilm
from observer.config.machine import Config
from observer.fit.evidence import (
    PROOF,
    UNUSED,
    Evidence,
    even,
    gather,
    shown_noise,
)
from observer.fit.hypothesis import EffectParameter, Fit, fit_effects, fit_null, replaces, with_effects
from observer.fit.parameters import FILM, get, with_values
from observer.fit.problem import Problem, modelled_lags
from observer.fit.tolerance import tolerances
from observer.frames import FloatArray
from tests.logs.machines import machine

NOISE_K = np.array([0.05, 0.02])


def stepped(
    means: int = 40, *, rise_K: Any = (5.0, 1.0), rows: int = 400, steps_K: Any = (0.05, 0.02)
) -> Any:
    """As much of a run of two sensors as evidence is made of: each steps up and down by as much each row."""
    time_s = 30.0 * np.arange(1.0, means + 1)
    level = 20.0 + np.outer(time_s / time_s[-1], rise_K)
    values = np.where(np.arange(rows)[:, None] % 2, 0.5, -0.5) * np.asarray(steps_K)
    since_s = np.linspace(0.0, time_s[-1], rows)
    return SimpleNamespace(
        ticks=SimpleNamespace(count=np.full((means, 2), 4.0), measured_degC=level, time_s=time_s),
        run=SimpleNamespace(
            frames=SimpleNamespace(time_s=1000.0 + since_s), duration_s=time_s[-1],
            values_degC=values, usable=np.ones(values.shape, dtype=bool),
        ),
    )  # fmt: skip


# ---- evidence ----


def test_a_mean_takes_part_from_half_of_the_usual_number_on() -> None:
    run = stepped(6)
    run.ticks.count[1] = 2.0, 1.9
    run.ticks.count[2] = 0.0, 9.0
    evidence = even([run, stepped(3)], NOISE_K)
    assert evidence.run.tolist() == [0] * 10 + [1] * 6
    assert evidence.mean.tolist() == [0, 0, 1, 2, 3, 3, 4, 4, 5, 5, 0, 0, 1, 1, 2, 2]
    assert evidence.sensor.tolist() == [0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1]
    np.testing.assert_array_equal(evidence.time_s, 30.0 * (evidence.mean + 1))
    np.testing.assert_array_equal(evidence.measured_degC[2:4], [run.ticks.measured_degC[1, 0], 20.5])
    np.testing.assert_allclose(evidence.noise_K[:4], [0.025, 0.01, 0.05 / np.sqrt(2), 0.02 / 3])
    assert evidence.used.all()
    assert (evidence.folds, evidence.groups, evidence.proof.any()) == (1, (), False)
    picked = evidence.rows([np.arange(12.0).reshape(6, 2), 100 + np.arange(6.0).reshape(3, 2)])
    assert picked.tolist() == [0, 1, 2, 5, 6, 7, 8, 9, 10, 11, 100, 101, 102, 103, 104, 105]
    np.testing.assert_allclose(evidence.whitened(picked), picked / evidence.noise_K)


def test_whitening_is_of_white_slow_and_beating_noise() -> None:
    evidence = gather([stepped()], NOISE_K)
    begin_s = 0.62 * 1200.0
    edges = {0: (0.0, begin_s / 2), 1: (begin_s / 2, begin_s), UNUSED: (begin_s, begin_s + 96.0)}
    for fold, (low_s, high_s) in edges.items():
        mine = evidence.time_s[evidence.fold == fold]
        assert mine.min() >= low_s
        assert mine.max() <= high_s
    assert evidence.time_s[evidence.fold == PROOF].min() > begin_s + 96.0
    assert (evidence.time_s[evidence.fold == PROOF] < begin_s + 96.0 + 31.0).any()
    rise_K = []
    for s in range(2):
        fitted = evidence.measured_degC[(evidence.sensor == s) & evidence.used]
        rise_K.append(float(np.sqrt(np.mean((fitted - fitted[0]) ** 2))))
    seen = np.zeros(len(evidence.run), dtype=int)
    for index, matrix in evidence.groups:
        s = evidence.sensor[index[0]]
        assert (evidence.sensor[index] == s).all()
        assert len(set(evidence.fold[index])) == 1
        seen[index] += 1
        lower = np.linalg.inv(matrix)
        white = (NOISE_K[s] / np.sqrt(2)) ** 2 / 4 + 0.003**2  # each row steps by σ: its noise is σ/√2
        apart = np.abs(evidence.time_s[index][:, None] - evidence.time_s[index])
        expected = white * np.eye(len(index))
        expected += (0.006 + 0.0015 * rise_K[s]) ** 2 * np.exp(-apart / 900.0)
        expected += (0.003 + 0.0006 * rise_K[s]) ** 2 * np.exp(-apart / 90.0)
        np.testing.assert_allclose(lower @ lower.T, expected, rtol=1e-9)
        np.testing.assert_allclose(evidence.noise_K[index], np.sqrt(white), rtol=1e-12)
    assert (seen == 1).all()
    total = sum(float(np.sum((m * evidence.noise_K[i]) ** 2)) for i, m in evidence.groups)
    assert evidence.expected == pytest.approx(total / 80)


def test_whole_logs_are_folds_where_there_are_several() -> None:
    two = gather([stepped(), stepped(20)], NOISE_K)
    assert set(two.fold[two.run == 1]) == {PROOF}
    first = two.run == 0
    np.testing.assert_array_equal(two.fold[first], np.where(two.time_s[first] < 600.0, 0, 1))
    three = gather([stepped(8), stepped(9), stepped(10)], NOISE_K)
    assert [set(three.fold[three.run == i]) for i in range(3)] == [{0}, {1}, {PROOF}]
    assert (two.folds, three.folds) == (2, 2)
    np.testing.assert_array_equal(three.proof, three.run == 2)


def test_the_noise_is_what_neighbours_differ_by() -> None:
    def shown(*runs: Any) -> list[float]:
        return [round(float(n), 6) for n in shown_noise(runs, NOISE_K)]

    root = float(np.sqrt(2))
    assert shown(stepped(steps_K=(0.06, 0.03))) == [round(0.06 / root, 6), round(0.03 / root, 6)]
    assert shown(stepped(steps_K=(1.0, 0.001))) == [0.15, round(0.02 / 3, 6)], "within a factor of three"
    few = stepped(rows=200, steps_K=(0.06, 0.03))
    assert shown(few) == NOISE_K.tolist(), "62 % of these are too few"
    assert shown(few, few, few) == [round(0.06 / root, 6), round(0.03 / root, 6)]
    assert shown(few, few) == NOISE_K.tolist(), "199 of the first"
    assert shown(stepped(rows=201, steps_K=(0.06, 0.03)), few) != NOISE_K.tolist()
    late = stepped(steps_K=(0.06, 0.03))
    late.run.values_degC[late.run.frames.time_s - 1000.0 > 0.62 * 1200.0] *= 50.0
    assert shown(late) == [round(0.06 / root, 6), round(0.03 / root, 6)], "the proof is not looked at"
    jump = stepped(rows=1001, steps_K=(0.06, 0.03))
    jump.run.values_degC[300:, 0] += 100.0
    clipped = np.sqrt((619 * 0.06**2 + (6 * 0.05) ** 2) / 620 / 2)
    assert shown(jump)[0] == pytest.approx(clipped, rel=1e-3)
    hidden = stepped(steps_K=(0.06, 0.03))
    hidden.run.usable[1::2, 0] = False
    assert shown(hidden)[0] == NOISE_K[0], "every other row is too few again"


# ---- tolerances ----


def test_each_tolerance_is_one_standard_deviation_of_one_thing() -> None:
    config = machine()
    every = list(tolerances(config))
    assert [kind for _, kind in every] == ["whole", "whole", "position", *["whole"] * 4, "lag"]
    k, c, place, *films, lag = (changed for changed, _ in every)
    assert k.screw == config.screw.model_copy(update={"conductivity_W_mK": 50.0 * 1.02})
    assert c.screw == config.screw.model_copy(update={"specific_heat_J_kgK": 460.0 * 1.02})
    assert [s.position_m for s in place.sensor] == pytest.approx([0.051, 0.199, 0.349])
    for i, changed in enumerate(films):
        (extra,) = changed.effect
        (term,) = extra.terms(config)
        assert isinstance(term, StretchFilm)
        assert (term.from_m, term.to_m, term.extra_W_m2K) == pytest.approx((0.1 * i, 0.1 * (i + 1), 0.2))
    (lags,) = lag.effect
    assert [(t.sensor, t.time_constant_s) for t in lags.terms(config) if isinstance(t, Lag)] == [
        ("a", 4.0), ("b", 4.0), ("c", 4.0),
    ]  # fmt: skip


def test_no_film_is_not_uneven_and_what_is_beside_the_screw_stays() -> None:
    config = machine(surface={"convection_W_m2K": 0.0})
    beside = config.sensor[0].model_copy(update={"position_m": None})
    config = config.model_copy(update={"sensor": (beside, *config.sensor[1:])})
    every = list(tolerances(config))
    assert [kind for _, kind in every] == ["whole", "whole", "position", "lag"]
    assert every[2][0].sensor[0] == beside


# ---- the problem ----

MEANS = 24
HEATER = "source.heater.scale"


class Straight:
    """Predictions that are linear in film, heater, conductivity, places, biases, films and lags."""

    def __init__(self, gaps: int = 0) -> None:
        rng = np.random.default_rng(8)
        self.by = {name: rng.normal(size=(MEANS, 3)) for name in ("film", "heater", "k", "c", "x", "lag")}
        self.gaps = [rng.normal(size=(MEANS, 3)) for _ in range(gaps)]
        self.asked: list[Config] = []
        self.runs = [SimpleNamespace(row_s=0.5)]

    def __call__(self, config: Config) -> list[FloatArray]:
        self.asked.append(config)
        out = 20.0 + 0.05 * self.by["film"] * get(config, FILM) + self.by["heater"] * get(config, HEATER)
        out += 0.02 * self.by["k"] * config.screw.conductivity_W_mK
        out += 0.002 * self.by["c"] * config.screw.specific_heat_J_kgK
        out += 20.0 * self.by["x"] * np.array([s.position_m for s in config.sensor])
        names = [s.name for s in config.sensor]
        for term in (term for effect in config.effect for term in effect.terms(config)):
            match term:
                case SensorOffset():
                    out[:, names.index(term.sensor)] += term.offset_K
                case Lag():
                    out[:, names.index(term.sensor)] += 0.01 * term.time_constant_s * self.by["lag"][:, 0]
                case StretchFilm():
                    out += term.extra_W_m2K * term.from_m
        return [out]

    def by_outages(self, _config: Config) -> list[list[FloatArray]]:
        return [[gap] for gap in self.gaps]

    def by_coarse_rows(self, _config: Config) -> list[list[FloatArray]]:
        return []

    def airs(self, _config: Config) -> list[FloatArray]:
        return [np.full((MEANS, 3), 12.0)]


def a_problem(forward: Straight, truth: Config | None = None, noise_K: float = 0.05) -> Problem:
    """Free film and heater; the first twenty means are two folds, the others prove."""
    config = machine()
    mean, sensor = (i.ravel() for i in np.indices((MEANS, 3)))
    measured = forward(truth or config)[0].ravel()
    measured = measured + noise_K * np.random.default_rng(9).normal(size=len(mean))
    fold = np.where(mean >= 20, PROOF, mean // 10)
    none = np.zeros_like(mean)
    evidence = Evidence(
        none, mean, sensor, measured, np.full(len(mean), noise_K), 30.0 * (mean + 1.0), fold, ()
    )
    return Problem(config, (FILM, HEATER), forward, evidence)  # type: ignore[arg-type]


def test_derivatives_are_in_units_of_scale_and_noise_and_stay_within_bounds() -> None:
    forward = Straight()
    problem = a_problem(forward)
    expected = np.column_stack([
        0.05 * forward.by["film"].ravel() * 20.0, forward.by["heater"].ravel() * 1.0,
    ]) / 0.05  # fmt: skip
    assert problem.scale.tolist() == [20.0, 1.0]
    at_the_end = with_values(problem.config, {FILM: 1000.0, HEATER: 100.0})
    for config in (problem.config, at_the_end):
        found = problem.derivatives(config)
        np.testing.assert_allclose(found.columns, expected, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(found.at, problem.free_values(config) / [20.0, 1.0])
    here = problem.linearised_at(at_the_end).by_free
    assert here is not None
    np.testing.assert_allclose(here.at, [50.0, 100.0])
    assert problem.predicted(problem.config).tolist() == forward(problem.config)[0].ravel().tolist()
    np.testing.assert_allclose(
        problem.residual(problem.config),
        (problem.evidence.measured_degC - problem.predicted(problem.config)) / 0.05,
    )
    beyond = problem.with_free(problem.config, np.array([-3.0, 200.0]))
    assert problem.free_values(beyond).tolist() == [0.0, 100.0]
    assert replace(problem, keys=()).with_free(problem.config, np.zeros(0)) is problem.config


def test_slack_is_what_each_tolerance_changes() -> None:
    forward = Straight(gaps=2)
    problem = a_problem(forward).with_nuisance(machine())
    nuisance = problem.nuisance
    assert nuisance is not None
    by, sensor = forward.by, problem.evidence.sensor
    films, here = [np.full(3 * MEANS, 0.2 * 0.1 * i) for i in range(4)], forward(machine())[0].ravel()
    inward = np.array([1e-3, -1e-3, -1e-3])
    whole = {
        "k": [0.02 * by["k"].ravel()], "c": [0.002 * by["c"].ravel() * 9.2],
        "x": [np.where(sensor == s, 20.0 * (by["x"] * inward).ravel(), 0.0) for s in range(3)],
        "films": films,
        "lag": [np.where(sensor == s, 0.04 * np.repeat(by["lag"][:, 0], 3), 0.0) for s in range(3)],
        "gain": [np.where(sensor == s, 0.02 * (12.0 - here), 0.0) for s in range(3)],
        "gaps": [gap.ravel() for gap in forward.gaps],
    }  # fmt: skip
    columns = np.column_stack([c for part in whole.values() for c in part]) / 0.05
    np.testing.assert_allclose(nuisance.columns, columns, rtol=1e-9, atol=1e-9)
    assert nuisance.lag_of == (*[None] * 9, "a", "b", "c", *[None] * 5)
    rows, r = problem.evidence.used, np.random.default_rng(1).normal(size=60)
    for claimed, kept in ((frozenset(), range(17)), (frozenset({"b"}), [*range(10), *range(11, 17)])):
        T = columns[rows][:, list(kept)]
        left = float(np.sum(problem.marginal(rows, claimed)(r) ** 2))
        assert left == pytest.approx(r @ np.linalg.solve(np.eye(60) + T @ T.T, r), rel=1e-9)
        assert problem.marginal(rows, claimed) is problem.marginal(rows, claimed), "worked out once"
    assert not np.allclose(problem.marginal(~rows, frozenset())(np.ones(12)), 1.0)
    bare = a_problem(forward)
    np.testing.assert_array_equal(bare.marginal(rows, frozenset())(r), r)


def test_a_lag_belongs_to_what_claims_it() -> None:
    lag = {"kind": "sensor_lag", "target": "b", "time_constant_s": 9.0}
    bias = {"kind": "sensor_bias", "target": "a", "offset_K": 1.0}
    config = machine(effect=[lag, bias])
    assert modelled_lags(config) == {"b"}
    assert modelled_lags(machine()) == frozenset()
    assert modelled_lags(machine(), config.effect[0]) == {"b"}


# ---- hypotheses ----

BIAS = {"kind": "sensor_bias", "target": "b", "offset_K": 0.0}
OFFSET = EffectParameter(0, "offset_K", 0.5, -5.0, 5.0)


def weighed_least(problem: Problem, columns: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where the marginalised sum of squares is least, linear about `at`, and its covariance."""
    used = problem.evidence.used
    M = problem.marginal(used, frozenset())
    A, b = M(columns[used]), M(problem.residual(problem.config)[used])
    return at + np.linalg.lstsq(A, b)[0], np.linalg.inv(A.T @ A)


def test_a_fit_is_the_least_squares_of_what_is_used() -> None:
    forward = Straight(gaps=1)
    truth = with_values(machine(effect=[BIAS | {"offset_K": 1.2}]), {FILM: 23.0, HEATER: 0.9})
    problem = a_problem(forward, truth).with_nuisance(machine())
    null = fit_null(problem, problem.config)
    bias = np.where(problem.evidence.sensor == 1, 0.5, 0.0)[:, None] / 0.05
    columns = np.hstack([problem.derivatives(problem.config).columns, bias])
    config = null.config.model_copy(update={"effect": machine(effect=[BIAS]).effect})
    fit = fit_effects(null.problem, config, (OFFSET,))
    theta, covariance = weighed_least(null.problem, columns, np.array([1.0, 1.0, 0.0]))
    scale = np.array([20.0, 1.0, 0.5])
    found = [*problem.free_values(fit.config), *fit.values]
    np.testing.assert_allclose(found, theta * scale, rtol=1e-3)
    np.testing.assert_allclose(fit.scale, scale)
    np.testing.assert_allclose(fit.covariance, covariance * np.outer(scale, scale), rtol=1e-4)
    half = 1.96 * np.sqrt(np.diag(fit.covariance))
    np.testing.assert_allclose(fit.half_width_free, half[:2])
    np.testing.assert_allclose(fit.half_width, half[2:])
    np.testing.assert_allclose(np.abs(fit.jacobian), np.abs(columns), rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(fit.residual, problem.residual(fit.config), atol=1e-6)
    used = problem.evidence.used
    assert fit.deviance == pytest.approx(np.sum(fit.marginal(used)(fit.residual[used]) ** 2))
    assert fit.deviance < null.deviance - 100.0
    assert fit.config.effect[0].offset_K == fit.values[0]  # type: ignore[attr-defined]
    theta, _ = weighed_least(null.problem, columns[:, :2], np.array([1.0, 1.0]))
    np.testing.assert_allclose(problem.free_values(null.config), theta * scale[:2], rtol=1e-3)
    assert (null.values.shape, null.half_width.shape, null.half_width_free.shape) == ((0,), (0,), (2,))
    assert not null.at_bound
    assert not fit.at_bound


def test_a_fit_far_away_takes_its_derivatives_anew() -> None:
    forward = Straight()
    truth = with_values(machine(), {FILM: 60.0, HEATER: 3.0})
    problem = a_problem(forward, truth)
    fit = fit_null(problem, problem.config)
    np.testing.assert_allclose(problem.free_values(fit.config), [60.0, 3.0], rtol=0.05)
    values = np.array([problem.free_values(c) for c in forward.asked]) / [20.0, 1.0]
    assert np.abs(np.diff(values, axis=0)).max() < 2.1, "half a scale in one step, or back to the start"


def test_what_an_effect_takes_stays_within_its_bounds() -> None:
    config = machine(effect=[BIAS])
    for value, kept in ((-7.0, -5.0), (7.0, 5.0), (1.5, 1.5)):
        moved = with_effects(config, [OFFSET], np.array([value]))
        assert moved.effect[0].offset_K == kept  # type: ignore[attr-defined]
    problem = a_problem(Straight(), machine(effect=[BIAS | {"offset_K": 3.0}]))
    narrow = replace(OFFSET, high=1.0)
    fit = fit_effects(problem, config, (narrow,))
    assert fit.values.tolist() == [1.0]
    assert fit.at_bound
    bias = np.where(problem.evidence.sensor == 1, 0.5, 0.0) / 0.05
    np.testing.assert_allclose(np.abs(fit.jacobian[:, 2]), bias, rtol=1e-6, atol=1e-9)
    wide = replace(OFFSET, low=-1.0, high=5.0)
    free = fit_effects(problem, config, (wide,))
    assert free.values[0] == pytest.approx(3.0, abs=0.1)
    assert not free.at_bound


@pytest.mark.parametrize(("value", "bound"), [(0.9996, True), (0.999, False), (-0.9996, True), (0.0, False)])
def test_a_value_within_a_thousandth_of_its_scale_is_at_its_bound(value: float, bound: bool) -> None:
    problem, none = a_problem(Straight()), np.zeros(0)
    parameter = EffectParameter(0, "offset_K", 0.5, -1.0, 1.0)
    fit = Fit(problem, machine(), (parameter,), np.array([value]), none, none, none)
    assert fit.at_bound is bound


def test_an_effect_replaces_the_tolerance_of_the_same_thing_alone() -> None:
    film = {"kind": "uneven_convection", "from_m": 0.1, "to_m": 0.2, "extra_W_m2K": 3.0}
    bias = {"kind": "sensor_bias", "target": "a", "offset_K": 0.3}
    with_film, with_bias = machine(effect=[film]), machine(effect=[bias])
    assert replaces(StretchFilm(0.0, 0.1, 0.2), with_film)
    assert not replaces(StretchFilm(0.0, 0.1, 0.2), with_bias)
    drift = {"kind": "sensor_drift", "target": "a", "rate_K_h": 4.0}
    assert not replaces(SensorOffset("a", 0.1, 0.0), machine(effect=[drift])), "an offset does not explain it"
    assert replaces(SensorOffset("a", 0.1, 0.0), with_bias)
    assert not replaces(SensorOffset("b", 0.1, 0.0), with_bias)
    assert not replaces(None, with_film)


def test_a_fit_that_cannot_overtake_its_rival_is_given_up() -> None:
    problem = a_problem(Straight(), with_values(machine(), {FILM: 200.0}))
    patient = fit_effects(problem, problem.config, ())
    hopeless = fit_effects(problem, problem.config, (), rival=-1e9)
    assert problem.free_values(hopeless.config)[0] <= 30.0 + 1e-9, "one step of half a scale"
    assert patient.deviance < hopeless.deviance
