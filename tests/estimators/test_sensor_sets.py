"""σ with many sets of sensors at once: against those of a machine that has only the sensors of one."""

from functools import cache
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from observer.config import LEARNT
from observer.estimators.design.sensor_sets import set_sigmas
from observer.estimators.design.spread import spread
from observer.installation import load
from observer.model.build import build_plant
from observer.model.cycle import standard_shift
from observer.tables.estimator import Learnable
from observer.tables.sensors import Sensor

CONFIG = Path(__file__).parents[2] / "config"
STEP_S = 30.0
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


def alone(config, sensors):
    """The mean σ of a machine that has only those sensors, by `spread` with the step of the sets here."""
    own = config.model_copy(update={"sensor": tuple(config.sensor[i] for i in sensors)})
    plant = build_plant(own, learns=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("observer.estimators.design.spread.STEPS_S", (STEP_S,))
        found = spread(plant, own.estimator, standard_shift(own, plant), np.ones((1, plant.learnt)))
    return np.array([*found.heat_W[0], found.field_K[0], found.error_um[0]])


def together(config, sets, probing_s=None):
    plant = build_plant(config, learns=True)
    every_s = np.full(plant.rows.sensors, config.estimator.period_s)
    if probing_s is not None:
        every_s[PROBE] = probing_s
    found = set_sigmas(plant, standard_shift(config, plant), sets, every_s, STEP_S)
    means = [found.field_K.mean(axis=1), found.error_um.mean(axis=1)]
    return np.column_stack([found.heat_W, *means])


def test_a_set_among_many_is_as_sure_as_a_machine_that_has_only_its_sensors():
    sets = [(0, 1, 2), (2,), (0, 3, 4), (4,), (0, 1, 2, 3, 4), (0, 2, PROBE)]
    found = together(housings(), sets)
    for one, row in zip(sets, found, strict=True):
        np.testing.assert_allclose(row, alone(housings(), one), rtol=1e-9)


def test_a_probing_now_and_then_is_worth_less_than_one_all_the_time_and_nothing_before_it_comes():
    sets, always, nothing = (
        [(0, 2, PROBE)],
        together(housings(), [(0, 2, PROBE)]),
        together(housings(), [(0, 2)]),
    )
    field, error = -2, -1
    hourly, half, never = (together(housings(), sets, s)[0] for s in (3600.0, 1800.0, 1e6))
    np.testing.assert_allclose(never, nothing[0], rtol=1e-9)
    for part in (field, error):
        assert always[0, part] < half[part] < hourly[part] < never[part]
    # three readings of 1 µm, the zero known to 2 µm: what was 4 to 9 µm is about 2 µm from then on
    assert hourly[error] < 0.8 * never[error]


def test_a_further_sensor_makes_nothing_less_sure_of_what_a_filter_learns():
    """Where every tolerance is learnt the filter is the best there is, and more can only help it."""
    config = housings()
    learning = config.estimator.model_copy(update={"learn": get_args(Learnable)})
    found = together(config.model_copy(update={"estimator": learning}), [(0,), (0, 3), (0, 3, 4)])
    assert (np.diff(found, axis=0) < 1e-9).all()
