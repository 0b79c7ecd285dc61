"""Where a nut runs between the samples of its position, against the path itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from observer.frames import FloatArray, NutPath
from observer.kernels.path import FINE, SAMPLES_PER_TRAVERSE, on_the_way, take_sample
from observer.model.rod.moving import no_path_yet, reversals

LOW_M, HIGH_M = 0.15, 0.8
STROKE_M = HIGH_M - LOW_M


def shuttle_m(run_m: FloatArray) -> FloatArray:
    """The position after a way along a path that begins at the left end, to the right."""
    along = np.mod(run_m, 2 * STROKE_M)
    return LOW_M + np.minimum(along, 2 * STROKE_M - along)


def sense_of(run_m: float) -> float:
    return 1.0 if run_m % (2 * STROKE_M) < STROKE_M else -1.0


def end_before(run_m: float) -> float:
    """The end at which the nut turned last."""
    return LOW_M if sense_of(run_m) > 0 else HIGH_M


@given(st.floats(0.0, 1.0), st.floats(-20.0, 20.0), st.floats(0.01, 2.0), st.floats(-1.0, 1.0))
def test_a_nut_that_runs_on_is_where_small_steps_bring_it(
    share: float, run_m: float, length_m: float, low_m: float
) -> None:
    """`on_the_way` in closed form, against a walk in steps that turns at the ends."""
    here = low_m + share * length_m
    steps = 4000
    at, sense = here, float(np.sign(run_m)) or 1.0
    first = sense
    for _ in range(steps):
        at += sense * abs(run_m) / steps
        if not low_m <= at <= low_m + length_m:
            at = 2 * (low_m + length_m if at > low_m + length_m else low_m) - at
            sense = -sense
    there, same = on_the_way(here, run_m, low_m, low_m + length_m)
    assert there == pytest.approx(at, abs=1e-9)  # 4000 roundings of metres
    away = min(at - low_m, low_m + length_m - at)
    assume(away > 1e-9)  # on the very end either sense is right
    assert same == first * sense


@given(st.floats(3.0, 40.0), st.floats(0.0, 2 * STROKE_M), st.integers(0, 10**6))
def test_reversals_between_uneven_samples_are_found_where_they_are(
    samples_per_traverse: float, begin_m: float, seed: int
) -> None:
    """Straight steps are exact. A reversal is found to 6 % of its step if it is no nearer to a sample: a step
    that lacks less than 5 % counts as straight. Steps below a fiftieth of the stroke are lines.
    """
    speed_m_s, period_s = 0.2, STROKE_M / 0.2 / samples_per_traverse
    steps_s = period_s * np.random.default_rng(seed).uniform(0.4, 1.0, 120)
    time_s = np.concatenate([[0.0], np.cumsum(steps_s)])
    run_m = begin_m + speed_m_s * time_s
    position_m = shuttle_m(run_m)
    nut = no_path_yet()[0]
    take_sample(nut, time_s[0], position_m[0], np.nan, STROKE_M)
    known = False
    for k in range(1, len(time_s)):
        turn_m = take_sample(nut, time_s[k], position_m[k], np.nan, STROKE_M)
        into_m, step_m = run_m[k] % STROKE_M, run_m[k] - run_m[k - 1]
        if FINE * step_m <= STROKE_M:
            assert turn_m == position_m[k]
        elif run_m[k] // STROKE_M == run_m[k - 1] // STROKE_M:
            known = True  # it has shown its full speed: from now on every reversal can be found
            assert turn_m == position_m[k]
            assert nut.velocity_m_s == pytest.approx(sense_of(run_m[k]) * speed_m_s, rel=1e-6)
        elif known and min(into_m, step_m - into_m) > 0.06 * step_m:
            assert turn_m == pytest.approx(end_before(run_m[k]), abs=0.06 * step_m)
            assert np.sign(nut.velocity_m_s) == sense_of(run_m[k])
    assert known


def test_the_ends_of_the_stroke_are_learnt() -> None:
    time_s = np.arange(0.0, 60.0, 0.5)
    position_m = shuttle_m(0.13 * time_s)
    offset, unknown = np.arange(len(time_s) + 1), np.full(len(time_s), np.nan)
    state, ends_m = reversals(no_path_yet(), NutPath(time_s, position_m, offset, unknown, unknown), STROKE_M)
    assert np.isnan(ends_m[0]).all()
    np.testing.assert_allclose(ends_m[-1], [LOW_M, HIGH_M], atol=1e-9)
    assert [state[0].low_m, state[0].high_m] == pytest.approx([LOW_M, HIGH_M])
    # in parts it is the same, to the last bit
    half = 37
    first_path = NutPath(time_s[:half], position_m[:half], offset[: half + 1], unknown[:half], unknown[:half])
    first, a = reversals(no_path_yet(), first_path, STROKE_M)
    rest = NutPath(time_s[half:], position_m[half:], offset[half:] - half, unknown[half:], unknown[half:])
    second, b = reversals(first, rest, STROKE_M)
    np.testing.assert_array_equal(np.vstack([a, b]), ends_m)
    np.testing.assert_equal(second.tobytes(), state.tobytes())


@given(st.floats(4.0, 200.0))
def test_after_a_late_sample_the_nut_is_known_to_run_the_right_way(late_s: float) -> None:
    speed_m_s = 0.13
    time_s = np.append(np.arange(0.0, 40.0, 0.5), 39.5 + late_s)
    run_m = speed_m_s * time_s
    late = max(late_s * speed_m_s * SAMPLES_PER_TRAVERSE, 0.0) > STROKE_M
    assume(late)
    nut = no_path_yet()[0]
    for at_s, at_m in zip(time_s, shuttle_m(run_m), strict=True):
        turn_m = take_sample(nut, at_s, at_m, np.nan, STROKE_M)
    assert np.isnan(turn_m)  # it cannot be known from the sample
    away_m = min(run_m[-1] % STROKE_M, STROKE_M - run_m[-1] % STROKE_M)
    assume(away_m > 1e-6)
    assert nut.velocity_m_s == pytest.approx(sense_of(run_m[-1]) * speed_m_s, rel=1e-6)
    following_s = time_s[-1] + min(0.5, 0.5 * away_m / speed_m_s)
    at_m = float(shuttle_m(np.array(speed_m_s * following_s)))
    assert take_sample(nut, following_s, at_m, np.nan, STROKE_M) == pytest.approx(at_m)


# ---- what is remembered, believed and forgotten, sample by sample ----


def follow(
    samples: list[tuple[float, float]], stroke_m: float, driven_m_s: list[float] | float = np.nan
) -> tuple[Any, list[float]]:
    """The state after samples (time, place), and where the nut turned before each."""
    nut, driven = no_path_yet()[0], np.broadcast_to(driven_m_s, len(samples))
    return nut, [
        take_sample(nut, at_s, at_m, float(v), stroke_m)
        for (at_s, at_m), v in zip(samples, driven, strict=True)
    ]


def test_a_first_sample_shows_nothing_and_the_same_moment_again_no_way() -> None:
    _, turned = follow([(5.0, 0.2), (5.0, 0.3), (4.0, 0.4)], STROKE_M)
    assert np.isnan(turned[0])
    assert turned[1:] == [0.3, 0.4]


@pytest.mark.parametrize(
    ("driven_m_s", "last_m"),
    [
        ([0.2, 0.2, 0.2], 0.6),  # 0.1 m of way: 0.05 there, 0.05 back
        ([0.2, 0.2, 0.4], 0.55),  # 0.15 m in the mean of both ends
        ([0.2, 0.2, np.nan], 0.6),
        ([0.2, np.nan, 0.2], 0.6),
        ([np.nan, np.nan, np.nan], 0.6),  # 0.2 m/s is what it made before
    ],
)
def test_the_way_is_by_the_speed_at_both_ends_of_a_step(driven_m_s: list[float], last_m: float) -> None:
    state, turned = follow([(0.0, 0.5), (0.5, 0.6), (1.0, last_m)], STROKE_M, driven_m_s)
    assert turned[1:] == pytest.approx([0.6, 0.65])
    assert state.velocity_m_s == pytest.approx(
        -np.nanmean([*driven_m_s[1:], 0.2][: 2 + np.isnan(driven_m_s[2])])
    )


@pytest.mark.parametrize(("made", "straight"), [(0.951, True), (0.949, False)])
def test_a_step_of_nearly_its_whole_way_is_straight(made: float, straight: bool) -> None:
    there_m = 0.3 + 0.1 * made
    state, turned = follow([(0.0, 0.2), (0.5, 0.3), (1.0, there_m)], STROKE_M, 0.2)
    assert (turned[-1] == there_m) == straight
    assert state.velocity_m_s == pytest.approx(0.2 if straight else -0.2)


def test_a_nut_that_rests_stands_and_then_runs_again() -> None:
    state, turned = follow([(0.0, 0.3), (0.5, 0.3)], STROKE_M, 0.2)
    assert (turned[-1], state.velocity_m_s) == (0.3, 0.0)
    state, turned = follow([(0.0, 0.3), (0.5, 0.3), (1.0, 0.35), (1.5, 0.45)], STROKE_M, 0.2)
    assert turned[-2:] == [0.35, 0.45], "at half its speed, from rest, nobody knows of a reversal"
    assert state.velocity_m_s == pytest.approx(0.2)


@given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=40))
def test_the_full_speed_is_the_fourth_of_sixteen(made_m_s: list[float]) -> None:
    """Of fewer it is the first, the second from four on and the third from eight on."""
    times_s, places_m = np.arange(len(made_m_s) + 1.0), np.concatenate([[0.0], np.cumsum(made_m_s)])
    state, _ = follow(list(zip(times_s, places_m, strict=True)), 1e3)
    lately = sorted(np.diff(places_m)[-16:], reverse=True)
    assert state.speed_m_s == lately[min(4, 1 + len(lately) // 4) - 1]
    assert state.count == len(made_m_s)


@pytest.mark.parametrize(("since_s", "count"), [(0.0099, 1), (0.0101, 2)])
def test_samples_closer_than_ten_milliseconds_show_no_speed(since_s: float, count: int) -> None:
    state, _ = follow([(0.0, 0.0), (0.5, 0.1), (0.5 + since_s, 0.2)], 1e3)
    assert state.count == count
    assert state.speed_m_s == pytest.approx(0.2 if count == 1 else 0.1 / since_s)


@pytest.mark.parametrize(("part", "believed"), [(0.72, True), (0.68, False)])
@pytest.mark.parametrize(("steps", "known"), [(15, False), (16, True)])
def test_a_lead_that_is_not_that_of_this_nut_is_not_believed(
    steps: int, known: bool, part: float, believed: bool
) -> None:
    """From the sixteenth step on what the nut makes counts, if it is below seven tenths of speed × lead."""
    samples = [(0.5 * k, 0.1 * k) for k in range(steps + 1)]
    state, _ = follow(samples, 4.0, 0.2 / part)
    assert state.speed_m_s == pytest.approx(0.2 if known and not believed else 0.2 / part)
    assert state.velocity_m_s == pytest.approx(0.2 if known and not believed else 0.0)


@pytest.mark.parametrize(("back", "end"), [(3, False), (5, True)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_place_from_which_it_only_swings_back_a_little_is_no_end(side: float, back: int, end: bool) -> None:
    """Steps of half a hundredth of the stroke; two hundredths are needed."""
    steps = [*range(21), *range(19, 19 - back, -1), *range(21 - back, 30)]
    samples = [(0.1 * k, side * 0.005 * step) for k, step in enumerate(steps)]
    state, _ = follow(samples, 1.0)
    ends = [state.high_m, state.low_m] if side > 0 else [state.low_m, state.high_m]
    expected = [side * 0.1, side * 0.005 * (20 - back)] if end else [np.nan, np.nan]
    np.testing.assert_allclose(ends, expected, atol=1e-12)


def shuttled(late_s: float, driven_m_s: float = np.nan) -> FloatArray:
    """The state after forty seconds to and fro at 0.13 m/s, and a sample that comes late."""
    time_s = np.append(np.arange(0.0, 40.0, 0.5), 39.5 + late_s)
    samples = list(zip(time_s.tolist(), shuttle_m(0.13 * time_s).tolist(), strict=True))
    driven = [np.nan] * (len(samples) - 1) + [driven_m_s]
    state, _ = follow(samples, STROKE_M, driven)
    return state


def test_after_an_hour_nobody_knows_how_a_nut_runs() -> None:
    state = shuttled(3599.0)
    assert abs(state.velocity_m_s) == pytest.approx(0.13)
    state = shuttled(3601.0)
    assert (state.velocity_m_s, state.sense) == (0.0, 0.0)
    assert (state.low_m, state.high_m) == pytest.approx((LOW_M, HIGH_M)), "its ends it may still have"


@pytest.mark.parametrize("late_s", [7.0, 11.0, 14.0, 23.0])
def test_over_a_gap_the_speed_that_is_known_counts(late_s: float) -> None:
    state = shuttled(late_s, 0.26)
    assert abs(state.velocity_m_s) == pytest.approx(0.26)
    before_m = float(shuttle_m(np.array(0.13 * 39.5)))
    first = sense_of(0.13 * 39.5)
    _, same = on_the_way(before_m, first * 0.26 * late_s, LOW_M, HIGH_M)
    assert np.sign(state.velocity_m_s) == same * first
    assert state.sense == np.sign(state.velocity_m_s)


def test_small_steps_turn_at_once_and_keep_their_speed_when_slow() -> None:
    """Below a fiftieth of the stroke a line is good enough."""
    stroke_m = 10.0
    forth = [(0.1 * k, 0.02 * k) for k in range(11)]
    state, turned = follow([*forth, (1.1, 0.19)], stroke_m)
    assert state.velocity_m_s < 0.0, "it has turned"
    assert turned[-1] == 0.19
    state, turned = follow([*forth, (1.1, 0.21)], stroke_m)
    assert state.velocity_m_s == pytest.approx(0.2), "it only slows down"
    assert turned[-1] == 0.21


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("begin_m", [-0.5, 0.0, 0.5])
def test_where_it_was_first_seen_is_no_end(begin_m: float, side: float) -> None:
    state, _ = follow([(0.1 * k, begin_m + side * 0.01 * k) for k in range(40)], 1.0)
    assert np.isnan([state.low_m, state.high_m]).all()
    assert state.sense == side
