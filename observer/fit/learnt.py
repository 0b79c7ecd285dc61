"""What an estimator has learnt while it ran, as changes of the configuration that it ran by."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from observer.config import Config
from observer.effects.base import EffectTable
from observer.effects.catalogue import offset_of
from observer.effects.terms import Offset
from observer.fit.parameters import candidates
from observer.fit.tolerance import left_of_tolerances

PLAIN = 2.0
"""An offset of so many σ is worth an entry of its own."""


class Offer(NamedTuple):
    """Values and what is left of their tolerances, by the keys of a configuration, and the sensors' offsets
    as effects.
    """

    values: dict[str, float]
    left: dict[str, float]
    biases: tuple[EffectTable, ...]


def offered(config: Config, learnt: Mapping[str, tuple[float, float]]) -> Offer:
    """Return what a configuration could say after what was learnt: value and σ by name.

    What it has no key for, such as the ambient's offset, stays within its tolerance. A sensor that has an
    entry for its offset already keeps that one.
    """
    values = {key: value for key, (value, _) in learnt.items() if key in candidates(config) and value > 0.0}
    left = left_of_tolerances(config, {key: learnt[key][1] / value for key, value in values.items()})
    terms = [term for effect in config.effect for term in effect.terms(config)]
    told = {term.sensor for term in terms if isinstance(term, Offset)}
    biases = []
    for sensor in config.sensor:
        value_K, sigma_K = learnt.get(key := f"sensor.{sensor.name}.offset_K", (0.0, 0.0))
        if abs(value_K) > PLAIN * sigma_K and sensor.name not in told:
            biases.append(offset_of(sensor.name, value_K))
            left[key] = min(sigma_K, config.tolerance.offset_of_K(sensor.offset_K))
    return Offer(values, left, tuple(biases))
