"""A rough machine where an infrared sensor looks at the screw, by Planck's law in its band."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.frames import EstimateBlock
from observer.tables.sensors import Sensor
from tests.learning.cover import estimates
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
