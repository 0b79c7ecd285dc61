"""Rough machines with sensors wherever they can be, of which an observer is given some."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from observer.config import Config
from observer.estimators.design.sensor_sets import SensorSet, set_sigmas
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.cycle import standard_shift
from tests.learning.cover import estimates, misses
from tests.learning.housings import HOUSED_CONFIG, draw_housed
from tests.learning.machines import Day, Rough, config_of, draw, work
from tests.truth.machine.cycles import START_m, programme
from tests.truth.machine.housings import BODIES
from tests.truth.machine.logs import CHANNELS
from tests.truth.machine.machine import SENSOR_M, stream

ALL = len(BODIES) + len(SENSOR_M)
STEP_S = 30.0


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
    shift = standard_shift(config, plant)
    found = set_sigmas(plant, shift, sets, np.full(plant.rows.sensors, config.estimator.period_s), STEP_S)
    return np.column_stack([np.sqrt(np.mean(each**2, axis=1)) for each in found])


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
