"""Gains that hold for a nut spread over its stroke, and not for one that stands."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from observer.estimate.pipeline import MachineModel
from observer.estimators.design.gains import LuenbergerGain, Refusal, design_bandwidth, everything
from observer.estimators.design.steady import bandwidth, design, gain_for, standing_growth_1_s
from observer.estimators.fixed_gain import LuenbergerEstimator
from observer.installation import load
from observer.model.discretise import augmented, step_matrices
from observer.model.rod.moving import columns_at
from tests.learning.machines import config_of

LUENBERGER = '[estimator]\nkind = "luenberger"\n'
CONSTANT = '[estimator]\nkind = "kalman"\nengine = "constant"\n'
HOUSINGS = Path(__file__).parents[2] / "config" / "demo-housings.toml"


@cache
def designed():
    config = config_of(more=LUENBERGER)
    plant = replace(MachineModel.of(config).plant, learning=None)
    return plant, step_matrices(plant, config.estimator.period_s), bandwidth(plant, config.estimator)


def without(*lost):
    present = everything(designed()[0])
    present[list(lost)] = False
    return present


def grown(K, place_m, steps):
    """How much larger an error of the heats is after so many steps with the nut at a place."""
    plant, step, _ = designed()
    (nut,), s, n_x = plant.moving, plant.rows.sensors, len(plant.decay_1_s)
    B, C = plant.B.copy(), plant.rows.C.copy()
    B[:, nut.index], C[:, plant.modes + nut.index] = columns_at(nut.table, [place_m])
    F = augmented(replace(plant, B=B), step)[0]
    e = np.zeros(len(F))
    e[n_x:] = 1.0
    for _ in range(steps):
        e = F @ e
        e -= K[:, :s] @ (C[:s] @ e[:n_x])
    return np.abs(e[n_x:]).max()


def settings():
    return config_of(more=LUENBERGER).estimator


def test_a_gain_under_which_errors_run_away_while_the_nut_stands_gives_way_to_a_more_cautious_one():
    plant, step, omega = designed()
    present = without(2)
    on_its_poles = design_bandwidth(plant, step, present, omega)
    assert isinstance(on_its_poles, LuenbergerGain)
    assert grown(on_its_poles.K, 0.5, 1200) > 100.0
    found = gain_for(plant, step, present, settings(), omega)
    assert isinstance(found, LuenbergerGain)
    assert max(grown(found.K, place_m, 12000) for place_m in (0.2, 0.5, 0.75)) < 2.0


def test_the_gain_of_all_sensors_holds_wherever_the_nut_stands():
    plant, step, omega = designed()
    gain = gain_for(plant, step, everything(plant), settings(), omega)
    assert standing_growth_1_s(plant, step, gain.K) < 0.0
    assert max(grown(gain.K, place_m, 12000) for place_m in (0.2, 0.5, 0.75)) < 0.01


@pytest.mark.parametrize("more", [LUENBERGER, CONSTANT])
@pytest.mark.parametrize("lost", [(), (1,), (2,), (3,), (0, 3), (1, 2)])
def test_under_no_gain_of_any_set_of_sensors_errors_run_away(lost, more):
    """In a quarter of an hour they grow less than e-fold; a gain that would let them is refused."""
    plant, step, omega = designed()
    asked = config_of(more=more).estimator
    found = gain_for(plant, step, without(*lost), asked, omega if asked.kind == "luenberger" else None)
    if isinstance(found, Refusal):
        assert lost
        return
    K = found.K if isinstance(found, LuenbergerGain) else found
    assert standing_growth_1_s(plant, step, K) < 1.0 / 900.0


def test_the_observer_of_a_machine_with_housings_stays_where_it_is_while_the_nut_stands():
    """All its sensors there, and its gain as found by itself: errors grew e-fold in a minute."""
    config = load(HOUSINGS)
    plant = replace(MachineModel.of(config).plant, learning=None)
    asked = config.estimator.model_copy(update={"kind": "luenberger"})
    step = step_matrices(plant, asked.period_s)
    by_rule = design(plant, step, everything(plant), "bandwidth", bandwidth(plant, asked))
    assert standing_growth_1_s(plant, step, by_rule.K) > 0.01
    estimator = LuenbergerEstimator(plant, asked)
    assert standing_growth_1_s(plant, step, estimator.gain(step, everything(plant))) < 1e-3
