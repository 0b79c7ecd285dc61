"""The σ by which sensors are chosen, held against machines of the independent truth."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from observer.config.machine import Config
from observer.estimators.design.spread import SensorSet, spread, with_sensors
from observer.frames import FloatArray
from observer.model.build import build_plant
from tests.learning.cover import estimates, misses
from tests.learning.housings import HOUSED_CONFIG, draw_housed
from tests.learning.machines import Day, Rough, config_of, draw, work
from tests.truth.machine.cycles import START_m, programme
from tests.truth.machine.housings import BODIES
from tests.truth.machine.logs import CHANNELS
from tests.truth.machine.machine import SENSOR_M, stream

ALL = len(BODIES) + len(SENSOR_M)
STEP_S = 5.0


@cache
def everywhere() -> Config:
    """The configuration with a thermocouple on each body, and five on the screw; none is excluded as faulty,
    for the σ of a set are those of all its sensors.
    """
    config = config_of(HOUSED_CONFIG, "\n[integrity]\nenabled = false\n")
    like = config.sensor[0]
    on_screw = [
        like.model_copy(update={"name": f"s{i}", "channel": f"s{i}_degC", "position_m": x, "on": None})
        for i, x in enumerate(SENSOR_M.tolist())
    ]
    return config.model_copy(update={"sensor": (*config.sensor, *on_screw)})


def ranked(sets: list[SensorSet]) -> FloatArray:
    """The rms σ (v, 3) of heats, field and thermal error that each set leaves."""
    config = everywhere()
    plant = build_plant(config, learns=True)
    used = np.array([np.isin(np.arange(plant.rows.sensors), one) for one in sets])
    every_s = np.where(used, config.estimator.period_s, np.inf)
    sigmas = spread(config, [with_sensors(plant, one) for one in sets], every_s, STEP_S)
    return np.column_stack([np.sqrt(np.mean(each**2, axis=1)) for each in sigmas[:3]])


def observed(seed: int, number: int, sets: list[SensorSet]) -> FloatArray:
    """The rms errors (v, 3) of heats, field and thermal error over a day of one machine, with each set.

    What the day is made of shares nothing with the model. Film, laws and material are off, as are the
    offsets, places and lags of the sensors; links are as configured.
    """
    housed, other = draw_housed(seed, number, 0.0), draw(seed, number + 1000, Rough())
    sensors = {
        name: getattr(other.machine, name) for name in ("lag_s", "offset_K", "drift_K_h", "toward_air")
    }
    on_screw = replace(
        housed, machine=replace(housed.machine, **sensors), sensor_m=other.sensor_m, on_bodies=False
    )
    run = "abc"[number % 3]
    days = []
    for specimen in (housed, on_screw):
        rng = stream(seed, "day", str(number), run)
        days.append(work(specimen, programme("standard", run, rng), START_m[run], rng, 0.0))
    np.testing.assert_array_equal(days[0].field_degC, days[1].field_degC)
    seen = np.hstack([one.sensor_degC for one in days])
    return np.array([_errors(days[0]._replace(sensor_degC=seen[:, list(one)]), one) for one in sets])


def _errors(day: Day, sensors: SensorSet) -> list[float]:
    config = everywhere()
    chosen = zip(CHANNELS, sensors, strict=False)
    own = tuple(config.sensor[i].model_copy(update={"channel": channel}) for channel, i in chosen)
    found = misses(estimates(config.model_copy(update={"sensor": own}), day), day)
    return [float(np.sqrt(np.mean(found[name][0] ** 2))) for name in ("heats", "field", "error")]


SEED, MACHINES = 53000, 9


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_good_sensors_find_what_their_sigma_says_they_find_better() -> None:
    """Of all sets of three the best, the middle one and the worst, by the product of the three σ. The best
    has at most half of the others' σ of field and thermal error, and in rms over the machines smaller errors
    of both. Three machines work each programme; on one of them the best set may be mistaken by itself.
    """
    sets = list(itertools.combinations(range(ALL), 3))
    sigma = ranked(sets)
    order = np.argsort(np.log(sigma).mean(axis=1))
    chosen = [order[i] for i in (0, len(sets) // 2, len(sets) - 1)]
    assert (sigma[chosen[0], 1:] < 0.5 * sigma[chosen[1:], 1:]).all()
    squares = [observed(SEED, number, [sets[i] for i in chosen]) ** 2 for number in range(MACHINES)]
    rms = np.sqrt(np.mean(squares, axis=0))
    assert (rms[0, 1:] < rms[1:, 1:]).all()
