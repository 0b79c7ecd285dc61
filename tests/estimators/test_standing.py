"""Gains that hold for a nut spread over its stroke, and not for one that stands."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from observer.estimate.pipeline import MachineModel
from observer.estimators.design.gains import LuenbergerGain, Refusal, design_bandwidth, everything
from observer.estimators.design.steady import bandwidth, design, standing_growth_1_s
from observer.model.discretise import augmented, step_matrices
from observer.model.rod.moving import columns_at
from tests.learning.machines import config_of

LUENBERGER = '[estimator]\nkind = "luenberger"\n'


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


def test_a_gain_that_runs_away_while_the_nut_stands_is_refused():
    plant, step, omega = designed()
    present = without(2)
    on_its_poles = design_bandwidth(plant, step, present, omega)
    assert isinstance(on_its_poles, LuenbergerGain)
    assert grown(on_its_poles.K, 0.5, 1200) > 100.0
    refused = design(plant, step, present, "bandwidth", omega)
    assert isinstance(refused, Refusal)
    assert "while the nut stands" in refused.reason


def test_the_gain_of_all_sensors_holds_wherever_the_nut_stands():
    plant, step, omega = designed()
    gain = design(plant, step, everything(plant), "bandwidth", omega)
    assert standing_growth_1_s(plant, step, gain.K) < 0.0
    assert max(grown(gain.K, place_m, 12000) for place_m in (0.2, 0.5, 0.75)) < 0.01


@pytest.mark.parametrize("lost", [(1,), (3,), (0, 3), (1, 2)])
def test_every_set_that_runs_away_is_refused(lost):
    plant, step, omega = designed()
    assert isinstance(design(plant, step, without(*lost), "bandwidth", omega), Refusal)
