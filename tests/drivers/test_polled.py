"""When a value was true that a server keeps: its source's stamp, whatever that clock says."""

from __future__ import annotations

import math
import random

import pytest

from drivers.polled import PolledValue, SourceTimes

PERIOD_S = 0.1
AHEAD_S = -3600.0  # the source's clock


def _asked(made_s, delay_s, until_s):
    """Values as they are seen by a client that asks each period: value i was made at `made_s[i]`."""
    times = SourceTimes()
    found = {}
    for k in range(round(until_s / PERIOD_S)):
        now_s = k * PERIOD_S
        there = [i for i, at_s in enumerate(made_s) if at_s + delay_s[i] <= now_s]
        if there:
            i = there[-1]
            answer = PolledValue(float(i), stamp_s=made_s[i] + AHEAD_S)
            (reading,) = times.readings({"x_m": answer}, now_s)
            found.setdefault(i, []).append(reading.time_s)
    return found


def test_a_value_has_the_moment_of_its_change_and_then_that_of_each_answer():
    chance = random.Random(1)
    made_s = [0.5 * i + chance.uniform(0.0, 0.3) for i in range(60)]
    found = _asked(made_s, [0.0] * 60, 30.0)
    late_s = [found[i][0] - made_s[i] for i in range(20, 59)]
    assert max(abs(s) for s in late_s) < 0.03  # the second least of ten delays; asked for each 0.1 s
    assert found[40][1] - found[40][0] <= PERIOD_S + 1e-9  # the value that stands is that of its answer
    assert found[40][2] - found[40][1] == pytest.approx(PERIOD_S)


def test_no_time_runs_back_or_ahead_where_values_are_held_up():
    chance = random.Random(2)
    made_s = [0.3 * i for i in range(90)]
    delay_s = [chance.choice([0.0, 0.0, 0.25]) for _ in made_s]
    found = _asked(made_s, delay_s, 27.0)
    times_s = [t for i in sorted(found) for t in found[i]]
    assert times_s == sorted(times_s)
    assert all(first_s <= made_s[i] + delay_s[i] + PERIOD_S for i, (first_s, *_) in found.items())


def test_without_a_stamp_the_arrival_holds():
    times = SourceTimes()
    for arrival_s in (1.0, 2.0, 3.0):
        (reading,) = times.readings({"x_m": PolledValue(1.0), "y_m": PolledValue(fault="bad")}, arrival_s)
        assert reading.time_s == arrival_s
        assert reading.faults == {"y_m": "bad"}
        assert math.isnan(reading.values["y_m"])
