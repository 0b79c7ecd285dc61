"""Heat histories of logs whose heats are known: Li's experiment and Lathe's study, by the finite volumes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from observer.config.estimator import EstimatorSettings
from observer.config.machine import Config
from observer.frames import FloatArray
from observer.history.history import HeatHistory, MethodOptions
from observer.history.identify import heat_history
from observer.installation import load
from observer.model.build import build_plant
from tests.reference.heat_cases import (
    FAR_M,
    MORE_M,
    NEAR_M,
    HeatCase,
    lathe_case,
    li_experiment,
    standing_case,
)
from tests.reference.service_path import inputs_of

LI = Path(__file__).parents[2] / "config" / "li-lathe-axis.toml"


def rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def found(case: HeatCase, seed: int = 1, **options: object) -> HeatHistory:
    inputs = [case.inputs(seed)]
    return heat_history(case.plant, EstimatorSettings(), inputs, MethodOptions(**options))


@pytest.mark.parametrize("traverse_m_min", [5.0, 10.0, 15.0])
def test_lis_experiment_is_identified_peak_and_decay_included(traverse_m_min: float) -> None:
    """The shipped configuration as it is, its laws up to 80 % too low at the start."""
    config: Config = load(LI)
    truth = li_experiment(config, traverse_m_min / 60.0, seed=3)
    plant = build_plant(config)
    history = heat_history(plant, config.estimator, inputs_of(config, plant, truth.log), MethodOptions())
    peak = truth.heat_W.max(axis=0)
    error = (history.heat_W - truth.heat_W) / peak
    start, decay, rest = slice(1, 60), slice(60, 7200), slice(7200, None)
    # half a minute after the start the smallest heat, 2 W, has warmed the sensors by hundredths of a kelvin
    assert (np.abs(error[start].mean(axis=0)) < (0.05, 0.08, 0.08)).all()
    assert (rms(error[decay]) < 0.05).all()
    assert (rms(error[rest]) < 0.05).all()
    assert (np.abs(history.heat_W[:7200].max(axis=0) / peak - 1.0) < 0.05).all(), "the peak at the start"
    late = truth.heat_W[7000:7200].mean(axis=0)
    assert (np.abs(history.heat_W[7000:7200].mean(axis=0) / late - 1.0) < 0.05).all()
    assert (np.abs(error) * peak < 4.0 * history.heat_sigma_W)[60:].mean() > 0.99, "σ holds"


@pytest.mark.slow
def test_every_method_follows_a_moving_nut_through_a_long_log() -> None:
    """30,000 rows at 2 Hz, the nut moving in 18,000 of them: its heat on average, and how far it strays."""
    config: Config = load(LI)
    truth = li_experiment(config, 5.0 / 60.0, seed=104, run_s=9000.0, end_s=15000.0)
    plant = build_plant(config)
    blocks = inputs_of(config, plant, truth.log)
    running = slice(120, 18_000)
    bias, stray = {}, {}
    for method in ("smoother", "tikhonov", "conjugate-gradient"):
        history = heat_history(plant, config.estimator, blocks, MethodOptions(method))
        error_W = (history.heat_W - truth.heat_W)[running, 0]
        bias[method] = abs(error_W.mean()) / truth.heat_W[running, 0].mean()
        stray[method] = float(rms(error_W))
        assert not history.warnings
    assert bias["smoother"] < 0.01
    assert max(bias.values()) < 0.03
    assert max(stray.values()) < 2.0 * stray["smoother"]


def recovered(case: HeatCase, history: HeatHistory) -> FloatArray:
    """The share of each heat that was found, over the second half of each of both levels."""
    K = len(case.time_s)
    late = np.r_[K // 4 : K // 2 - 2, 3 * K // 4 : K - 2]
    return np.asarray((history.heat_W[late] / case.heat_W[late]).mean(axis=0))


@pytest.mark.parametrize(
    "options", [{"order": 0}, {"gradient": "central-differences"}], ids=["adjoint", "as printed"]
)
def test_two_near_sensors_suffice_and_more_add_little(options: dict[str, object]) -> None:
    near, more = lathe_case(NEAR_M), lathe_case(MORE_M)
    by_two = found(near, method="conjugate-gradient", **options)
    by_four = found(more, method="conjugate-gradient", **options)
    for case, history in ((near, by_two), (more, by_four)):
        np.testing.assert_allclose(recovered(case, history), 1.0, atol=0.02)
    assert (rms(by_four.heat_W - more.heat_W) > 0.5 * rms(by_two.heat_W - near.heat_W)).all()


def test_far_sensors_keep_one_heat_and_lose_the_other() -> None:
    """The paper's pair beyond the rear bearing finds 95.6 % of the rear heat and 38.3 % of the front."""
    far = lathe_case(FAR_M)
    front, rear = recovered(far, found(far, method="conjugate-gradient", order=0))
    assert 0.9 < rear < 1.1
    assert front < 0.4


def test_the_smoother_says_which_heat_far_sensors_cannot_determine() -> None:
    near, far = lathe_case(NEAR_M), lathe_case(FAR_M)
    by_near, by_far = found(near), found(far)
    assert (by_near.heat_sigma_W[5:-5].mean(axis=0) < 10.0).all()
    front_W, rear_W = by_far.heat_sigma_W[5:-5].mean(axis=0)
    assert front_W > 100.0, "as much as it did not know before"
    assert rear_W < 40.0
    assert (np.abs(by_far.heat_W - far.heat_W) < 3.0 * by_far.heat_sigma_W).all()


def test_stepping_with_far_sensors_as_printed_is_without_bound_and_that_is_said() -> None:
    far = lathe_case(FAR_M)
    history = found(far, method="conjugate-gradient", gradient="central-differences")
    assert np.abs(history.heat_W).max() > 1e6
    assert any("too short for heat to reach the sensors" in sentence for sentence in history.warnings)


def test_the_methods_on_the_same_noisy_log() -> None:
    """The prior that the smoother has is worth more than any choice of α without it; ICO is worst."""
    case = standing_case(300, 20.0)
    smoother = rms((found(case).heat_W - case.heat_W)[2:-2])
    walk, gcv, ico = (
        rms((found(case, method="tikhonov", **options).heat_W - case.heat_W)[2:-2])
        for options in ({}, {"order": 0}, {"order": 0, "parameter_choice": "ico"})
    )
    descent = rms((found(case, method="conjugate-gradient").heat_W - case.heat_W)[2:-2])
    assert (walk < 1.5 * smoother).all()
    assert (descent < 2.5 * smoother).all()
    assert (gcv > smoother).all()
    assert (ico > gcv).all()
    assert ico[0] > 3.0 * gcv[0]
