"""A nut's samples that were held up on their way, as a busy gateway or computer does it."""

from __future__ import annotations

import numpy as np
import pytest

from observer.frames import FloatArray
from observer.kernels import compare_ways
from observer.kernels.selftest import LEAP, OF_MOTION

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


def _leap_m(come_s: FloatArray, place_m: FloatArray, speed_m_s: FloatArray) -> FloatArray:
    """By how much the position has leapt, after each sample."""
    memory = np.concatenate([np.zeros(2), np.full(3, np.nan), np.zeros(OF_MOTION - 5)])
    leap_m, ratio = np.empty(len(come_s)), np.empty(len(come_s))
    each = np.arange(len(come_s) + 1, dtype=np.intp)
    compare_ways(
        come_s, place_m, each, speed_m_s, STROKE_m, memory, ratio, leap_m, np.zeros(len(come_s), np.int8)
    )
    assert memory[LEAP] == leap_m[-1]
    return leap_m


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
@pytest.mark.parametrize("leap_m", [0.05, -0.05])
def test_a_leap_between_such_pauses_is_found_at_once(speed_m_s, leap_m):
    time_s, place_m, driven_m_s = _runs(speed_m_s, 60.0)
    come_s = _held_up(time_s, np.random.default_rng(1), 0.0002)
    at = 1750 + 120  # between two times at which a pause may begin, and after the longest
    place_m[at:] += leap_m
    found_m = _leap_m(come_s, place_m, driven_m_s)
    assert not found_m[:at].any()
    assert found_m[at + 50 :] == pytest.approx(leap_m, abs=0.012)
