"""The compensation: its line and table, its limits, its latch, its documents, and who may switch it on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from observer.config import Config
from observer.control import compensation
from observer.control.compensation import CompensationPlan, CompensationState
from observer.control.compensator import Compensator
from observer.errors import ConfigError
from observer.frames import EstimateBlock, FloatArray, FrameBlock, Layout
from observer.installation import parse
from tests.logs.machines import table
from tests.logs.simulated import frames
from tests.publish.blocks import block

ON = {"enabled": True, "controller_compensates": False, "position_feedback": "motor"}
GRID = np.linspace(0.0, 0.4, 9)
LAYOUT = Layout(("nut",), GRID, ("a",), True)


def machine(**keys: Any) -> Config:
    return with_tables({}, **keys)


def with_tables(tables: dict[str, Any], **keys: Any) -> Config:
    nut = {"name": "nut", "shape": "nut", "length_m": 0.05, "stroke_m": [0.1, 0.3], "position_channel": "x_m"}
    made = table(source=[nut], compensation=ON | keys)
    return parse(made | {"screw": made["screw"] | {"expansion_1_K": 11.8e-6}} | tables)


def estimate(
    error_um: FloatArray, time_s: float = 100.0, quality: int = 0, bound_um: float = 3.0
) -> EstimateBlock:
    made = block(time_s, quality=quality, layout=LAYOUT)
    return replace(
        made,
        error_um=error_um[None, :],
        error_sigma_um=np.full((1, len(GRID)), 0.5),
        error_bound_um=np.full((1, len(GRID)), bound_um),
    )


def followed(
    plan: CompensationPlan, error_um: FloatArray, seconds: float, state: CompensationState | None = None
):
    """The state after estimates of one error, one every half second."""
    state = compensation.initial(plan) if state is None else state
    begin = 0.0 if np.isnan(state.time_s) else state.time_s
    for time_s in np.arange(begin + 0.5, begin + seconds + 0.6, 0.5):
        state = compensation.advance(plan, state, estimate(error_um, time_s), GRID, arm=not state.armed)
    return state


def test_the_line_is_the_least_squares_line_about_the_reference() -> None:
    plan = compensation.plan_of(machine(zero_m=0.05, reference_m=0.12, gradient_limit_um_m=1e6))
    np.testing.assert_allclose(plan.machine_m, np.linspace(0.1, 0.3, 21) - 0.05)
    curve = 900.0 * plan.screw_m**2
    line = compensation.line_of(plan, curve)
    slope, at_zero = np.polyfit(plan.machine_m, curve, 1)
    assert line.slope_um_m == pytest.approx(slope)
    assert line.offset_um == pytest.approx(at_zero + slope * (0.12 - 0.05))


def test_a_straight_error_is_found_again_in_both_directions() -> None:
    for reverse, sign in ((False, 1.0), (True, -1.0)):
        plan = compensation.plan_of(machine(reverse=reverse, rate_limit_um_s=100.0, gradient_limit_um_m=1e6))
        state = followed(plan, 3.0 + 120.0 * GRID, 3.0)
        line = compensation.line_through(plan, state.ends_um)
        # where the screw and the machine run against each other the error turns its sign, its slope does not
        assert line.slope_um_m == pytest.approx(120.0)
        assert line.offset_um == pytest.approx(sign * (3.0 + 120.0 * 0.2))
        assert plan.reference_m == pytest.approx(sign * 0.2)
        assert not state.limited


values = arrays(float, 21, elements=st.floats(-80, 80))


@given(now=values, wanted=values, limit=st.floats(1.0, 2000.0), rate=st.floats(0.01, 50.0))
def test_neither_rate_nor_gradient_is_ever_exceeded(
    now: FloatArray, wanted: FloatArray, limit: float, rate: float
) -> None:
    plan = compensation.plan_of(machine(gradient_limit_um_m=limit))
    before, goal = compensation.within_gradient(plan, now), compensation.within_gradient(plan, wanted)
    assert goal[plan.reference] == wanted[plan.reference]
    after = compensation.toward(before, goal, rate)
    assert np.abs(after - before).max() <= rate * (1 + 1e-12)
    for values_um in (goal, after):
        assert np.abs(np.diff(values_um) / np.diff(plan.machine_m)).max() <= limit * (1 + 1e-9) + 1e-9
    np.testing.assert_allclose(compensation.toward(before, goal, 1e6), goal, atol=1e-9)


@given(now=values, wanted=values, limit=st.floats(1.0, 2000.0), seconds=st.floats(0.01, 0.9))
def test_the_line_keeps_the_limits_everywhere_in_the_travel(
    now: FloatArray, wanted: FloatArray, limit: float, seconds: float
) -> None:
    plan = compensation.plan_of(machine(gradient_limit_um_m=limit, rate_limit_um_s=3.0))

    def ends(values_um: FloatArray) -> FloatArray:
        line = compensation.line_of(plan, values_um)
        return line.offset_um + line.slope_um_m * (plan.machine_m[[0, -1]] - plan.reference_m)

    state = CompensationState(None, 10.0, np.zeros(21), ends(now))
    error_um = np.interp(GRID, plan.screw_m, wanted)
    state = compensation.advance(plan, state, estimate(error_um, 10.0 + seconds), GRID)
    line = compensation.line_through(plan, state.ends_um)
    assert abs(line.slope_um_m) <= limit * (1 + 1e-9) + 1e-9
    assert np.abs(state.ends_um - ends(now)).max() <= 3.0 * seconds * (1 + 1e-9)


def test_it_starts_from_zero_and_goes_at_its_rate() -> None:
    plan = compensation.plan_of(machine(rate_limit_um_s=2.0))
    error_um = np.full(9, 30.0)
    state = compensation.advance(plan, compensation.initial(plan), estimate(error_um, 100.0), GRID, arm=True)
    assert state.armed
    assert state.limited
    np.testing.assert_array_equal(state.table_um, 0.0)
    state = compensation.advance(plan, state, estimate(error_um, 100.5), GRID)
    np.testing.assert_allclose(state.table_um, 1.0)
    np.testing.assert_allclose(state.ends_um, 1.0)
    state = followed(plan, error_um, 20.0, state)
    np.testing.assert_allclose(state.table_um, 30.0)
    assert not state.limited


@pytest.mark.parametrize("quality", [1, 2, 3])
def test_anything_but_good_switches_it_off_until_a_hand_arms_it_again(quality: int) -> None:
    plan = compensation.plan_of(machine())
    error_um = np.linspace(0.0, 8.0, 9)
    state = followed(plan, error_um, 20.0)
    lost = compensation.advance(plan, state, estimate(error_um, state.time_s + 0.5, quality), GRID)
    assert not lost.armed
    assert "arm again" in lost.reason
    again = compensation.advance(plan, lost, estimate(error_um, state.time_s + 1.0), GRID)
    assert not again.armed
    refused = compensation.advance(
        plan, again, estimate(error_um, state.time_s + 1.5, quality), GRID, arm=True
    )
    assert not refused.armed
    assert "cannot be armed" in refused.reason
    armed = compensation.advance(plan, again, estimate(error_um, state.time_s + 2.0), GRID, arm=True)
    assert armed.armed
    np.testing.assert_array_equal(armed.table_um, state.table_um)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_error_beyond_the_absolute_limit_switches_it_off(sign: float) -> None:
    plan = compensation.plan_of(machine(limit_um=40.0))
    state = followed(plan, np.full(9, sign * 39.9), 5.0)
    assert state.armed
    beyond = np.full(9, sign * 39.9)
    beyond[4] = sign * 41.0  # one place of the travel is enough
    lost = compensation.advance(plan, state, estimate(beyond, state.time_s + 0.5), GRID)
    assert lost.reason == "the error of 41 µm is beyond limit_um = 40; arm again"
    np.testing.assert_array_equal(lost.table_um, state.table_um)  # not cut to the limit
    refused = compensation.advance(plan, lost, estimate(beyond, state.time_s + 1.0), GRID, arm=True)
    assert not refused.armed
    back = compensation.advance(plan, refused, estimate(np.zeros(9), state.time_s + 1.5), GRID)
    assert not back.armed
    assert compensation.plan_of(machine()).limit_um == 200.0


def test_a_bound_beyond_the_limit_switches_it_off_and_keeps_it_from_being_armed() -> None:
    plan = compensation.plan_of(machine(limit_um=20.0))
    error_um = np.full(9, 5.0)
    state = compensation.advance(
        plan, compensation.initial(plan), estimate(error_um, 100.0, bound_um=20.0), GRID, arm=True
    )
    assert state.armed
    wide = estimate(error_um, 100.5)
    wide.error_bound_um[0, 4] = 41.0  # one place of the travel is enough
    lost = compensation.advance(plan, state, wide, GRID)
    assert lost.reason == "the error's bound of 41 µm is beyond compensation.limit_um = 20 µm; arm again"
    back = compensation.advance(plan, lost, estimate(error_um, 101.0), GRID)
    assert not back.armed
    wide.time_s[0] = 101.5
    assert not compensation.advance(plan, back, wide, GRID, arm=True).armed
    outside = estimate(error_um, 102.0)
    outside.error_bound_um[0, [0, 1, -2, -1]] = 41.0  # 0.35 m is beyond the travel, which ends at 0.3 m
    assert compensation.advance(plan, back, outside, GRID, arm=True).armed


@pytest.mark.parametrize("nowhere", [np.full((1, 9), np.nan), np.zeros((0, 0))])
def test_where_bounds_are_to_be_had_one_that_is_not_known_switches_it_off(nowhere: FloatArray) -> None:
    plan = compensation.plan_of(machine())
    state = followed(plan, np.full(9, 5.0), 5.0)
    unknown = replace(estimate(np.full(9, 5.0), state.time_s + 0.5), error_bound_um=nowhere)
    lost = compensation.advance(plan, state, unknown, GRID)
    assert lost.reason == "the error's bound is not known; arm again"
    assert not compensation.advance(plan, lost, unknown, GRID, arm=True).armed


@pytest.mark.parametrize(
    "tables",
    [
        {"integrity": {"enabled": False}},
        {"estimator": {"kind": "luenberger"}},
        {"estimator": {"engine": "constant"}},
        {"estimator": {"engine": "filterpy"}},
    ],
    ids=str,
)
def test_an_estimator_without_bounds_compensates_as_ever(tables: dict[str, Any]) -> None:
    config = with_tables(tables)
    compensator = Compensator(config, GRID)
    compensator.arm()
    document = compensator.step(estimate(np.full(9, 5.0), 10.0, bound_um=np.nan), at(config, 10.0, 0.2), 0)
    assert document["armed"] is True
    assert document["sigma_um"] == pytest.approx([0.5] * 21)
    assert document["bound_um"] is None


def test_an_estimate_that_comes_late_or_backwards_switches_it_off() -> None:
    plan = compensation.plan_of(machine())
    state = followed(plan, np.full(9, 2.0), 5.0)
    for time_s in (state.time_s + plan.late_s + 0.01, state.time_s - 0.5):
        assert not compensation.advance(plan, state, estimate(np.full(9, 2.0), time_s), GRID).armed
    unknown = compensation.advance(plan, state, estimate(np.full(9, np.nan), state.time_s + 0.5), GRID)
    assert not unknown.armed


def at(config: Config, time_s: float, nut_m: float) -> FrameBlock:
    times = np.array([time_s])
    return frames(config, times, {c: np.array([nut_m if c == "x_m" else 20.0]) for c in config.channels})


def test_the_document_is_null_while_off_and_whole_while_armed() -> None:
    config = machine(reverse=True, zero_m=0.4, rate_limit_um_s=1e3, gradient_limit_um_m=1e3)
    compensator = Compensator(config, GRID)
    error_um = 50.0 * GRID
    idle = compensator.step(estimate(error_um, 10.0), at(config, 10.0, 0.25), 7)
    assert idle["armed"] is False
    assert idle["reason"] == "not armed yet"
    assert idle["offset_um"] is idle["error_um"] is idle["position_m"] is None
    compensator.arm()
    for k in range(2):
        document = compensator.step(estimate(error_um, 10.5 + 0.5 * k), at(config, 10.5, 0.25), 8 + k)
    assert document["armed"] is True
    assert document["reason"] is None
    assert (document["time_s"], document["sequence"], document["quality"]) == (11.0, 9, "good")
    assert document["valid_until_s"] == pytest.approx(12.5)
    assert document["position_m"] == pytest.approx(np.linspace(0.3, 0.1, 21))
    assert document["error_um"] == pytest.approx((-50.0 * np.linspace(0.1, 0.3, 21)).tolist())
    assert document["slope_um_m"] == pytest.approx(50.0)
    assert (document["reference_m"], document["offset_um"]) == (pytest.approx(0.2), pytest.approx(-10.0))
    assert document["off_line_um"] == pytest.approx(0.0, abs=1e-5)
    assert document["sigma_um"] == pytest.approx([0.5] * 21)
    assert document["bound_um"] == pytest.approx([3.0] * 21)
    assert document["nut"] == {
        "position_m": pytest.approx(0.15), "error_um": pytest.approx(-12.5), "sigma_um": pytest.approx(0.5)
    }  # fmt: skip


def test_a_step_that_fails_switches_it_off() -> None:
    config = machine()
    compensator = Compensator(config, GRID)
    compensator.arm()
    compensator.step(estimate(np.zeros(9), 10.0), at(config, 10.0, 0.2), 0)
    failed = compensator.fail(10.5, 1, "ValueError: no")
    later = compensator.step(estimate(np.zeros(9), 11.0), at(config, 11.0, 0.2), 2)
    assert failed["armed"] is later["armed"] is False
    assert failed["reason"] == later["reason"] == "ValueError: no; arm again"
    assert set(failed) == set(later)


def test_a_nut_that_is_nowhere_has_no_error() -> None:
    config = machine()
    document = Compensator(config, GRID).step(estimate(np.zeros(9)), at(config, 100.0, float("nan")), 0)
    assert document["nut"] is None


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"controller_compensates": None}, "say with controller_compensates = false"),
        ({"controller_compensates": True}, "already compensates the screw's growth, and twice would double"),
        ({"position_feedback": None}, 'say with position_feedback = "motor"'),
        ({"position_feedback": "scale"}, "a scale already measures the growth"),
        ({"travel_m": [0.3, 0.1]}, "travel_m is empty"),
        ({"travel_m": [0.3, 0.9]}, "travel_m reaches 0.9 m, beyond the screw's length_m"),
    ],
)
def test_it_is_rejected_where_it_would_do_harm(keys: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        machine(**keys)


def test_it_is_off_by_default() -> None:
    assert not parse(table()).compensation.enabled
    assert not machine(enabled=False, controller_compensates=True).compensation.enabled


def test_a_compensation_that_has_come_where_it_goes_is_not_limited() -> None:
    plan = compensation.plan_of(machine(rate_limit_um_s=1e3, gradient_limit_um_m=1e6))
    error_um = np.random.default_rng(1).normal(0.0, 20.0, 9)  # sums of its steps are not it to the last bit
    assert not followed(plan, error_um, 2.0).limited
