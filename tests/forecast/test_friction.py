"""Rival filters of what friction does: by hand, and 28 minutes of a warm-up of one rough machine."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.forecast import warming
from observer.estimators.steps import StepCache
from observer.forecast.friction import (
    mixture,
    quantiles_s,
    running_in,
    since_start,
    weights_of,
    with_known_scales,
)
from observer.forecast.settling import Settled
from observer.frames import EstimateBlock, Inputs
from observer.model.build import build_plant
from observer.model.learning import Nuisance
from tests.learning.machines import CONFIG as MACHINE
from tests.learning.machines import Rough, config_of, draw


def inputs_of(law_W: list[float]) -> Inputs:
    """Inputs of one heat, a row each ten seconds, that jump as their law does."""
    law = np.array(law_W)[:, None]
    zero = np.zeros(len(law))
    jump = np.diff(law, axis=0, prepend=law[:1])
    n, none = len(law), np.zeros((len(law), 0))
    return Inputs(
        time_s=10.0 * np.arange(n), dt_s=np.full(n, 10.0), y_degC=none, usable=none.astype(bool),
        quality=none.astype(np.int8), law_W=law, law_jump_W=jump, z_start=none, z_end=none,
        moving_B=np.zeros((n, 0, 1)), moving_C=np.zeros((n, 0, 1)), degraded=np.zeros(n, np.int8),
        loss_1_s=zero, loss_degC=zero,
    )  # fmt: skip


def test_the_rivals_run_since_the_last_start_with_the_rest_before_it() -> None:
    # work, a rest of two minutes, work; a nut that turns round stands for a row
    found = since_start(inputs_of([20.0] * 30 + [0.0] * 12 + [40.0] * 20 + [0.0] + [40.0] * 20), 410.0)
    assert len(found) == 12 + 41
    jumps = np.flatnonzero(found.law_jump_W[:, 0])
    assert jumps.tolist() == [12]
    assert found.law_jump_W[12, 0] == pytest.approx(40.0 * 40 / 41)


def test_friction_begins_anew_where_work_changes_its_level() -> None:
    found = since_start(inputs_of([20.0] * 30 + [40.0] * 30), 295.0)
    assert np.flatnonzero(found.law_jump_W[:, 0]).tolist() == [0, 30]


def test_heats_that_run_in_do_not_wander_and_die_away_to_their_law() -> None:
    config = config_of(MACHINE, '\n[estimator]\nlearn = ["convection", "law"]\n')
    plant = running_in(build_plant(config, learns=True), 1200.0, 1e6)
    np.testing.assert_allclose(plant.heat_decay_1_s, 1.0 / 1200.0)
    np.testing.assert_array_equal(plant.random_walk_W2_s, 0.0)


def test_the_scale_of_a_law_hardly_wanders_where_friction_runs_in() -> None:
    # what it wanders in the 28 minutes of a warm-up would else be taken for what has run in
    config = config_of(MACHINE, '\n[estimator]\nlearn = ["convection", "law"]\n')
    plant = build_plant(config, learns=True)
    assert plant.learning is not None
    law = len(plant.decay_1_s) + 3 + np.flatnonzero(plant.learning.arrays.kind == Nuisance.LAW)
    wanders = [
        np.sqrt(np.asarray(StepCache(own).table([1680.0]).noise)[0, law, law])
        for own in (plant, running_in(plant, 1200.0, 86400.0 / 0.09))
    ]
    np.testing.assert_allclose(wanders, [[0.039] * 3, [0.0118] * 3], rtol=0.01)


def test_a_scale_that_a_calibration_found_is_no_more_open_than_it_left_it() -> None:
    text = MACHINE.replace('name = "nut"', 'name = "nut"\nscale_tolerance = 0.04')
    found = {s.name: s.law_uncertainty for s in with_known_scales(config_of(text)).source}
    assert found == {"nut": 0.04, "left_bearing": None, "right_bearing": None}


def test_the_heats_as_configured_count_as_much_before_as_all_others() -> None:
    np.testing.assert_allclose(weights_of([5.0, 5.0, 5.0]), [0.5, 0.25, 0.25])
    np.testing.assert_allclose(weights_of([0.0, np.log(2.0), -50.0]), [0.5, 0.5, 0.0])


def test_a_mixture_has_the_moments_of_its_parts() -> None:
    def block(mean: float, sigma: float) -> EstimateBlock:
        row = {name: np.full((1, 2), mean) for name in ("field_degC", "error_um")}
        row |= {name: np.full((1, 2), sigma) for name in ("field_sigma_K", "error_sigma_um")}
        empty = {name: np.zeros((1, 0)) for name in EstimateBlock.__dataclass_fields__}
        return EstimateBlock(**(empty | row))

    found = mixture([block(10.0, 1.0), block(14.0, 3.0)], np.array([0.75, 0.25]))
    np.testing.assert_allclose(found.field_degC, 11.0)
    np.testing.assert_allclose(found.error_sigma_um**2, 0.75 * (1.0 + 1.0) + 0.25 * (9.0 + 9.0))


def test_when_it_settles_goes_by_the_draws_and_their_weight() -> None:
    drawn = [Settled(np.zeros(1), np.zeros(1), after_s) for after_s in (100.0, 300.0, 200.0)]
    assert quantiles_s(drawn, np.full(3, 1 / 3), (0.5,)) == [200.0]
    assert quantiles_s(drawn, np.array([0.01, 0.98, 0.01]), (0.5,)) == pytest.approx([300.0], abs=5.0)


def test_half_an_hour_of_a_warm_up_says_where_and_when_a_rough_machine_settles() -> None:
    seed, number = 9001, 3
    one = draw(seed, number, Rough())
    whole, live, now_s = warming.forecasts(warming.GROUPS["rough"], one, seed, number)
    truth = warming.settled(one, seed, number, now_s)
    by_log, by_live = (warming.predicted(found, *truth[:2]) for found in (whole, live))
    # three σ of a few correlated places; and less is left open than by the state of the moment alone
    assert by_log.off_um < 3.0 * by_log.sigma_um
    assert by_log.sigma_um < 0.6 * by_live.sigma_um
    assert by_log.to_s - by_log.from_s < 0.7 * (by_live.to_s - by_live.from_s)
    assert by_log.from_s - 600.0 < truth[2] < by_log.to_s + 600.0
