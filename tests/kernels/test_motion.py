"""A nut's samples that were held up on their way, as a busy gateway or computer does it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from observer.align.aligner import Aligner, AlignPlan
from observer.estimators.selftest import MOTION_STEP, no_motion_yet, smallest_jump_m
from observer.frames import FloatArray, FrameBlock, NutPath, Reading
from observer.installation import parse
from observer.kernels import compare_ways, record
from observer.kernels.layout import Records
from observer.kernels.selftest import DISAGREE, FALLS_SHORT
from tests.logs.machines import machine_table

EVERY_S, LOW_m, STROKE_m = 0.02, 0.2, 0.4


def _runs(
    speed_m_s: float, seconds: float, every_s: float = EVERY_S
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, places and speeds of a nut that runs to and fro and stands for a second at each end."""
    time_s = np.arange(0.0, seconds, every_s)
    run_s = STROKE_m / speed_m_s
    part = time_s % (2.0 * (run_s + 1.0))
    there = np.clip(part * speed_m_s, 0.0, STROKE_m)
    place_m = LOW_m + np.where(
        part < run_s + 1.0, there, STROKE_m - np.clip((part - run_s - 1.0) * speed_m_s, 0.0, STROKE_m)
    )
    moving = (part < run_s) | ((part >= run_s + 1.0) & (part < 2.0 * run_s + 1.0))
    return time_s, place_m, np.where(moving, speed_m_s, 0.0)


def _held_up(time_s: FloatArray, rng: np.random.Generator, apart_s: float) -> FloatArray:
    """When the samples come, NaN for never: for up to a second none does, then all that waited.

    They come `apart_s` apart; with NaN only the first of them does, as where a frame waits to be sent.
    """
    come_s = time_s.copy()
    for begin in rng.choice(len(time_s) // 150, 8, replace=False) * 150 + 40:
        waited_s = until_s = time_s[begin] + rng.uniform(0.1, 1.0)
        for i in range(begin, len(time_s)):
            if time_s[i] >= waited_s or (np.isnan(apart_s) and time_s[i] >= until_s):
                break
            come_s[i] = waited_s
            waited_s += apart_s
    return come_s


def _compared(come_s: FloatArray, place_m: FloatArray, speed_m_s: FloatArray) -> Records:
    """What is said of the nut's motion after each sample, (n,)."""
    n, memory = len(come_s), no_motion_yet()
    motion, travel_m = np.empty(n, MOTION_STEP), np.array([LOW_m, LOW_m + STROKE_m])
    offset = np.arange(n + 1, dtype=np.intp)
    path = NutPath(come_s, place_m, offset, speed_m_s, np.zeros(n))
    compare_ways(record(path), travel_m, memory, motion, np.zeros(n, np.int8))
    assert memory[0].jump_m == motion[-1].jump_m
    return motion


def _leap_m(come_s: FloatArray, place_m: FloatArray, speed_m_s: FloatArray) -> FloatArray:
    """By how much the position has leapt, after each sample."""
    return _compared(come_s, place_m, speed_m_s)["jump_m"]


@pytest.mark.parametrize("speed_m_s", [0.05, 0.15, 0.5])
@pytest.mark.parametrize("apart_s", [0.0002, 0.004, np.nan])
@pytest.mark.parametrize("seed", range(10))
def test_samples_that_come_late_are_no_leap(speed_m_s, apart_s, seed):
    rng = np.random.default_rng(seed)
    time_s, place_m, driven_m_s = _runs(speed_m_s, 60.0)
    come_s = _held_up(time_s, rng, apart_s)
    there = np.isfinite(come_s)
    assert np.nanmax(come_s - time_s) > 0.3
    assert not _leap_m(come_s[there], place_m[there], driven_m_s[there]).any()


@pytest.mark.parametrize("speed_m_s", [0.05, 0.25, 0.5])
@pytest.mark.parametrize("lasts_s", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(10))
def test_nor_are_samples_that_are_late_by_less_than_the_time_between_them(speed_m_s, lasts_s, seed):
    """One at a time or several in a row, as from a program that a busy computer lets run too late."""
    rng = np.random.default_rng(seed)
    time_s, place_m, driven_m_s = _runs(speed_m_s, 120.0, every_s=0.05)
    late_s = np.zeros_like(time_s)
    for begin in rng.choice(np.arange(5, len(time_s) - 10), 60, replace=False):
        late_s[begin : begin + 1 + int(lasts_s / 0.05)] = rng.uniform(0.0, 0.0499)
    come_s = np.maximum.accumulate(time_s + late_s)
    assert not _leap_m(come_s, place_m, driven_m_s).any()


@pytest.mark.parametrize("speed_m_s", [0.05, 0.15, 0.5])
@pytest.mark.parametrize("polls", [2, 4])
@pytest.mark.parametrize("seed", range(10))
def test_nor_is_a_server_that_catches_up_after_a_pause(speed_m_s, polls, seed):
    """It stops for a second, and its first answers after that are old, each by less than the one before."""
    rng = np.random.default_rng(seed)
    time_s, place_m, driven_m_s = _runs(speed_m_s, 120.0, every_s=0.05)
    old_s, present = np.zeros_like(time_s), np.ones(len(time_s), np.bool_)
    for begin in rng.choice(len(time_s) // 150, 8, replace=False) * 150 + 100:
        paused = rng.integers(8, 25)
        present[begin : begin + paused] = False
        first = begin + paused
        old_s[first : first + polls] = (
            0.05 * paused * (1.0 - np.arange(polls) / polls) * rng.uniform(0.5, 1.0)
        )
    read_m = np.interp(time_s - old_s, time_s, place_m)
    assert not _leap_m(time_s[present], read_m[present], driven_m_s[present]).any()


LEAD_m, TICK_S = 0.01, 0.1


def _aligned(
    sent_s: FloatArray, come_s: FloatArray, place_m: FloatArray, speed_m_s: FloatArray
) -> list[FrameBlock]:
    """The frames of ticks to which the samples come by a wire that is known for its period only."""
    config = parse(
        machine_table("nut", source__0__lead_m=LEAD_m, source__0__stroke_m=[LOW_m, LOW_m + STROKE_m])
    )
    plan = AlignPlan.of(config)
    aligner = Aligner(replace(plan, expected_s=np.full(len(plan.expected_s), EVERY_S)))
    order = np.argsort(come_s, kind="stable")
    frames, taken = [], 0
    for tick_s in np.arange(TICK_S, sent_s[-1], TICK_S):
        while taken < len(order) and come_s[order[taken]] <= tick_s:
            i = order[taken]
            values = {"nut_position_m": place_m[i], "screw_speed_rpm": 60.0 * speed_m_s[i] / LEAD_m}
            aligner.ingest(Reading(float(come_s[i]), {name: float(v) for name, v in values.items()}))
            taken += 1
        frames.append(aligner.tick(float(tick_s)))
    return frames


@pytest.mark.parametrize("speed_m_s", [0.15, 0.25, 0.5])
@pytest.mark.parametrize("missed", [0.0, 0.4])
@pytest.mark.parametrize("seed", range(30))
def test_nor_are_samples_held_on_a_wire_that_come_at_once_or_in_two_steps(speed_m_s, missed, seed):
    """They are taken for one a period, although the sender may have missed some of them meanwhile."""
    rng = np.random.default_rng(seed)
    time_s, place_m, driven_m_s = _runs(speed_m_s, 60.0)
    sent, come_s = np.ones(len(time_s), np.bool_), time_s.copy()
    for begin in rng.choice(len(time_s) // 150, 8, replace=False) * 150 + 40:
        held = np.arange(begin, begin + rng.integers(30, 65))
        sent[held] = rng.random(len(held)) >= missed
        # all wait for the last of them; a tick may come while they are taken
        tick_s = TICK_S * np.ceil(time_s[held[-1]] / TICK_S)
        split = rng.integers(0, len(held))
        come_s[held] = tick_s - 1e-3 + 1e-6 * np.arange(len(held))
        come_s[held[split:]] += 2e-3
    come_s = np.maximum.accumulate(come_s)  # a wire keeps the order
    frames = _aligned(time_s[sent], come_s[sent], place_m[sent], driven_m_s[sent])
    memory, motion = no_motion_yet(), np.empty(1, MOTION_STEP)
    for frame in frames:
        path = record(frame.path["nut_position_m"])
        compare_ways(path, np.array([LOW_m, LOW_m + STROKE_m]), memory, motion, np.zeros(1, np.int8))
        assert motion[0].jump_m == 0.0


@pytest.mark.parametrize("speed_m_s", [0.05, 0.15, 0.5])
@pytest.mark.parametrize("leap_m", [0.05, -0.05])
def test_a_leap_between_such_pauses_is_found_at_once(speed_m_s, leap_m):
    time_s, place_m, driven_m_s = _runs(speed_m_s, 60.0)
    come_s = _held_up(time_s, np.random.default_rng(1), 0.0002)
    at = 1750 + 120  # between two times at which a pause may begin, and after the longest
    place_m[at:] += leap_m
    found_m = _leap_m(come_s, place_m, driven_m_s)
    assert not found_m[:at].any()
    assert found_m[at + 50 :] == pytest.approx(leap_m, abs=0.012)


def _jumps_m(
    every_s: float, place_m: list[float], speed_m_s: list[float], at_s: list[float] | None = None
) -> FloatArray:
    """The sum of jumps after samples that follow a minute of runs and a rest at the lower end."""
    time_s, before_m, driven_m_s = _runs(0.3, 60.0, every_s)
    steps_s = every_s * np.arange(1, len(place_m) + 1) if at_s is None else np.array(at_s)
    standing = np.full(20, LOW_m)
    rest_s = time_s[-1] + every_s * np.arange(1, 21)
    return _leap_m(
        np.concatenate([time_s, rest_s, rest_s[-1] + steps_s]),
        np.concatenate([before_m[:-1], [LOW_m], standing, LOW_m + np.array(place_m)]),
        np.concatenate([driven_m_s[:-1], np.zeros(21), speed_m_s]),
    )[-len(place_m) :]


RPM_m_s = 0.012 / 60.0


@pytest.mark.parametrize(
    ("every_s", "place_m", "speed_m_s"),
    [
        (0.1, [0.010, 0.054, 0.06, 0.06], [1035 * RPM_m_s, 1058 * RPM_m_s, 0.0, 0.0]),
        (0.1, [0.02, 0.02], [0.0, 0.0]),
        (0.2, [0.09, 0.09], [0.0, 0.0]),
        (0.5, [0.3, 0.0, 0.3], [0.0, 0.0, 0.0]),
        (0.02, [0.0009, 0.0045, 0.01], [0.1, 0.3, 0.4]),
    ],
)
def test_a_move_that_is_fast_between_two_polls_is_no_jump(every_s, place_m, speed_m_s):
    """A reposition of 44 mm in 0.1 s; whole moves between polls of standstill; a start at 1 g."""
    assert not _jumps_m(every_s, place_m, speed_m_s).any()


@pytest.mark.parametrize("every_s", [0.02, 0.1, 0.5])
def test_a_process_that_was_stopped_for_a_minute_sees_no_jump(every_s):
    """The last answer before the stop is stamped after it, or the first one after it comes late."""
    places_m, speeds_m_s = [0.0, 0.25, 0.25, 0.25], [0.0, 0.0, 0.0, 0.0]
    assert not _jumps_m(every_s, places_m, speeds_m_s, [60.0, 60.0 + every_s / 2, 61.0, 62.0]).any()
    assert not _jumps_m(every_s, places_m, speeds_m_s, [every_s, 60.0, 60.0 + every_s, 61.0]).any()


def test_polls_in_step_with_a_motion_to_and_fro_do_not_disagree_with_its_speed():
    """Each poll finds the nut at rest at the other end of a move, while its program runs between them."""
    before_s, before_m, driven_m_s = _runs(0.3, 60.0, 0.5)
    polls = np.arange(80)
    time_s = np.concatenate([before_s, before_s[-1] + 0.5 * (1 + polls)])
    place_m = np.concatenate([before_m, LOW_m + 0.3 * (polls % 2)])
    ratio = _compared(time_s, place_m, np.concatenate([driven_m_s, np.zeros(80)]))["ratio"]
    assert not (ratio > DISAGREE).any()
    assert not (ratio < FALLS_SHORT).any()


def test_a_way_of_twice_what_the_speed_allows_disagrees_with_it():
    time_s, place_m, driven_m_s = _runs(0.3, 60.0)
    assert _compared(time_s, place_m, 0.5 * driven_m_s)[-1].ratio > DISAGREE


@pytest.mark.parametrize("every_s", [0.01, 0.02, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_reference_lost_at_rest_is_found_from_the_smallest_jump_on(every_s, sense):
    smallest_m = smallest_jump_m(every_s)
    lost = sense * (smallest_m + 0.001)
    assert _jumps_m(every_s, [lost, lost], [0.0, 0.0]) == pytest.approx(lost)
    assert not _jumps_m(every_s, [lost - 0.002 * sense] * 2, [0.0, 0.0]).any()


def test_a_jump_ends_when_the_position_jumps_back():
    assert _jumps_m(0.02, [0.05, 0.05, 0.05, 0.0, 0.0], [0.0] * 5) == pytest.approx(
        [0.05, 0.05, 0.05, 0.0, 0.0]
    )


def test_a_jump_that_would_place_the_nut_beyond_its_travel_was_motion():
    """After a real jump of 0.1 m up the nut could not come back to the lower end of its travel."""
    down_m = np.linspace(0.1, 0.0, 60).tolist()
    jumps_m = _jumps_m(0.02, [0.1, *down_m], [0.0, *[0.085] * 60])
    assert jumps_m[0] == pytest.approx(0.1)
    assert jumps_m[1:20] == pytest.approx(0.1)
    assert jumps_m[-1] == 0.0
