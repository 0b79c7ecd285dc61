"""Where a nut runs between the samples of its position, against the path itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from observer.frames import FloatArray, NutPath
from observer.model.rod.path import FINE, SAMPLES_PER_TRAVERSE, PathState, advance, on_the_way, reversals

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


@settings(deadline=None)  # the first call compiles
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


@settings(deadline=None)  # the first call compiles
@given(st.floats(3.0, 40.0), st.floats(0.0, 2 * STROKE_M), st.integers(0, 10**6))
def test_reversals_between_uneven_samples_are_found_where_they_are(
    samples_per_traverse: float, begin_m: float, seed: int
) -> None:
    """Straight steps are told exactly. A reversal is told to 6 % of its step, if it is no nearer to a sample:
    a step that lacks less than 5 % counts as straight. Steps below a fiftieth of the stroke are lines.
    """
    speed_m_s, period_s = 0.2, STROKE_M / 0.2 / samples_per_traverse
    steps_s = period_s * np.random.default_rng(seed).uniform(0.4, 1.0, 120)
    time_s = np.concatenate([[0.0], np.cumsum(steps_s)])
    run_m = begin_m + speed_m_s * time_s
    position_m = shuttle_m(run_m)
    scalars = PathState().scalars
    advance(scalars, time_s[0], position_m[0], np.nan, STROKE_M)
    known = False
    for k in range(1, len(time_s)):
        turn_m = advance(scalars, time_s[k], position_m[k], np.nan, STROKE_M)
        into_m, step_m = run_m[k] % STROKE_M, run_m[k] - run_m[k - 1]
        if FINE * step_m <= STROKE_M:
            assert turn_m == position_m[k]
        elif run_m[k] // STROKE_M == run_m[k - 1] // STROKE_M:
            known = True  # it has shown its full speed: from now on every reversal can be told
            assert turn_m == position_m[k]
            assert scalars[2] == pytest.approx(sense_of(run_m[k]) * speed_m_s, rel=1e-6)
        elif known and min(into_m, step_m - into_m) > 0.06 * step_m:
            assert turn_m == pytest.approx(end_before(run_m[k]), abs=0.06 * step_m)
            assert np.sign(scalars[2]) == sense_of(run_m[k])
    assert known


def test_the_ends_of_the_stroke_are_learnt() -> None:
    time_s = np.arange(0.0, 60.0, 0.5)
    position_m = shuttle_m(0.13 * time_s)
    offset, unknown = np.arange(len(time_s) + 1), np.full(len(time_s), np.nan)
    state, ends_m = reversals(PathState(), NutPath(time_s, position_m, offset, unknown), STROKE_M)
    assert np.isnan(ends_m[0]).all()
    np.testing.assert_allclose(ends_m[-1], [LOW_M, HIGH_M], atol=1e-9)
    assert state.scalars[4:6] == pytest.approx([LOW_M, HIGH_M])
    # in parts it is the same, to the last bit
    half = 37
    first, a = reversals(
        PathState(), NutPath(time_s[:half], position_m[:half], offset[: half + 1], unknown[:half]), STROKE_M
    )
    rest = NutPath(time_s[half:], position_m[half:], offset[half:] - half, unknown[half:])
    second, b = reversals(first, rest, STROKE_M)
    np.testing.assert_array_equal(np.vstack([a, b]), ends_m)
    np.testing.assert_array_equal(second.scalars, state.scalars)


@settings(deadline=None)  # the first call compiles
@given(st.floats(4.0, 200.0))
def test_after_a_late_sample_the_nut_is_known_to_run_the_right_way(late_s: float) -> None:
    speed_m_s = 0.13
    time_s = np.append(np.arange(0.0, 40.0, 0.5), 39.5 + late_s)
    run_m = speed_m_s * time_s
    late = max(late_s * speed_m_s * SAMPLES_PER_TRAVERSE, 0.0) > STROKE_M
    assume(late)
    scalars = PathState().scalars
    for at_s, at_m in zip(time_s, shuttle_m(run_m), strict=True):
        turn_m = advance(scalars, at_s, at_m, np.nan, STROKE_M)
    assert np.isnan(turn_m)  # it cannot be told from the sample
    away_m = min(run_m[-1] % STROKE_M, STROKE_M - run_m[-1] % STROKE_M)
    assume(away_m > 1e-6)
    assert scalars[2] == pytest.approx(sense_of(run_m[-1]) * speed_m_s, rel=1e-6)
    following_s = time_s[-1] + min(0.5, 0.5 * away_m / speed_m_s)
    at_m = float(shuttle_m(np.array(speed_m_s * following_s)))
    assert advance(scalars, following_s, at_m, np.nan, STROKE_M) == pytest.approx(at_m)
