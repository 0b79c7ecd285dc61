"""The σ of an estimator over a shift: the filter itself runs over it, in steps longer than its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.errors import UserError
from observer.estimators import build_estimator
from observer.frames import FloatArray
from observer.model.cycle import SHIFT, standard_shift
from observer.model.learning import of_parameters
from observer.model.plant import Plant

SensorSet = tuple[int, ...]
"""Sensors chosen together, by their numbers, in increasing order."""
STEPS_S = (2.0, 5.0, 10.0)
"""Permitted steps: the first that needs at most `MOST_WORK`. An estimator's own step is the shortest."""
FROM_S = 600.0
"""The means of σ exclude the first ten minutes, in which the heats settle."""
MOST_WORK = 4e8
"""States squared times steps times runs: a second or two."""
_TOO_MUCH_WORK = 2.0 * MOST_WORK
_NO_GATE = 1e9


class Spread(NamedTuple):
    """Mean σ of v runs over a shift.

    Attributes:
        heat_W: σ of each estimated heat, W, (v, m_e).
        field_K: σ of the field, K, (v, g).
        error_um: σ of the thermal error, µm, (v, g), or (v, 0) without an expansion coefficient.
        reading_K: σ of each expected reading before it arrives, without its own noise, K or µm, (v, s). 0
            without readings.
    """

    heat_W: FloatArray
    field_K: FloatArray
    error_um: FloatArray
    reading_K: FloatArray


class NotDefined(NamedTuple):
    """The reason why σ over a shift do not exist, as a clause for a message."""

    reason: str


def spread(
    config: Config, plants: Sequence[Plant], every_s: FloatArray, dt_s: float | None = None
) -> Spread | NotDefined:
    """Return the mean σ of an estimator over the standard shift, for variants of one plant.

    Readings do not change σ, so all variants take those of the first. A constant or Luenberger gain is
    designed anew for the longer steps. A class from outside is taken for a Kalman filter.

    Args:
        config: The machine with its table `[estimator]`.
        plants: The v variants, as from `with_tolerances` or `with_sensors`.
        every_s: Time between readings of each sensor, s, (s,) or (v, s); infinite for one that is not used. A
            step has the mean of its readings.
        dt_s: Length of the steps, s. None takes the first of `STEPS_S` within `MOST_WORK`.

    Returns:
        The σ. `NotDefined` if the settings have no gain, if errors grow without limit in these steps, or if
        the computation would take long.
    """
    settings = config.estimator
    dt_s = _step_s(plants[0], settings.period_s, len(plants)) if dt_s is None else dt_s
    if dt_s is None:
        return NotDefined("there are too many states")
    designed = settings.kind == "luenberger" or settings.engine == "constant"
    changes = {} if designed else {"kind": "kalman", "engine": "compiled"}
    settings = settings.model_copy(update={"period_s": dt_s, "gate_sigma": _NO_GATE, **changes})
    u = standard_shift(config, plants[0], dt_s)
    late, runs = u.time_s >= FROM_S, []
    every_s = np.broadcast_to(every_s, (len(plants), plants[0].rows.sensors))
    for plant, period_s in zip(plants, every_s, strict=True):
        noise_K2 = plant.noise_R_K2 * np.minimum(period_s / dt_s, 1.0)
        number = np.floor((u.time_s[:, None] + dt_s) / period_s)
        arrives = (np.diff(number, axis=0, prepend=0.0) > 0.0) | (period_s <= dt_s)
        try:
            estimator = build_estimator(replace(plant, noise_R_K2=noise_K2), settings)
        except UserError:
            return NotDefined("there is no gain")
        _, block = estimator.run(estimator.initial(), u._replace(usable=arrives))
        columns = (block.heat_sigma_W, block.field_sigma_K, block.error_sigma_um)
        has_reading = late[:, None] & np.isfinite(block.innovation_sigma_K)
        variance_K2 = np.where(has_reading, block.innovation_sigma_K, 0.0) ** 2 - noise_K2
        reading_K = np.sqrt(np.maximum(variance_K2, 0.0)).sum(axis=0) / np.maximum(has_reading.sum(axis=0), 1)
        runs.append([*(column[late].mean(axis=0) for column in columns), reading_K])
    result = Spread(*(np.stack(column) for column in zip(*runs, strict=True)))
    if all(np.isfinite(sigma).all() for sigma in result[:3]):
        return result
    return NotDefined(f"the gains are too large for double precision: errors grow in steps of {dt_s:g} s")


def _step_s(plant: Plant, period_s: float, runs: int) -> float | None:
    """Return the shortest step within `MOST_WORK`, else the longest; None if that is too much work."""
    states = len(plant.decay_1_s) + int(plant.estimated.sum()) + plant.learnt
    duration_s = sum(duration_s for duration_s, _ in SHIFT)
    for step_s in (max(step_s, period_s) for step_s in STEPS_S):
        work = states**2 * duration_s / step_s * runs
        if work <= MOST_WORK:
            return step_s
    return None if work > _TOO_MUCH_WORK else step_s


def with_tolerances(plant: Plant, share: FloatArray) -> Plant:
    """Return the plant with a share (L,) of each tolerance: 1 as configured, 0 exact."""
    a = plant.parameters
    return plant.with_parameters(a._replace(sigma=share * a.sigma))


def with_sensors(plant: Plant, sensors: SensorSet) -> Plant:
    """Return the plant with the parameters of only these sensors; its rows stay."""
    a = plant.parameters
    numbers = np.arange(len(a.kind))
    selected = numbers[(numbers < a.machine) | np.isin(a.of, sensors)]
    considered = np.flatnonzero(np.isin(selected, a.considered))
    return plant.with_parameters(of_parameters(a, selected)._replace(considered=considered))
