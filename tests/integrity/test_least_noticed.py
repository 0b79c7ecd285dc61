"""What `check` says is noticed is noticed on rough machines, and much smaller is not."""

from __future__ import annotations

import itertools
from functools import cache
from typing import Any

import pytest

from campaigns.integrity import faults as of
from campaigns.integrity.catalogue import Fault
from campaigns.integrity.judge import RIG, judged
from observer.report.sensitivity import detectable
from tests.learning.machines import config_of
from tests.truth.machine.machine import SENSORS

MACHINES = (0, 1)
"""At the fault the first stands, and the nut of the second moves."""
DRIFTS_S = 1500.0


@cache
def said() -> dict[str, Any]:
    """What `check` says of the sensors of the machine that is judged."""
    return dict(detectable(config_of(RIG))["minimal_detectable"])


def jump(sensor: str, share: float) -> Fault:
    """A part of the least jump that is noticed."""
    size_K = share * said()[sensor]["fault_K"]
    return Fault(f"{sensor} {share:g} of its least", "jump of one", (sensor,), of.offset((sensor,), size_K))


@pytest.mark.parametrize(("sensor", "number"), list(zip(SENSORS, itertools.cycle(MACHINES))))
def test_twice_the_least_is_noticed_in_time_at_the_right_sensor(sensor: str, number: int) -> None:
    found = judged(jump(sensor, 2.0), number)
    assert (found.bad_s, found.right) == (0.0, "yes")
    assert found.named_s is not None
    assert found.named_s <= said()[sensor]["time_s"] + 1.0


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_fifth_of_the_least_is_not_noticed(sensor: str) -> None:
    """A reading that is off by a tolerance is none that is at fault."""
    assert judged(jump(sensor, 0.2), 0).out == 0


@pytest.mark.slow
@pytest.mark.parametrize("number", MACHINES)
@pytest.mark.parametrize("sensor", SENSORS)
def test_a_drift_to_twice_the_least_slow_fault_is_noticed_on_its_way(sensor: str, number: int) -> None:
    """The faulty sensor is not always identified."""
    most_K = 2.0 * said()[sensor]["slow_K"]
    drift = of.drift((sensor,), most_K * 3600.0 / DRIFTS_S, most_K)
    found = judged(Fault(f"{sensor} drifts", "slow single", (sensor,), drift), number)
    assert found.bad_s is not None
    assert found.bad_s <= DRIFTS_S
