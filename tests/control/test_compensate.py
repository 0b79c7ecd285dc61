"""The compensation: its line and table, its limits, its latch, its documents, and who may switch it on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from observer.config.machine import Config
from observer.control import compensation
from observer.control.compensation import CompensationPlan, CompensationState, doubt_about
from observer.control.compensator import Compensator
from observer.control.zero import NEVER
from observer.errors import ConfigError
from observer.frames import EstimateBlock, EstimateQuality, FloatArray, FrameBlock, Layout
from observer.installation import parse
from tests.bus.blocks import block
from tests.logs.machines import table
from tests.logs.simulated import frames

ON = {"enabled": True, "controller_compensates": False, "position_feedback": "motor"}
GRID = np.linspace(0.0, 0.4, 9)
LAYOUT = Layout(("nut",), GRID, ("a", "b", "c"), True)


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


def held(plan: CompensationPlan, state: CompensationState, seconds: float, **made: Any) -> CompensationState:
    """The state after estimates, one every half second, that may not be used."""
    for time_s in np.arange(state.time_s + 0.5, state.time_s + seconds + 0.1, 0.5):
        error_um = made.get("error_um", np.full(9, 5.0))
        state = compensation.advance(
            plan,
            state,
            estimate(error_um, time_s, **{k: v for k, v in made.items() if k != "error_um"}),
            GRID,
        )
    return state


@pytest.mark.parametrize("quality", [1, 2, 3])
def test_values_are_held_through_a_doubt_that_is_shorter_than_the_hold_time(quality: int) -> None:
    plan = compensation.plan_of(machine(hold_s=4.0))
    state = followed(plan, np.full(9, 5.0), 20.0)
    holding = held(plan, state, 4.0, quality=quality)
    assert (holding.phase, holding.armed) == ("holding", True)
    np.testing.assert_array_equal(holding.table_um, state.table_um)
    back = compensation.advance(plan, holding, estimate(np.full(9, 6.0), holding.time_s + 0.5), GRID)
    assert back.phase == "following"
    np.testing.assert_allclose(back.table_um, 5.5)  # at its rate: one period's way
    again = held(plan, back, 4.0, quality=quality)
    assert again.armed  # the hold begins anew


@pytest.mark.parametrize("quality", [1, 2, 3])
def test_a_doubt_that_lasts_releases_it_and_the_values_go_to_zero_at_the_rate(quality: int) -> None:
    plan = compensation.plan_of(machine(hold_s=4.0, rate_limit_um_s=2.0))
    state = followed(plan, np.full(9, 5.0), 20.0)
    lost = held(plan, state, 4.5, quality=quality)
    assert (lost.phase, lost.armed) == ("releasing", False)
    assert (
        lost.reason
        == f"switched off at {lost.time_s:.1f} s: the estimate is {EstimateQuality(quality).label}; arm again"
    )
    assert (lost.released, lost.released_s) == (lost.reason, lost.time_s)
    np.testing.assert_array_equal(lost.table_um, state.table_um)
    later = held(plan, lost, 1.0)  # good estimates do not arm it
    np.testing.assert_allclose(later.table_um, 3.0)
    np.testing.assert_allclose(later.ends_um, 3.0)
    end = held(plan, later, 3.0)
    assert end.phase == "off"
    np.testing.assert_array_equal(end.table_um, 0.0)
    refused = compensation.advance(
        plan, end, estimate(np.full(9, 5.0), end.time_s + 0.5, quality), GRID, arm=True
    )
    assert not refused.armed
    assert "cannot be armed" in refused.reason
    assert refused.released == lost.reason  # the alarm stays
    armed = compensation.advance(plan, refused, estimate(np.full(9, 5.0), end.time_s + 1.0), GRID, arm=True)
    assert (armed.armed, armed.released) == (True, "")
    np.testing.assert_array_equal(armed.table_um, 0.0)


def test_without_a_hold_time_the_first_doubt_releases_it() -> None:
    plan = compensation.plan_of(machine(hold_s=0.0))
    assert held(plan, followed(plan, np.full(9, 5.0), 20.0), 0.5, quality=2).phase == "releasing"
    with pytest.raises(ConfigError, match=r"hold_s"):
        machine(hold_s=-1.0)
    with pytest.raises(ConfigError, match=r"hold_s"):
        machine(hold_s=601.0)


@pytest.mark.parametrize("follow_s", [-0.1, 4.1, "soon"])
def test_a_time_to_follow_that_no_command_would_wait_for_is_rejected(follow_s: object) -> None:
    control = {"kind": "modbus", "host": "127.0.0.1", "follow_s": follow_s}
    with pytest.raises(ConfigError, match=r"follow_s"):
        machine(control=control)


def test_arming_while_the_values_go_to_zero_continues_from_where_they_are() -> None:
    plan = compensation.plan_of(machine(hold_s=0.0, rate_limit_um_s=1.0))
    lost = held(plan, held(plan, followed(plan, np.full(9, 5.0), 20.0), 0.5, quality=2), 2.0)
    armed = compensation.advance(plan, lost, estimate(np.full(9, 5.0), lost.time_s + 0.5), GRID, arm=True)
    assert armed.armed
    np.testing.assert_allclose(armed.table_um, 2.5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_error_beyond_the_absolute_limit_is_not_followed_and_releases_it(sign: float) -> None:
    plan = compensation.plan_of(machine(limit_um=40.0, hold_s=2.0))
    state = followed(plan, np.full(9, sign * 39.9), 5.0)
    assert state.armed
    beyond = np.full(9, sign * 39.9)
    beyond[4] = sign * 41.0  # one place of the travel is enough
    lost = held(plan, state, 2.5, error_um=beyond)
    assert lost.reason.endswith(
        ": the error of 41 µm is beyond compensation.limit_um = 40 µm (find the cause, or raise the limit); "
        "arm again"
    )
    np.testing.assert_array_equal(lost.table_um, state.table_um)  # not cut to the limit
    refused = compensation.advance(plan, lost, estimate(beyond, lost.time_s + 0.5), GRID, arm=True)
    assert not refused.armed
    assert compensation.plan_of(machine()).limit_um == 200.0


def test_a_bound_beyond_the_limit_releases_it_and_keeps_it_from_being_armed() -> None:
    plan = compensation.plan_of(machine(limit_um=20.0, hold_s=0.0))
    error_um = np.full(9, 5.0)
    state = compensation.advance(
        plan, compensation.initial(plan), estimate(error_um, 100.0, bound_um=20.0), GRID, arm=True
    )
    assert state.armed
    wide = estimate(error_um, 100.5)
    wide.error_bound_um[0, 4] = 41.0  # one place of the travel is enough
    lost = compensation.advance(plan, state, wide, GRID)
    assert "a faulty sensor could hide 41 µm, allowed are 20 µm (add a sensor, or raise comp" in lost.reason
    back = compensation.advance(plan, lost, estimate(error_um, 101.0), GRID)
    assert not back.armed
    wide.time_s[0] = 101.5
    assert not compensation.advance(plan, back, wide, GRID, arm=True).armed
    outside = estimate(error_um, 102.0)
    outside.error_bound_um[0, [0, 1, -2, -1]] = 41.0  # 0.35 m is beyond the travel, which ends at 0.3 m
    assert compensation.advance(plan, back, outside, GRID, arm=True).armed


@pytest.mark.parametrize("nowhere", [np.full((1, 9), np.nan), np.zeros((0, 0))])
def test_where_bounds_are_to_be_had_one_that_is_not_known_releases_it(nowhere: FloatArray) -> None:
    plan = compensation.plan_of(machine(hold_s=0.0))
    state = followed(plan, np.full(9, 5.0), 5.0)
    unknown = replace(estimate(np.full(9, 5.0), state.time_s + 0.5), error_bound_um=nowhere)
    lost = compensation.advance(plan, state, unknown, GRID)
    assert "how much a faulty sensor could hide is not known" in lost.reason
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


def test_a_bound_is_expected_exactly_where_the_estimator_gives_one() -> None:
    unseen = {
        "node": [{"name": "housing", "capacity_J_K": 900.0}],
        "link": [{"between": ["nut", "housing"], "conductance_W_K": 5.0}],
    }
    on_body = [{"name": "a", "channel": "a_degC", "on": "housing", "noise_K": 0.1}]
    lawful = {"name": "nut", "shape": "nut", "length_m": 0.05, "stroke_m": [0.1, 0.3]}
    by_law = lawful | {"speed_channel": "n_rpm", "heat_W_rpm": 0.01}
    assert with_tables({}).gives_bounds
    assert with_tables({**unseen, "sensor": on_body, "source": [lawful]}).gives_bounds
    assert not with_tables({**unseen, "sensor": on_body, "source": [by_law]}).gives_bounds


def test_without_bounds_three_standard_deviations_must_be_within_the_limit() -> None:
    config = with_tables({"integrity": {"enabled": False}, "compensation": {"limit_um": 200.0}})
    plan = compensation.plan_of(config)
    block = estimate(np.full(9, 5.0), 10.0, bound_um=np.nan)
    wide = replace(block, error_sigma_um=np.full((1, 9), 70.0))
    assert doubt_about(plan, NEVER, block, GRID) is None
    doubt = doubt_about(plan, NEVER, wide, GRID)
    assert doubt is not None
    assert "known to ± 210 µm only, allowed are 200 µm" in doubt


def test_an_estimate_after_the_values_have_lapsed_or_from_the_past_releases_it() -> None:
    plan = compensation.plan_of(machine(hold_s=4.0))
    state = followed(plan, np.full(9, 2.0), 5.0)
    in_time = estimate(np.full(9, 9.0), state.time_s + compensation.valid_s(plan))
    late = compensation.advance(plan, state, in_time, GRID)
    assert late.armed
    np.testing.assert_allclose(late.table_um, 2.5)  # one period's way, however long the pause was
    for time_s in (state.time_s + compensation.valid_s(plan) + 0.01, state.time_s - 0.5):
        lost = compensation.advance(plan, state, estimate(np.full(9, 2.0), time_s), GRID)
        assert "no estimate came for" in lost.released
        assert lost.in_force == (time_s < state.time_s)  # values that have lapsed are no longer in force
    unknown = compensation.advance(plan, state, estimate(np.full(9, np.nan), state.time_s + 0.5), GRID)
    assert unknown.phase == "holding"


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
    assert document["valid_until_s"] == pytest.approx(11.0 + 1.5 + 10.0)  # three periods, and the hold
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


def test_steps_that_fail_are_held_and_then_release_it() -> None:
    config = machine(hold_s=1.0)
    compensator = Compensator(config, GRID)
    compensator.arm()
    good = compensator.step(estimate(np.zeros(9), 10.0), at(config, 10.0, 0.2), 0)
    failed = [compensator.fail(10.5 + 0.5 * k, k, "ValueError: no") for k in range(3)]
    assert [document["armed"] for document in failed] == [True, True, False]
    assert failed[0]["hold_reason"] == "ValueError: no"
    assert failed[2]["reason"] == "switched off at 11.5 s: ValueError: no; arm again"
    assert set(failed[0]) == set(good)


def degraded(time_s: float, *sensors: int, quality: int = 2) -> EstimateBlock:
    made = estimate(np.full(9, 5.0), time_s, quality)
    made.sensor_quality[0, list(sensors)] = 4
    return made


def test_the_reason_of_a_release_names_the_input_that_failed() -> None:
    config = machine(hold_s=1.0)
    compensator = Compensator(config, GRID)
    compensator.arm()
    compensator.step(estimate(np.full(9, 5.0), 10.0), at(config, 10.0, 0.2), 0)
    for time_s in (10.5, 11.0, 11.5):
        frame = at(config, time_s, float("nan"))
        frame.age_s[0, frame.channels.index("x_m")] = time_s - 10.1
        document = compensator.step(degraded(time_s), frame, 0)
    assert document["reason"] == "switched off at 11.5 s: no position from the control for 1.4 s; arm again"
    other = Compensator(config, GRID)
    other.arm()
    other.step(estimate(np.full(9, 5.0), 10.0), at(config, 10.0, 0.2), 0)
    for time_s in (10.5, 11.0, 11.5):
        document = other.step(degraded(time_s, 1), at(config, time_s, 0.2), 0)
    assert "b is excluded, and the estimate is degraded" in document["reason"]


def test_arming_is_refused_while_a_sensor_is_excluded_unless_it_is_named() -> None:
    config = machine()
    compensator = Compensator(config, GRID)

    def armed(*without: str) -> dict[str, Any]:
        compensator.arm(without)
        document = compensator.step(degraded(10.0, 1, 2, quality=0), at(config, 10.0, 0.2), 0)
        compensator.disarm("by hand")
        return document

    for without in ((), ("b",), ("a",)):
        document = armed(*without)
        assert not document["armed"]
        assert "c is excluded" in document["reason"]
        assert "`observer arm --without b --without c`" in document["reason"]
    assert "there is no sensor d; the sensors are a, b, c" in armed("d")["reason"]
    assert armed("b", "c")["armed"]


def test_a_sensor_that_is_excluded_later_leaves_it_armed_while_the_estimate_is_good() -> None:
    config = machine()
    compensator = Compensator(config, GRID)
    compensator.arm()
    compensator.step(estimate(np.full(9, 5.0), 10.0), at(config, 10.0, 0.2), 0)
    assert compensator.step(degraded(10.5, 1, quality=0), at(config, 10.5, 0.2), 1)["phase"] == "following"


def test_a_value_that_the_gradient_limit_cuts_says_by_how_much() -> None:
    config = machine(rate_limit_um_s=1e3, gradient_limit_um_m=50.0)
    compensator = Compensator(config, GRID)
    compensator.arm()
    for k in range(3):
        document = compensator.step(estimate(150.0 * GRID, 10.0 + 0.5 * k), at(config, 10.0, 0.2), k)
    # 150 µm/m over the 0.1 m from the reference to each end, of which 50 µm/m are allowed
    assert document["gradient_cut_um"] == pytest.approx(10.0)
    assert document["limited"]


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
