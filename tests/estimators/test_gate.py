"""The gate, its release, and what a sensor's and an estimate's quality say."""

import numpy as np
import pytest

from observer.config.estimator import EstimatorSettings
from observer.estimators import build_estimator
from observer.frames import EstimateQuality, Quality
from tests.logs.inputs import inputs
from tests.logs.plants import AMBIENT_DEGC, rod

ENGINES = [("kalman", "compiled"), ("kalman", "constant"), ("luenberger", "compiled")]


def quiet(plant, steps=200, seed=0):
    """Inputs of a rod at rest at the ambient's temperature, all sensors present."""
    u = inputs(plant, steps=steps, seed=seed, missing=0.0, law_steps=False)
    u.y_degC[:] = AMBIENT_DEGC + 0.05 * np.random.default_rng(seed).normal(size=u.y_degC.shape)
    u.z_start[:] = u.z_end[:] = AMBIENT_DEGC
    return u


def run(plant, u, kind="kalman", engine="compiled"):
    estimator = build_estimator(plant, EstimatorSettings(kind=kind, engine=engine, bandwidth_1_s=0.005))
    return estimator.run(estimator.initial(), u)


@pytest.mark.parametrize(("off", "by_K", "steps"), [([1], 500.0, 50), ([0, 1], 40.0, 35)])
@pytest.mark.parametrize(("kind", "engine"), ENGINES)
def test_sensors_that_are_no_majority_stay_refused_while_they_disagree(kind, engine, off, by_K, steps):
    """Only more than half of them overrule the model, however long two of four agree."""
    plant, sound = rod(), [i for i in range(4) if i not in off]
    u, wrong = quiet(plant), slice(100, 100 + steps)
    u.y_degC[wrong, off] += by_K
    _, block = run(plant, u, kind, engine)
    assert (block.sensor_quality[wrong, off] == Quality.REJECTED).all()
    assert (block.sensor_quality[wrong, sound] == Quality.GOOD).all()
    assert (block.quality[wrong] == EstimateQuality.DEGRADED).all()
    assert (block.innovation_K[wrong, off] > 0.8 * by_K).all()
    assert len(off) > 1 or (block.quality[100 + steps :] == EstimateQuality.GOOD).all()
    # The field at those sensors stays where the others and the model put it.
    assert np.abs(block.field_degC[wrong] - AMBIENT_DEGC).max() < 1.0


@pytest.mark.parametrize(("kind", "engine"), ENGINES)
def test_the_gate_cannot_lock_out_all_sensors(kind, engine):
    """The whole screw is suddenly elsewhere: two steps are refused, the third is believed."""
    plant = rod()
    u = quiet(plant)
    u.y_degC[100:] += 40.0
    u.z_start[101:] += 40.0
    u.z_end[100:] += 40.0
    _, block = run(plant, u, kind, engine)
    assert (block.sensor_quality[100:102] == Quality.REJECTED).all()
    assert (block.sensor_quality[102:106] == Quality.GOOD).all()
    if kind == "kalman":
        assert np.abs(block.field_degC[110] - (AMBIENT_DEGC + 40.0)).max() < 3.0
        # The field is believed to be elsewhere at once, so no heat is inferred beyond its uncertainty.
        assert (np.abs(block.heat_W[-1]) < 4 * block.heat_sigma_W[-1]).all()


def test_release_forgets_enough_to_follow_a_step_of_heat():
    """300 W come from nowhere at one end: the estimate must reach them, whatever was refused on the way."""
    plant = rod(walk_W_sqrt_s=0.05)
    u = quiet(plant, steps=2400)
    from tests.logs.inputs import temperatures

    u.y_degC[:] = temperatures(plant, u, lambda t: np.array([0.0, 0.0, 300.0 * (t > 100)]), seed=1)
    _, block = run(plant, u)
    assert abs(block.heat_W[-1, 2] - 300.0) < 15.0
    assert (block.quality[-100:] == EstimateQuality.GOOD).all()


@pytest.mark.parametrize(("kind", "engine"), ENGINES)
def test_a_single_outlier_of_rows_far_apart_does_not_open_the_state(kind, engine):
    """Half a minute between rows: what one sample says is not tried before it has been said three times."""
    plant = rod()
    settings = EstimatorSettings(kind=kind, engine=engine, bandwidth_1_s=0.005)
    estimator, opened = build_estimator(plant, settings), []
    for count in (1, 2, 3):
        u = quiet(plant)
        u.dt_s[1:] = 30.0
        u.y_degC[100 : 100 + count, 1] += 20.0
        state, _ = estimator.run(estimator.initial(), u.part(0, 100 + count))
        opened.append(bool(np.isfinite(state.opened_K[1]) and state.opened_K[1] != 0.0))
    assert opened == [False, False, True]


@pytest.mark.parametrize(("kind", "engine"), ENGINES)
def test_without_any_good_sensor_the_estimate_is_stale_after_two_steps(kind, engine):
    plant = rod()
    u = quiet(plant)
    u.usable[100:150] = False
    u.quality[100:150] = Quality.MISSING
    _, block = run(plant, u, kind, engine)
    assert (block.quality[100:102] == EstimateQuality.DEGRADED).all()
    assert (block.quality[102:150] == EstimateQuality.STALE).all()
    assert (block.quality[150:] == EstimateQuality.GOOD).all()
    assert (np.diff(block.heat_sigma_W[100:150], axis=0) > 0).all()
