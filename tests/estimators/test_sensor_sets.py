"""σ with many sets of sensors at once: against those of a machine that has only the sensors of one."""

from functools import cache
from pathlib import Path
from typing import get_args

import numpy as np

from observer.config.estimator import Learnable
from observer.config.machine import LEARNT
from observer.config.sensors import Sensor
from observer.estimators.design.spread import spread, with_sensors
from observer.installation import load
from observer.model.build import build_plant

CONFIG = Path(__file__).parents[2] / "config"
STEP_S = 5.0
PROBE = 5


@cache
def housings():
    """Sensors on nodes and on the screw, one without an offset, and so a state less; the last is a probe."""
    config = load(CONFIG / "li-network.toml")
    more = (
        Sensor(name="s1", channel="s1", position_m=0.2, noise_K=0.3),
        Sensor(name="s2", channel="s2", position_m=0.45, offset_K=0.0),
        Sensor(name="probe", kind="displacement", channel="probe_um", position_m=0.3, zero_um=2.0),
    )
    # whatever is measured: without a sensor on the screw another would learn its laws, and trust them less
    kalman = config.estimator.model_copy(update={"period_s": 1.0, "learn": LEARNT})
    laws = tuple(source.model_copy(update={"law_uncertainty": 0.2}) for source in config.source)
    return config.model_copy(update={"sensor": (*config.sensor, *more), "estimator": kalman, "source": laws})


def means(sigmas):
    return np.column_stack([sigmas.heat_W, sigmas.field_K.mean(axis=1), sigmas.error_um.mean(axis=1)])


def alone(config, sensors):
    """The mean σ of a machine that has only those sensors."""
    own = config.model_copy(update={"sensor": tuple(config.sensor[i] for i in sensors)})
    return means(spread(own, [build_plant(own, learns=True)], own.reading_s, STEP_S))[0]


def together(config, sets, probing_s=None):
    plant = build_plant(config, learns=True)
    every_s = np.full((len(sets), plant.rows.sensors), np.inf)
    for row, one in zip(every_s, sets, strict=True):
        row[list(one)] = config.estimator.period_s
        if probing_s is not None and PROBE in one:
            row[PROBE] = probing_s
    return means(spread(config, [with_sensors(plant, one) for one in sets], every_s, STEP_S))


def test_a_set_among_many_is_as_sure_as_a_machine_that_has_only_its_sensors():
    sets = [(0, 1, 2), (2,), (0, 3, 4), (4,), (0, 1, 2, 3, 4), (0, 2, PROBE)]
    found = together(housings(), sets)
    for one, row in zip(sets, found, strict=True):
        np.testing.assert_allclose(row, alone(housings(), one), rtol=1e-9)


def test_a_probing_is_worth_more_the_oftener_it_comes_and_nothing_before_it_comes():
    sets, nothing = [(0, 2, PROBE)], together(housings(), [(0, 2)])
    field, error = -2, -1
    always, minute, half, hourly, never = (
        together(housings(), sets, every_s)[0] for every_s in (None, 60.0, 1800.0, 3600.0, 1e6)
    )
    np.testing.assert_allclose(never, nothing[0], rtol=1e-9)
    for part in (field, error):
        assert always[part] < minute[part] < half[part] < hourly[part] < never[part]
    # three readings of 1 µm, the zero known to 2 µm: what was 4 to 9 µm is about 2 µm from then on
    assert hourly[error] < 0.8 * never[error]


def test_a_further_sensor_makes_nothing_less_sure_of_what_a_filter_learns():
    """Where every tolerance is learnt the filter is the best there is, and more can only help it."""
    config = housings()
    learning = config.estimator.model_copy(update={"learn": get_args(Learnable)})
    found = together(config.model_copy(update={"estimator": learning}), [(0,), (0, 3), (0, 3, 4)])
    assert (np.diff(found, axis=0) < 1e-9).all()
