"""What the logs say: folds, the proof that nothing is fitted to, and noise that whitening makes even."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from observer.fit.evidence import (
    BEAT_K,
    BEAT_S,
    BEAT_SHARE,
    FITTED_SHARE,
    MARGIN_SHARE,
    PROOF,
    SLOW_K,
    SLOW_S,
    SLOW_SHARE,
    UNUSED,
    Evidence,
    even,
    gather,
)
from observer.fit.forward import Forward
from observer.fit.hypothesis import fit_null
from observer.fit.runs import prepare
from observer.frames import FloatArray, FrameBlock
from tests.discovery.small import problem_of
from tests.logs.machines import machine
from tests.logs.simulated import made_log

CONFIG = machine()
TRUTH = machine(surface={"convection_W_m2K": 14.0})
DRAWS = 400


def logs(count: int, minutes: float = 60.0) -> list[FrameBlock]:
    return [made_log(TRUTH, seed, minutes=minutes) for seed in range(count)]


def warmer(log: FrameBlock, from_s: float) -> FrameBlock:
    """The log with sensors that show something else from some time on: warmer, and livelier."""
    values = log.values.copy()
    late = log.time_s >= from_s
    for i, channel in enumerate(log.channels):
        if channel.endswith("_degC"):
            values[late, i] += 3.0 + np.sin(log.time_s[late])
    return replace(log, values=values)


def coloured(evidence: Evidence, rng: np.random.Generator) -> FloatArray:
    """Noise (n, DRAWS) as the evidence expects it, made by recursion along each group."""
    out = np.empty((len(evidence.run), DRAWS))
    for index, _ in evidence.groups:
        out[index] = evidence.noise_K[index, None] * rng.normal(size=(len(index), DRAWS))
        whole = (evidence.run == evidence.run[index[0]]) & (evidence.sensor == evidence.sensor[index[0]])
        mine = whole & evidence.used if (whole & evidence.used).any() else whole
        rise = evidence.measured_degC[mine]
        rise_K = float(np.sqrt(np.mean((rise - rise[0]) ** 2)))
        for sigma_K, tau_s in (
            (SLOW_K + SLOW_SHARE * rise_K, SLOW_S),
            (BEAT_K + BEAT_SHARE * rise_K, BEAT_S),
        ):
            state = sigma_K * rng.normal(size=DRAWS)
            for k, row in enumerate(index):
                if k:
                    kept = np.exp(-(evidence.time_s[row] - evidence.time_s[index[k - 1]]) / tau_s)
                    state = kept * state + sigma_K * np.sqrt(1 - kept**2) * rng.normal(size=DRAWS)
                out[row] += state
    return out


def test_whitened_noise_is_even_and_neighbours_are_independent() -> None:
    evidence = problem_of(CONFIG, logs(3)).evidence
    white = evidence.whitened(coloured(evidence, np.random.default_rng(0)))
    n = white.size
    assert np.var(white) == pytest.approx(1.0, abs=5 * np.sqrt(2 / n))  # 5 of its σ
    for lag in (1, 2, 30):
        pairs = [white[i[lag:]] * white[i[:-lag]] for i, _ in evidence.groups]
        mean = float(np.mean(np.concatenate(pairs)))
        assert abs(mean) < 5 / np.sqrt(n), lag


def test_white_noise_alone_makes_what_is_expected_of_it() -> None:
    evidence = problem_of(CONFIG, logs(2)).evidence
    noise = evidence.noise_K[:, None] * np.random.default_rng(1).normal(size=(len(evidence.run), DRAWS))
    squares = np.mean(evidence.whitened(noise) ** 2, axis=0)
    spread = 5 * float(np.std(squares)) / np.sqrt(DRAWS)
    assert float(np.mean(squares)) == pytest.approx(evidence.expected, abs=spread)
    assert evidence.expected < 1.0


def test_the_noise_is_the_one_the_logs_show() -> None:
    quiet = problem_of(CONFIG, logs(2)).evidence
    sensors = [s.model_copy(update={"noise_K": 2 * s.noise_K}) for s in CONFIG.sensor]
    doubled = problem_of(CONFIG.model_copy(update={"sensor": tuple(sensors)}), logs(2)).evidence
    # 0.05 K are in the logs, whatever is configured; 1800 rows of each show it to 2 %
    np.testing.assert_allclose(doubled.noise_K, quiet.noise_K, rtol=0.02)


def test_a_mean_of_fewer_values_weighs_less_and_one_of_less_than_half_not_at_all() -> None:
    """Of fifteen rows in half a minute, sensor a has eight in one mean and seven in another."""
    log = logs(1)[0]
    column = log.channels.index("a_degC")
    for first, lost in ((301, 7), (601, 8)):
        log.values[first : first + lost, column] = np.nan
        log.fresh[first : first + lost, column] = False
    forward = Forward(CONFIG, [prepare(CONFIG, [log], "log")])
    noise_K = np.array([s.noise_K for s in CONFIG.sensor])
    evidence = even(forward.runs, noise_K)
    mine = evidence.sensor == 0
    most, least = evidence.mean[mine & (evidence.time_s == 630.0)], mine & (evidence.time_s == 1230.0)
    assert len(most) == 1
    assert not least.any()
    sparse_K = evidence.noise_K[mine & (evidence.mean == most[0])]
    np.testing.assert_allclose(sparse_K, noise_K[0] / np.sqrt(8), rtol=1e-12)
    np.testing.assert_allclose(np.median(evidence.noise_K[mine]), noise_K[0] / np.sqrt(15), rtol=1e-12)
    coloured_ = gather(forward.runs, noise_K)
    assert coloured_.noise_K[mine & (evidence.mean == most[0])] > 1.3 * np.median(coloured_.noise_K[mine])


def test_three_logs_are_two_folds_and_a_proof() -> None:
    evidence = problem_of(CONFIG, logs(3)).evidence
    for run, fold in enumerate((0, 1, PROOF)):
        assert set(evidence.fold[evidence.run == run]) == {fold}
    assert evidence.folds == 2


def test_two_logs_are_halves_and_a_proof() -> None:
    evidence = problem_of(CONFIG, logs(2)).evidence
    assert set(evidence.fold[evidence.run == 1]) == {PROOF}
    first = evidence.run == 0
    assert set(evidence.fold[first]) == {0, 1}
    assert evidence.time_s[first & (evidence.fold == 0)].max() < evidence.time_s[evidence.fold == 1].min()


def test_one_log_is_halves_a_gap_and_a_proof() -> None:
    evidence = problem_of(CONFIG, logs(1)).evidence
    ends = {fold: evidence.time_s[evidence.fold == fold] for fold in (0, 1, UNUSED, PROOF)}
    order = [ends[fold] for fold in (0, 1, UNUSED, PROOF)]
    assert all(a.max() < b.min() for a, b in pairwise(order))
    apart_s = ends[PROOF].min() - ends[1].max()
    assert apart_s >= MARGIN_SHARE * evidence.time_s.max()
    assert not (evidence.used & evidence.proof).any()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_no_fit_sees_the_proof(count: int) -> None:
    """Other values there leave the fit as it is, to the last bit."""
    honest = logs(count)
    begin_s = 3600.0 * (FITTED_SHARE + MARGIN_SHARE) if count == 1 else 0.0
    fits = []
    for runs in (honest, [*honest[:-1], warmer(honest[-1], begin_s)]):
        problem = problem_of(CONFIG, runs)
        fit = fit_null(problem, CONFIG)
        fits.append((problem.free_values(fit.config), fit.deviance, problem.evidence))
    (a, deviance, before), (b, other, after) = fits
    changed = before.measured_degC != after.measured_degC
    assert changed[before.proof].mean() > 0.99
    assert not changed[before.used].any()
    assert a.tolist() == b.tolist()
    assert deviance == other
