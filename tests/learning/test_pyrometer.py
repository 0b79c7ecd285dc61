"""An infrared sensor of unknown emissivity in the place of a thermocouple, on rough machines of the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from observer.config.sensors import Sensor
from observer.frames import EstimateBlock
from tests.learning.cover import QUANTITIES, estimates, judged_estimates
from tests.learning.machines import CONFIG, GRID_M, Day, Rough, config_of, day, draw
from tests.truth.machine.machine import stream
from tests.truth.machine.physics import FloatArray

BAND_UM = (8.0, 14.0)
"""Of a bolometer's window."""
EMISSIVITY, EMISSIVITY_SIGMA = 0.3, 0.05
"""Of ground steel with a film of oil, and how well anybody knows it."""
SURROUNDINGS_K, OFFSET_K, NOISE_K = 1.0, 0.3, 0.1
"""σ of how much warmer than the air what the steel reflects is, of the sensor's offset, and of its noise."""
ENDS, MIDDLE = (0, 4), (0, 2, 4)
"""The thermocouples beside the bearings, and these with what measures in the middle of the nut's way."""
_C2_UM_K = 14_387.77
_TABLE_degC = np.linspace(-60.0, 200.0, 5201)


def radiance(degC: FloatArray) -> FloatArray:
    """What a black body radiates in the band, in some unit (Planck 1901), by Gauss's rule."""
    node, weight = np.polynomial.legendre.leggauss(12)
    low, high = BAND_UM
    wave_um = 0.5 * (high - low) * node + 0.5 * (high + low)
    kelvin = np.asarray(degC)[..., None] + 273.15
    return np.asarray((1e5 / wave_um**5 / np.expm1(_C2_UM_K / (wave_um * kelvin))) @ weight)


def shown_degC(
    screw_degC: FloatArray, around_degC: FloatArray, air_degC: FloatArray, emissivity: float, set_to: float
) -> FloatArray:
    """What an instrument that is `set_to` an emissivity shows of steel of another in its surroundings, which
    it takes to be as warm as the air.
    """
    seen = emissivity * radiance(screw_degC) + (1.0 - emissivity) * radiance(around_degC)
    own = (seen - (1.0 - set_to) * radiance(air_degC)) / set_to
    return np.asarray(np.interp(own, radiance(_TABLE_degC), _TABLE_degC))


class LookedAt(NamedTuple):
    """A day, and what a pyrometer that takes everything for black read of it (n,)."""

    day: Day
    pyrometer_degC: FloatArray

    def described(self, **keys: float) -> Sensor:
        """The pyrometer as its user describes it, with keys that say otherwise."""
        offset_K = float(np.hypot(OFFSET_K, (1.0 - EMISSIVITY) * SURROUNDINGS_K))
        own = {"noise_K": NOISE_K, "offset_K": offset_K, "shows": EMISSIVITY}
        return Sensor.model_validate({"name": "t3", "channel": "t3_degC", "position_m": 0.5} | own | keys)


def looked_at(seed: int, number: int, run: str) -> LookedAt:
    """Run a rough machine at whose middle a pyrometer looks."""
    one, rng = day(draw(seed, number, Rough()), seed, number, run), stream(seed, "pyrometer", str(number))
    emissivity = float(np.clip(EMISSIVITY + EMISSIVITY_SIGMA * rng.standard_normal(), 0.1, 0.5))
    around_degC = one.air_degC + SURROUNDINGS_K * rng.standard_normal()
    offset_K, x_m = OFFSET_K * rng.standard_normal(), 0.5 + 0.002 * rng.standard_normal()
    screw_degC = np.array([np.interp(x_m, GRID_M, row) for row in one.field_degC])
    shown = shown_degC(screw_degC, around_degC, one.air_degC, emissivity, 1.0)
    noisy = shown + offset_K + NOISE_K * rng.standard_normal(len(shown))
    return LookedAt(one, np.round(noisy, 2))


def estimated(
    one: LookedAt, which: tuple[int, ...], pyrometer: Sensor | None = None, tables: str = ""
) -> EstimateBlock:
    """What the observer estimates with some of the sensors, where the middle one may be the pyrometer.

    `tables` is added to the configuration.
    """
    config, seen = config_of(CONFIG, tables), one.day.sensor_degC.copy()
    every = list(config.sensor)
    if pyrometer is not None:
        every[2], seen[:, 2] = pyrometer, one.pyrometer_degC
    channels = (sensor.channel for sensor in config.sensor)  # a day has its sensors in this order
    own = [every[i].model_copy(update={"channel": c}) for i, c in zip(which, channels, strict=False)]
    chosen = config.model_copy(update={"sensor": tuple(own)})
    return estimates(chosen, one.day._replace(sensor_degC=seen[:, list(which)]))


FRESH_SEED = 53_000
ROUGHLY = EMISSIVITY_SIGMA / EMISSIVITY


def test_it_shows_the_part_that_it_emits_when_it_takes_all_for_black() -> None:
    """To the first order; of 20 K it shows 6 % more, for radiance grows faster than the temperature."""
    air = np.full(2, 22.0)
    warm = air + np.array([0.01, 20.0])
    part = (shown_degC(warm, air, air, 0.3, 1.0) - air) / (warm - air)
    np.testing.assert_allclose(part, [0.3, 0.319], rtol=1e-3)
    np.testing.assert_allclose(shown_degC(warm, air, air, 0.3, 0.3), warm, atol=1e-3)


def test_with_its_tolerance_sigma_holds_and_the_field_is_better_known_than_without() -> None:
    one = looked_at(FRESH_SEED, 0, "a")
    roughly = judged_estimates(estimated(one, MIDDLE, one.described(shows_tolerance=ROUGHLY)), one.day)
    without = judged_estimates(estimated(one, ENDS), one.day)
    for name in QUANTITIES:
        assert roughly[name][1] >= 0.9
    assert roughly["field"][0] < 0.75 * without["field"][0]
    trusting = "\n[integrity]\nenabled = false\n"  # else it is excluded for a third of the day
    found = (
        estimated(one, MIDDLE, one.described(shows=1.0), trusting), estimated(one, ENDS, tables=trusting),
    )  # fmt: skip
    as_black, without_it = (judged_estimates(each, one.day)["field"][0] for each in found)
    assert as_black > 2.0 * without_it


@pytest.mark.slow
def test_on_fresh_machines() -> None:
    """Infrared sensors on rough machines; the bounds were set before the seed was drawn."""
    squares, within = dict[str, list[FloatArray]](), dict[str, list[FloatArray]]()
    for number in range(6):
        one = looked_at(FRESH_SEED, number, "abc"[number % 3])
        cases = {
            "roughly": estimated(one, MIDDLE, one.described(shows_tolerance=ROUGHLY)),
            "without": estimated(one, ENDS),
        }
        for case, found in cases.items():
            own = np.array(list(judged_estimates(found, one.day).values()))
            squares.setdefault(case, []).append(own[:, 0] ** 2)
            within.setdefault(case, []).append(own[:, 1])
    rms = {case: np.sqrt(np.mean(each, axis=0)) for case, each in squares.items()}
    assert (np.mean(within["roughly"], axis=0) >= 0.9).all()
    assert (rms["roughly"][1:] < 0.75 * rms["without"][1:]).all()
