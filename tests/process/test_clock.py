"""The service's time only goes on, and a compensation holds by a control's clock as well."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.control.compensator import Compensator
from observer.process.clock import ServiceClock
from tests.control.test_compensate import GRID, at, estimate, machine


@given(st.lists(st.floats(0, 1e5), min_size=2, max_size=30))
def test_every_time_is_later_than_the_one_before(steps):
    ticks = iter([0.0, *steps, *steps])
    clock = ServiceClock(lambda: 1.8e9, lambda: next(ticks))  # a monotonic clock that is not even monotonic
    times = [clock.now() for _ in range(len(steps))]
    assert all(b > a for a, b in pairwise(times))


def test_a_step_of_the_computers_clock_is_reported_and_not_followed():
    wall, mono = [1.8e9], [50.0]
    clock = ServiceClock(lambda: wall[0], lambda: mono[0])
    mono[0] += 10
    wall[0] += 10 - 3600
    assert clock.now() == 1.8e9 + 10
    assert clock.offset_s() == -3600


async def test_sleeps_until_a_time():
    clock = ServiceClock()
    until_s = clock.now() + 0.05
    await clock.sleep_until(until_s)
    assert clock.now() >= until_s
    await clock.sleep_until(until_s - 1)


def _armed() -> tuple[Compensator, object]:
    config = machine()
    compensator = Compensator(config, GRID)
    compensator.arm()
    compensator.step(estimate(np.zeros(9), 10.0), at(config, 10.0, 0.2), 0)
    assert compensator.state.armed
    return compensator, config


@pytest.mark.parametrize("offset_s", [3600.0, -3600.0, 0.6, -0.6])
def test_a_clock_that_was_set_disarms_until_somebody_arms_again(offset_s):
    compensator, config = _armed()
    documents = []
    for k, ahead_s in enumerate([offset_s, offset_s, 0.0, 0.0]):
        compensator.see_clock(ahead_s)
        if k == 1:
            compensator.arm()  # not while the clock is off
            compensator.see_clock(ahead_s)
        step = compensator.step(estimate(np.zeros(9), 10.5 + 0.5 * k), at(config, 10.5, 0.2), k)
        documents.append(step)
    assert not any(d["armed"] for d in documents)
    assert all("clock was set" in d["reason"] for d in documents)
    compensator.arm()
    assert compensator.step(estimate(np.zeros(9), 12.5), at(config, 12.5, 0.2), 5)["armed"]


@pytest.mark.parametrize(("offset_s", "until_s"), [(0.0, 22.0), (0.4, 22.0), (-0.4, 21.6)])
def test_a_document_never_holds_longer_than_by_the_computers_clock(offset_s, until_s):
    compensator, config = _armed()
    compensator.see_clock(offset_s)
    document = compensator.step(estimate(np.zeros(9), 10.5), at(config, 10.5, 0.2), 1)
    assert document["armed"]
    assert document["valid_until_s"] == pytest.approx(until_s)
