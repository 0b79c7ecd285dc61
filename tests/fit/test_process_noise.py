from __future__ import annotations

from functools import cache

import numpy as np

from observer.config.machine import Config
from observer.estimators.kalman import KalmanEstimator
from observer.fit.calibrate import calibrate
from observer.fit.process_noise import (
    FIELD,
    evidence_of_noise,
    fit_noise,
    innovations_log_likelihood,
    liveliest,
)
from observer.frames import EstimateQuality
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from tests.logs.machines import machine, rig
from tests.logs.simulated import made_log


@cache
def calibrated_rig() -> tuple[Config, dict[str, float]]:
    """The rig's configuration, calibrated, and the noise that is found with it."""
    config, blocks = rig()
    config = calibrate(config, [blocks]).config
    return config, fit_noise(config, [blocks])


def test_the_noise_of_the_rig_lets_the_filter_keep_its_sensors() -> None:
    config, blocks = rig()
    fitted, noise = calibrated_rig()
    assert set(noise) == {FIELD} | {f"source.{s.name}.random_walk_W_sqrt_s" for s in config.source}
    exact = config.estimator.model_copy(update={"field_noise_K_sqrt_s": 0.0})
    before = _good_share(config.model_copy(update={"estimator": exact}), blocks)
    after = _good_share(_with(fitted, noise), blocks)
    # a configuration that takes its field for exact has the gate refuse sensors for hours
    assert before < 0.95
    assert after > 0.99


def test_no_other_noise_is_more_likely() -> None:
    _, blocks = rig()
    config, noise = calibrated_rig()
    [inputs], held_back = evidence_of_noise(config, build_plant(config), [blocks])
    assert inputs.time_s[-1] < held_back.time_s[0]
    best = innovations_log_likelihood(build_plant(_with(config, noise)), inputs)
    for key, value in noise.items():
        for factor in (1 / 3, 3.0):
            other = build_plant(_with(config, noise | {key: value * factor}))
            # the heats were sought before the field's last turn: a nat is no difference
            assert innovations_log_likelihood(other, inputs) < best + 1.0, (key, factor)


def test_a_machine_that_is_its_model_has_little_noise() -> None:
    config = machine()
    noise = fit_noise(config, [[made_log(config, 11)]])
    # 1 mK/√s moves the field by 0.06 K in an hour, what the sensors' noise hides
    assert noise[FIELD] < 1e-3
    assert max(value for key, value in noise.items() if key != FIELD) < 0.05


def test_the_liveliest_stretch_holds_the_largest_change() -> None:
    config = machine()
    log = made_log(config, 12)
    drive = Drive(config, build_plant(config))
    inputs = drive.run(drive.initial(), log)[1]
    part = liveliest(inputs, 100)
    assert len(part) == 100
    assert np.abs(part.law_jump_W).max() == np.abs(inputs.law_jump_W).max()
    assert len(liveliest(inputs, 10**6)) == len(inputs)


def _with(config, noise):
    table = config.model_dump(exclude_unset=True)
    table.setdefault("estimator", {})["field_noise_K_sqrt_s"] = noise[FIELD]
    for source in table["source"]:
        source["random_walk_W_sqrt_s"] = noise[f"source.{source['name']}.random_walk_W_sqrt_s"]
    return parse(table)


def _good_share(config, blocks) -> float:
    plant = build_plant(config)
    drive, estimator = Drive(config, plant), KalmanEstimator(plant, config.estimator)
    driven, state, good, steps = drive.initial(), estimator.initial(), 0, 0
    for block in blocks:
        driven, inputs = drive.run(driven, block)
        state, estimates = estimator.run(state, inputs)
        good += np.count_nonzero(estimates.quality == int(EstimateQuality.GOOD))
        steps += len(block)
    return good / steps
