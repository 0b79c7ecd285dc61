"""Forecasts by hand: what rest, even work and a cycle must come to; and one rough machine."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from campaigns.forecast.days import AT_S, drawn_day, forecasts
from campaigns.forecast.trial import judged
from observer.estimators.protocol import EstimatorState
from observer.forecast.ahead import AIR_K_sqrt_h, ahead, drift_scale, runner
from observer.forecast.document import document, forecast
from observer.forecast.program import BIN_S, Bins, averaged, learnt, noise_W2_s, period_bins
from observer.forecast.settling import settling, settling_of_all
from observer.frames import EstimateQuality, FloatArray
from observer.model.build import build_plant
from observer.model.plant import Plant
from tests.logs.machines import SCREW, machine

KNOWN = (
    "conductivity",
    "heat_capacity",
    "convection",
    "ambient_K",
    "end_W_K",
    "position_m",
    "offset_K",
    "lag_s",
)
CONFIG = machine(
    screw=SCREW | {"expansion_1_K": 11.8e-6},
    surface={"convection_W_m2K": 15.0},
    boundary={end: {"kind": "insulated"} for end in ("left", "right")},
    source=[{"name": "whole", "shape": "band", "from_m": 0.0, "to_m": 1.0, "power_channel": "heater_W"}],
    sensor=[{"name": "t1", "channel": "t1_degC", "position_m": 0.5, "noise_K": 0.05}],
    tolerance=dict.fromkeys(KNOWN, 0.0),
    estimator={"learn": []},
)
"""A rod of one temperature, of which everything is known."""
TAU_S = 7800.0 * 460.0 * 0.036 / 4.0 / 15.0
"""ρ c d / 4 h: how fast a rod of one temperature cools."""
LOSS_W_K = 15.0 * math.pi * 0.036
EVERYWHERE = np.ones(21, np.bool_)


def rod() -> Plant:
    return build_plant(CONFIG)


def bins_of(heat_W: FloatArray) -> Bins:
    """Bins in which the heat was as its law says, known to 1 W."""
    n, plant = len(heat_W), rod()
    nothing = np.zeros(n)
    z = np.full((n, len(plant.known_names)), 20.0)
    none = np.zeros((n, 0, len(plant.decay_1_s))), np.zeros((n, 0, len(plant.rows.C)))
    heat = heat_W[:, None]
    return Bins(np.full(n, BIN_S), heat, z, nothing, nothing, *none, heat, np.ones((n, 1)), heat)


def at_degC(plant: Plant, temperature_degC: float) -> EstimatorState:
    n = len(plant.decay_1_s) + 1
    x, never = np.zeros(n), np.zeros(1)
    x[:-1] = plant.uniform * temperature_degC
    return EstimatorState(x, 1e-6 * np.eye(n), True, never, never, never, 1000.0)


def test_at_standstill_it_decays_to_the_air_with_the_time_constant() -> None:
    plant, program = rod(), learnt(bins_of(np.zeros(60)))
    assert program.kind == "standstill"
    found = ahead(runner(plant, CONFIG.estimator, at_degC(plant, 60.0), program), program, 3600.0)
    expected = 20.0 + 40.0 * np.exp(-found.time_s / TAU_S)
    # the rod has one temperature, and splitting and lags of the plant take no part in it
    np.testing.assert_allclose(found.field_degC, np.tile(expected[:, None], 21), atol=0.02)


def test_an_even_program_settles_where_the_loss_takes_its_heat() -> None:
    plant, program = rod(), learnt(bins_of(np.full(60, 40.0)))
    begin = runner(plant, CONFIG.estimator, at_degC(plant, 20.0), program)
    settled = settling(begin, program, EVERYWHERE, 2.0)
    rise_K = 40.0 / LOSS_W_K
    # it stops where a part of ten minutes changes by 1 mK: e^(-t/τ) leaves τ/600 of that
    np.testing.assert_allclose(settled.field_degC, 20.0 + rise_K, atol=0.02)
    assert settled.after_s is not None
    last_um = 11.8 * rise_K  # of a free screw of a metre, at its far end
    assert settled.after_s == pytest.approx(TAU_S * math.log(last_um / 2.0), abs=60.0)


def test_a_cycle_goes_on_where_it_stands() -> None:
    work = np.tile(np.repeat([60.0, 0.0], [20, 10]), 6)[:-5]  # it ends in the middle of a rest
    program = learnt(bins_of(work))
    assert program.period_s == 300.0
    np.testing.assert_allclose(program.bins.total_W, np.repeat([0.0, 60.0, 0.0], [5, 20, 5]))


def test_what_has_no_period_is_mixed_with_the_spread_of_its_means() -> None:
    rng = np.random.default_rng(5)
    work = rng.choice([0.0, 20.0, 60.0], 300)
    program = learnt(bins_of(work))
    assert (program.kind, program.period_s) == ("mixed", None)
    # white from bin to bin, a density of its variance times the bin, held to 250 s as firmly as 4 of 10.7
    assert BIN_S < program.noise_W2_s / work.var() < 120.0
    assert period_bins(work) is None


def test_work_that_stays_alike_for_longer_spreads_its_hours_more() -> None:
    rng = np.random.default_rng(7)
    fast, slow = (np.repeat(rng.choice([10.0, 40.0, 60.0], 540 // n), n) for n in (6, 60))
    densities = [noise_W2_s(bins_of(work)) / work.var() for work in (fast, slow)]
    # steps of T have the density of variance times T; 540 bins show it to a half, and 250 s hold it
    assert 60.0 < densities[0] < 200.0
    assert densities[1] > 300.0


def test_heats_that_drifted_are_forecast_with_more_drift() -> None:
    steady = learnt(bins_of(np.full(540, 40.0))).past
    rising = steady._replace(heat_W=steady.heat_W * np.linspace(1.0, 1.5, 540)[:, None])
    # taken to drift by a twentieth in an hour; nothing is seen of it, or a fifth and more
    assert drift_scale(steady, 0.05) < 0.5
    assert drift_scale(rising, 0.05) > 1.5


def test_the_time_of_settling_has_a_band_as_wide_as_what_is_not_known() -> None:
    plant, program = rod(), learnt(bins_of(np.full(60, 40.0)))
    begin = runner(plant, CONFIG.estimator, at_degC(plant, 20.0), program)
    settled = settling_of_all([(1.0, begin)], program, EVERYWHERE, 2.0)
    surer = replace(begin, state=replace(begin.state, P=1e-4 * begin.state.P))
    between_s, narrow_s = (
        settled.between_s,
        settling_of_all([(1.0, surer)], program, EVERYWHERE, 2.0).between_s,
    )
    assert settled.after_s is not None
    assert between_s is not None
    assert narrow_s is not None
    assert between_s[0] <= narrow_s[0] <= settled.after_s <= narrow_s[1] <= between_s[1]
    assert between_s[1] > between_s[0] + 60.0


def test_runners_in_doubt_settle_at_their_mean_with_the_spread_of_their_mixture() -> None:
    plant, program = rod(), learnt(bins_of(np.full(60, 40.0)))
    begin = runner(plant, CONFIG.estimator, at_degC(plant, 20.0), program)
    warmer = replace(begin, heats=begin.heats._replace(extra_W=np.array([4.0])))
    both = settling_of_all([(0.75, begin), (0.25, warmer)], program, EVERYWHERE, 2.0)
    apart_K = 4.0 / LOSS_W_K
    np.testing.assert_allclose(both.field_degC, 20.0 + 40.0 / LOSS_W_K + 0.25 * apart_K, atol=0.03)
    assert both.field_sigma_K is not None
    # each is sure to a few hundredths of a kelvin, so σ is that of two values with their weights
    np.testing.assert_allclose(both.field_sigma_K, np.sqrt(0.75 * 0.25) * apart_K, rtol=0.02)


def test_too_little_is_no_program() -> None:
    with pytest.raises(ValueError, match="wait for a minute"):
        learnt(bins_of(np.ones(5)))


def test_sigma_is_what_is_not_known_of_the_heat_and_what_varies() -> None:
    plant = rod()
    even, mixed = (
        learnt(bins_of(w))
        for w in (np.full(300, 27.0), np.random.default_rng(5).choice([0.0, 20.0, 60.0], 300))
    )
    state = at_degC(plant, 40.0)
    a, b = (ahead(runner(plant, CONFIG.estimator, state, p), p, 3600.0) for p in (even, mixed))
    assert (b.field_sigma_K[-1] > 1.1 * a.field_sigma_K[-1]).all()
    assert (np.diff(a.field_sigma_K[::30], axis=0) > 0.0).all()
    assert AIR_K_sqrt_h > 0.0


def test_a_forecast_of_a_doubtful_estimate_is_doubtful() -> None:
    plant, program = rod(), learnt(bins_of(np.full(60, 40.0)))
    begin = runner(plant, CONFIG.estimator, at_degC(plant, 20.0), program)
    found = forecast(CONFIG, [(1.0, begin)], program, 1.0, 2.0)
    doubtful = document(found, plant, EstimateQuality.DEGRADED, "a", 2.0)
    assert doubtful["quality"] == "degraded"
    assert "degraded" in doubtful["reason"]
    good = document(found, plant, EstimateQuality.GOOD, "a", 2.0)
    assert good["reason"] is None
    assert len(good["at_s"]) == 61
    assert len(good["position_m"]) == 21
    assert np.shape(good["temperature_degC"]) == np.shape(good["error_sigma_um"]) == (61, 21)
    assert good["at_s"][-1] == 1000.0 + 3600.0


def test_no_forecast_without_an_estimate() -> None:
    plant, program = rod(), learnt(bins_of(np.full(60, 40.0)))
    with pytest.raises(ValueError, match="needs an estimate"):
        runner(plant, CONFIG.estimator, replace(at_degC(plant, 20.0), started=False), program)


def test_a_mean_of_bins_weighs_them_by_their_length() -> None:
    bins = bins_of(np.array([10.0, 40.0]))._replace(dt_s=np.array([10.0, 5.0]))
    assert averaged(bins).total_W[0] == pytest.approx(20.0)


def test_intervals_of_a_rough_machine_hold_the_truth() -> None:
    one = drawn_day(9001, 1)  # a cycle; four of five, where nineteen of twenty are asked of the mean
    for found in forecasts(one).values():
        for at_s in AT_S:
            of_field, of_error, off_K, stays_K, *_ = judged(one, found, at_s)
            assert of_field >= 0.8
            assert of_error >= 0.8
    assert off_K < stays_K
