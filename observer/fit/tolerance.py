"""What is known of any machine only within a tolerance, and must not be taken for a missing effect.

Each is a small change of the configuration with a standard deviation of its own: it may vary inside every
hypothesis, at a price (a Gaussian prior), and is neither reported nor written back.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from observer.config import Config
from observer.effects.base import Unnamed
from observer.effects.terms import Lag, StretchFilm
from observer.tables.sections import Sensor

Kind = Literal["screw", "place", "lag"]

MATERIAL = 0.02
"""Conductivity and heat capacity as printed in tables."""
PLACE_M = 1e-3
"""Where a sensor sits."""
UNEVEN = 0.01
"""A film's unevenness along the screw, as a part of itself."""
STRETCHES = 4
LAG_S = 4.0
"""A thermocouple's own lag."""


def tolerances(config: Config) -> Iterator[tuple[Config, Kind]]:
    """Yield the configuration changed by one standard deviation of a tolerance, and of what it is one.

    "place" and "lag" are one for each sensor, all changed at once.
    """
    screw = config.screw
    for key in ("conductivity_W_mK", "specific_heat_J_kgK"):
        value = getattr(screw, key) * (1 + MATERIAL)
        yield config.model_copy(update={"screw": screw.model_copy(update={key: value})}), "screw"
    moved = [_moved_inward(s, screw.length_m) for s in config.sensor]
    yield config.model_copy(update={"sensor": tuple(moved)}), "place"
    film = config.surface.convection_W_m2K
    if film > 0:
        edges = np.linspace(0.0, screw.length_m, STRETCHES + 1)
        for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            extra = Unnamed((StretchFilm(a, b, UNEVEN * film),))
            yield config.model_copy(update={"effect": (*config.effect, extra)}), "screw"
    lags = Unnamed(tuple(Lag(s.name, LAG_S) for s in config.sensor))
    yield config.model_copy(update={"effect": (*config.effect, lags)}), "lag"


def _moved_inward(sensor: Sensor, length_m: float) -> Sensor:
    """The sensor a little nearer to the middle of the screw; one beside the screw stays."""
    if sensor.position_m is None:
        return sensor
    by_m = PLACE_M if sensor.position_m < length_m / 2 else -PLACE_M
    return sensor.model_copy(update={"position_m": sensor.position_m + by_m})
