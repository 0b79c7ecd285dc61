"""Heat laws as sums that a controller can compute, fitted to values of each law."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.config.sections import law_channels
from observer.errors import ConfigError
from observer.frames import FloatArray
from observer.model.law import Law, heat_law

_PROBES = (-1700.0, -3.0, 0.0, 0.5, 41.0, 2300.0)
_SAME = 1e-9
"""Relative tolerance between a sum and its law: laws multiply in another order."""


class LawTerms(NamedTuple):
    """Heat = `constant` + Σ_i (`size`_i |v_i| + `value`_i v_i + `on`_i [v_i ≠ 0]) + |Σ_i `apart`_i v_i|, W.

    Attributes:
        constant: Heat at zero of all channels, in W, (m,).
        size: W per unit of the channel's magnitude, (m, c).
        value: W per unit of the channel, (m, c).
        on: Heat while the channel is not 0, in W, (m, c).
        apart: W per unit, for heats of a difference of two speeds, (m, c).
    """

    constant: FloatArray
    size: FloatArray
    value: FloatArray
    on: FloatArray
    apart: FloatArray


def law_terms(config: Config) -> LawTerms:
    """Return the laws of a configuration as sums, for m sources and c channels.

    The coefficients come from values of each law on its axes, and the sum is compared with the law at many
    other values.

    Raises:
        ConfigError: If a law is not such a sum; it names the source and the remedy.
    """
    shape = len(config.source), len(config.channels)
    terms = LawTerms(np.zeros(shape[0]), *(np.zeros(shape) for _ in range(4)))
    for j, source in enumerate(config.source):
        law = heat_law(source, config.source, config.screw.length_m)
        columns = [config.channels.index(name) for name in law_channels(source, config.source)]
        law_as_sum = _terms_of(law, len(columns))
        if not _agrees(law, law_as_sum, len(columns)):
            raise ConfigError(
                f"source {source.name}: its heat law is not a multiple of a speed or a power, "
                "which is all a controller has; give torque_Nm or heat_W_rpm that fits the speeds in use"
            )
        terms.constant[j] = law_as_sum.constant[0]
        for to, coefficients in zip(terms[1:], law_as_sum[1:], strict=True):
            for i, column in enumerate(columns):
                to[j, column] += coefficients[0, i]
    return terms


def _at(law: Law, values: FloatArray) -> float:
    """Return the law's heat in W at one value of each channel."""
    channels = values if len(values) else np.zeros(1)
    return float(law(*(np.array([value]) for value in channels))[0])


def _terms_of(law: Law, count: int) -> LawTerms:
    """Return a law of `count` channels as a sum, from its values on the axes."""
    one = np.zeros((1, count))
    terms = LawTerms(np.array([_at(law, np.zeros(count))]), one, one.copy(), one.copy(), one.copy())
    for i, axis in enumerate(np.eye(count)):
        up, twice, down = (_at(law, k * axis) - terms.constant[0] for k in (1.0, 2.0, -1.0))
        if up == twice == down:
            terms.on[0, i] = up
        else:
            terms.size[0, i], terms.value[0, i] = (up + down) / 2, (up - down) / 2
    both = _at(law, np.ones(count)) - terms.constant[0]
    if count == 2 and abs(both) < _SAME * abs(terms.size).max():  # only the relative speed counts
        terms.apart[0] = terms.size[0] * (1.0, -1.0)
        terms.size[0] = 0.0
    return terms


def _agrees(law: Law, terms: LawTerms, count: int) -> bool:
    """Whether the sum equals the law at many values of its channels."""
    for v in map(np.array, product(_PROBES, repeat=count)):
        sum_W = terms.constant[0] + abs(float(terms.apart[0] @ v))
        sum_W += float(terms.size[0] @ abs(v) + terms.value[0] @ v + terms.on[0] @ (v != 0.0))
        if not abs(sum_W - _at(law, v)) <= _SAME * max(1.0, abs(sum_W)):
            return False
    return True
