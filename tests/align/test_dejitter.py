"""Samples as they were sent, from when they arrived."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from observer.kernels.walk import even_out

PERIOD_S = 0.02


def _samples(times, values=None):
    values = np.arange(float(len(times))) if values is None else values
    return np.array([times, values, *np.zeros((2, len(times)))], dtype=float)


def _passed(time_s=math.nan, value=math.nan):
    return np.array([time_s, value])


@given(st.lists(st.floats(0.001, 0.5), max_size=40), st.floats(0.005, 0.1))
def test_no_sample_is_moved_to_later_nor_before_the_last_step(delays_s, period_s):
    sent_s = period_s * np.arange(1, len(delays_s) + 1)
    arrived_s = np.maximum.accumulate(sent_s + delays_s)
    samples, passed = _samples(arrived_s), _passed(0.0, -1.0)
    end = even_out(samples, 0, len(delays_s), passed, period_s)
    times = samples[0, :end]
    assert (np.diff(times) > 0.0).all()
    assert (times > 0.0).all()
    for time_s, value in zip(times, samples[1, :end], strict=True):
        assert time_s <= arrived_s[int(value)] + 1e-12
    if end:
        assert passed[0] == times[-1] == arrived_s[int(samples[1, end - 1])]


def test_a_burst_is_spread_over_the_periods_before_it():
    arrived_s = [0.02, 0.04, 0.14, 0.1401, 0.1402, 0.1403, 0.1404]
    samples = _samples(arrived_s)
    assert even_out(samples, 0, 7, _passed(0.0), PERIOD_S) == 7
    np.testing.assert_allclose(samples[0], PERIOD_S * np.arange(1, 8), atol=6e-4)


def test_samples_in_time_stay_where_they_are():
    times = PERIOD_S * np.arange(1.0, 26.0)
    samples = _samples(times)
    assert even_out(samples, 0, 25, _passed(0.0), PERIOD_S) == 25
    np.testing.assert_allclose(samples[0], times, atol=1e-12)


def test_more_samples_than_periods_keep_their_arrival_times():
    """A message that comes five times as often as configured is not pushed into the past."""
    times = 0.004 * np.arange(1.0, 126.0)
    samples = _samples(times)
    assert even_out(samples, 0, 125, _passed(0.0), PERIOD_S) == 125
    np.testing.assert_allclose(samples[0], times, atol=1e-9)


def test_swapped_doubled_and_overtaken_samples():
    samples = _samples([0.04, 0.02, 0.0401, 0.06, -0.01], np.array([2.0, 1.0, 2.0, 3.0, 0.0]))
    end = even_out(samples, 0, 5, _passed(0.0, 0.0), PERIOD_S)
    np.testing.assert_array_equal(samples[1, :end], [1.0, 2.0, 3.0])


def test_an_unknown_period_leaves_the_times():
    samples = _samples([0.02, 0.0201, 0.06])
    assert even_out(samples, 0, 3, _passed(0.0), math.nan) == 3
    np.testing.assert_array_equal(samples[0], [0.02, 0.0201, 0.06])


def test_only_the_samples_of_the_step_are_touched_and_what_goes_with_them_goes_along():
    times = [9.0, 9.0, 0.06, 0.02, 0.0401, 0.0402, 9.0]
    samples = _samples(times, np.array([7.0, 8.0, 3.0, 1.0, 2.0, 2.0, 9.0]))
    samples[2] = [70.0, 80.0, 30.0, 10.0, 20.0, 21.0, 90.0]
    samples[3] = 0.1 * samples[2]
    passed = _passed(0.0, 0.0)
    end = even_out(samples, 2, 6, passed, PERIOD_S)
    assert end == 5, "the same value a moment later is the same frame"
    np.testing.assert_array_equal(samples[1, 2:end], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(samples[2, 2:end], [10.0, 20.0, 30.0])
    np.testing.assert_array_equal(samples[3], 0.1 * samples[2])
    np.testing.assert_array_equal(samples[:3, :2], [[9.0, 9.0], [7.0, 8.0], [70.0, 80.0]])
    np.testing.assert_array_equal(samples[:3, 6], [9.0, 9.0, 90.0])
    np.testing.assert_array_equal(passed, [0.06, 3.0])


def test_a_nut_at_rest_is_sampled_each_period_without_early_repeats():
    kept = []
    for apart in (0.24, 0.26, 1.0):
        samples = _samples([0.02, 0.02 + apart * PERIOD_S, 0.08], np.array([5.0, 5.0, 5.0]))
        kept.append(even_out(samples, 0, 3, _passed(0.0, 4.0), PERIOD_S))
    assert kept == [2, 3, 3]
    samples = _samples([0.024, 0.06], np.array([4.0, 5.0]))
    assert even_out(samples, 0, 2, _passed(0.02, 4.0), PERIOD_S) == 1, (
        "the last one of the step before counts"
    )
    assert samples[1, 0] == 5.0


def test_samples_before_the_last_step_are_left_out():
    samples = _samples([0.02, 0.019, 0.0201], np.array([1.0, 2.0, 3.0]))
    passed = _passed(0.02, 1.0)
    assert even_out(samples, 0, 3, passed, PERIOD_S) == 1
    assert samples[1, 0] == 3.0
    nothing = _samples([0.01, 0.02])
    assert even_out(nothing, 0, 2, passed, PERIOD_S) == 0
    np.testing.assert_array_equal(passed, [0.0201, 3.0])


def test_the_first_samples_of_all_are_a_period_apart():
    samples = _samples([0.1, 0.1001, 0.1002])
    assert even_out(samples, 0, 3, _passed(), PERIOD_S) == 3
    np.testing.assert_allclose(samples[0], [0.0602, 0.0802, 0.1002], rtol=0, atol=1e-12)


def test_more_than_periods_fit_in_share_the_time_since_the_last_step():
    samples = _samples([0.0098, 0.0099, 0.0199, 0.02])
    assert even_out(samples, 0, 4, _passed(0.0), PERIOD_S) == 4
    np.testing.assert_allclose(samples[0], [0.0049, 0.0099, 0.015, 0.02], rtol=0, atol=1e-12)
