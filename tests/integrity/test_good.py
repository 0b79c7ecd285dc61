"""What `good` means: no test fails, and the bound meets the limit with the sensors that are used."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from campaigns.integrity.catalogue import catalogue
from campaigns.integrity.days import FAULT_S, day_of
from campaigns.integrity.judge import RIG, faulty
from observer.align.aligner import frames_of_log
from observer.estimate.pipeline import MachineModel
from observer.frames import EstimateBlock, EstimateQuality
from tests.learning.cover import log_of
from tests.learning.machines import Day, config_of

WIDE, TIGHT = 1000.0, 1.0
"""µm: a limit that four sensors meet with ease, and one that not even five can."""
SETTLED_S = FAULT_S + 300.0


def _estimates(day: Day, limit_um: float | None = None, *, last_s: float = np.inf) -> EstimateBlock:
    """The estimates of a day up to `last_s`, with a limit of the thermal error."""
    more = "" if limit_um is None else f"\n[integrity]\nlimit_um = {limit_um}\n"
    machine = MachineModel.of(config_of(RIG, more), learns=True)
    pipeline: Any = machine.pipeline()
    pipeline.gap = None
    rows = day.time_s <= last_s
    day = day._replace(**{name: getattr(day, name)[rows] for name in Day._fields})
    return EstimateBlock.joined([pipeline.step(f) for f in frames_of_log(log_of(day), machine.plan)])


def _without(sensor: int) -> Day:
    """A day on which a sensor delivers nothing from `FAULT_S` on."""
    day = day_of(0)
    sensor_degC = day.sensor_degC.copy()
    sensor_degC[day.time_s >= FAULT_S, sensor] = np.nan
    return day._replace(sensor_degC=sensor_degC)


def test_a_good_estimate_counts_an_excluded_sensor_as_not_used() -> None:
    block = _estimates(faulty(day_of(0), catalogue()["t5 +3 K"], 0))
    later = block.time_s >= SETTLED_S
    good = later & (block.quality == EstimateQuality.GOOD)
    assert good.sum() > 0.5 * later.sum()
    assert set(block.sensors_used[good]) == {4}
    before = (block.time_s < FAULT_S) & (block.quality == EstimateQuality.GOOD)
    assert set(block.sensors_used[before]) == {5}


@pytest.mark.parametrize(
    ("limit_um", "quality"),
    [
        (None, EstimateQuality.DEGRADED),  # no limit says that the sensor is not needed
        (WIDE, EstimateQuality.GOOD),
        (TIGHT, EstimateQuality.DEGRADED),
    ],
)
def test_a_silent_sensor_is_needed_unless_the_bound_meets_a_limit_without_it(
    limit_um: float | None, quality: EstimateQuality
) -> None:
    block = _estimates(_without(2), limit_um, last_s=SETTLED_S + 300.0)
    later = block.time_s >= SETTLED_S
    assert set(block.quality[later]) == {quality}
    assert set(block.sensors_used[later]) == {4}
