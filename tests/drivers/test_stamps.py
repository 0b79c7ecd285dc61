"""The time of a frame, from stamps of clocks that wrap, step, drift or say nothing, and late arrivals."""

import itertools
import math

import pytest
from can import Message
from hypothesis import given
from hypothesis import strategies as st

from drivers.can_bus import SLCAN_TURN_S, stamp_of
from drivers.stamps import FURTHEST_S, DeviceClock, wall_time

PERIOD_S = 0.02
delays_s = st.lists(st.floats(0.0, 0.4), min_size=1, max_size=40)
clocks = st.floats(0.0, 1e5)


def arrivals(sent_s, held_s):
    """When frames arrive that are held up like this: none before the one sent before it."""
    return list(itertools.accumulate((s + h for s, h in zip(sent_s, held_s, strict=True)), max))


def late_s(clock, stamps_s, arrived_s, sent_s):
    """How much later than it was sent each frame is put, and how late it was."""
    times = [clock.time_s(stamp, arrival) for stamp, arrival in zip(stamps_s, arrived_s, strict=True)]
    return [time - sent for time, sent in zip(times, sent_s, strict=True)]


def sending(count, start_s=0.0):
    return [start_s + PERIOD_S * k for k in range(count)]


@given(st.lists(st.tuples(st.floats(allow_nan=True, allow_infinity=True), st.floats(0.0, 1.0)), max_size=60))
def test_whatever_the_stamp_no_time_is_after_the_arrival_or_far_before(frames):
    for clock in (DeviceClock(), DeviceClock(60.0)):
        arrival_s = 1e9
        for stamp_s, gap_s in frames:
            arrival_s += gap_s
            for time_s in (clock.time_s(stamp_s, arrival_s), wall_time(stamp_s, arrival_s, arrival_s)):
                assert arrival_s - FURTHEST_S <= time_s <= arrival_s


@given(delays_s, clocks, st.floats(-100e-6, 100e-6))
def test_held_up_frames_get_the_time_of_their_sending(held_s, zero_s, drift):
    """Two frames that came at once suffice; the drift of two crystals hardly shows."""
    sent = sending(20 + len(held_s))
    arrived = arrivals(sent, [0.0] * 20 + held_s)
    late = late_s(DeviceClock(), [zero_s + (1 + drift) * s for s in sent], arrived, sent)
    assert all(abs(s) < 1e-3 for s in late)


@given(delays_s, st.floats(0.0, SLCAN_TURN_S))
def test_a_counter_that_starts_again_each_minute_is_followed(held_s, zero_s):
    """The counter stands in whole milliseconds; a hold-up now and then, over its turn as well."""
    sent = sending(4000)
    held_s = (([0.0] * 50 + held_s) * 80)[: len(sent)]
    stamps = [math.floor(1e3 * ((zero_s + s) % SLCAN_TURN_S)) / 1e3 for s in sent]
    late = late_s(DeviceClock(SLCAN_TURN_S), stamps, arrivals(sent, held_s), sent)
    assert all(abs(s) < 3e-3 for s in late)


@given(st.sampled_from([-3600.0, -5.0, -0.5, 0.5, 5.0, 3600.0]), clocks)
def test_a_stamping_clock_that_is_set_displaces_times_for_no_longer_than_it_takes_to_see(step_s, zero_s):
    sent = sending(1500)
    stamps = [zero_s + s + (step_s if s >= 12.0 else 0.0) for s in sent]
    late = late_s(DeviceClock(), stamps, sent, sent)
    assert all(-abs(step_s) - 1e-6 <= s <= 1e-6 for s in late)
    wrong = [sent_s for sent_s, s in zip(sent, late, strict=True) if abs(s) > 1e-3]
    assert all(12.0 <= sent_s < 20.1 for sent_s in wrong)  # the rest of one block, and the next
    assert len(wrong) == 0 or abs(step_s) < FURTHEST_S


@pytest.mark.parametrize(
    "stamp",
    [lambda s: 0.0, lambda s: 1e9 - s, math.floor, lambda s: math.floor(10 * s) / 10, lambda s: math.nan],
    ids=["constant", "backwards", "whole seconds", "tenths", "none"],
)
def test_uninformative_stamps_leave_the_arrival_times(stamp):
    sent = sending(2000)
    late = late_s(DeviceClock(), [stamp(s) for s in sent], sent, sent)
    assert all(-0.021 <= s <= 0.0 for s in late)


def test_stamps_in_another_unit_leave_the_arrivals_after_a_while():
    sent = sending(2000)
    for factor in (1e-3, 1e3):
        late = late_s(DeviceClock(), [factor * s for s in sent], sent, sent)
        assert all(s == 0.0 for sent_s, s in zip(sent, late, strict=True) if sent_s > 10.1)


def test_one_wrong_stamp_displaces_no_other_frame():
    sent = sending(1000)
    stamps = list(sent)
    stamps[100], stamps[500] = 3.5, 9e9
    late = late_s(DeviceClock(), stamps, sent, sent)
    assert [k for k, s in enumerate(late) if abs(s) > 1e-6] == []


def test_a_device_that_says_nothing_for_ten_minutes_is_still_followed():
    clock = DeviceClock(SLCAN_TURN_S)
    sent = sending(100) + sending(100, 610.0)
    arrived = arrivals(sent, [0.0] * 120 + [0.1] * 80)
    assert max(late_s(clock, [s % SLCAN_TURN_S for s in sent], arrived, sent)) < 1e-6


@given(st.floats(0.0, 9.0), st.floats(-1e5, 1e5))
def test_a_stamp_of_this_computers_clock_is_as_old_as_the_clock_says(delay_s, stepped_s):
    """Whatever the clock was set to before, its difference to a fresh stamp is right."""
    sent_s, wall_s = 1000.0, 1.7e9 + stepped_s
    assert wall_time(wall_s - delay_s, sent_s + delay_s, wall_s) == pytest.approx(sent_s, abs=1e-6)


def test_a_clock_that_was_set_while_a_frame_waited_leaves_the_arrival():
    assert wall_time(1e9, 50.0, 1e9 - 3600.0) == 50.0
    assert wall_time(1e9, 50.0, 1e9 + 3600.0) == 50.0
    assert wall_time(0.0, 50.0, 1e9) == 50.0


@pytest.mark.parametrize(
    ("line", "stamp_s"),
    [
        ("t20121122\r", math.nan),
        ("t20121122EA5F\r", 59.999),
        ("t20121122EA60\r", math.nan),  # a minute has 60000 ms
        ("t20121122000\r", math.nan),
        ("t20121122zzzz\r", math.nan),
        ("T0000020121122001A\r", 0.026),
        ("T00000201211220012345\r", math.nan),
        ("r20120100\r", 0.256),
        ("", math.nan),
    ],
)
def test_an_slcan_line_ends_with_its_stamp(line, stamp_s):
    message = Message(is_extended_id=line.startswith("T"), is_remote_frame=line.startswith("r"), dlc=2)
    assert stamp_of(line, message) == pytest.approx(stamp_s, nan_ok=True)
