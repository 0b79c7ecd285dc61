"""The service's time only goes on."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from observer.service.clock import ServiceClock


@given(st.lists(st.floats(0, 1e5), min_size=2, max_size=30))
def test_every_time_is_later_than_the_one_before(steps):
    ticks = iter([0.0, *steps, *steps])
    clock = ServiceClock(lambda: 1.8e9, lambda: next(ticks))  # a monotonic clock that is not even monotonic
    times = [clock.now() for _ in range(len(steps))]
    assert all(b > a for a, b in pairwise(times))


def test_a_step_of_the_computers_clock_is_told_and_not_followed():
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
