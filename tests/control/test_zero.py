"""A zeroed machine: what the compensation counts from, its uncertainty, and when a zero is rejected."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from observer.control import compensation
from observer.control.compensation import CompensationState
from observer.control.compensator import Compensator
from observer.errors import ConfigError
from observer.frames import FloatArray
from tests.control.test_compensate import GRID, at, estimate, followed, machine

FAST = {"rate_limit_um_s": 1e3, "gradient_limit_um_m": 1e6}
CURVE = 300.0 * GRID * (0.5 - GRID)
"""As of a screw that is held at both ends: no line."""


def _zeroed(
    state: CompensationState, plan: Any, error_um: FloatArray, time_s: float, at_m: float, **made: Any
):
    return compensation.zeroed(plan, state, estimate(error_um, time_s, **made), GRID, at_m, "anna")


def test_the_compensation_is_the_error_less_that_of_the_place_and_moment_everywhere() -> None:
    plan = compensation.plan_of(machine(zero_m=0.05, **FAST))
    state = _zeroed(compensation.initial(plan), plan, CURVE, 100.0, 0.25)
    assert not state.armed
    there_um = float(np.interp(0.25, GRID, CURVE))
    before_um = np.interp(plan.screw_m, GRID, CURVE)
    np.testing.assert_array_equal(state.table_um, 0.0)  # what is off has no values
    armed = compensation.advance(plan, state, estimate(CURVE, 100.25), GRID, arm=True)
    state = compensation.advance(plan, armed, estimate(CURVE, 100.5), GRID)
    np.testing.assert_allclose(state.table_um, before_um - there_um, atol=1e-9)
    assert np.interp(0.25, plan.screw_m, state.table_um) == pytest.approx(0.0, abs=1e-12)
    assert np.abs(state.table_um).max() > 1.0  # the profile itself is not zero
    line = compensation.line_through(plan, state.ends_um)
    slope, offset = np.polyfit(plan.machine_m - plan.reference_m, before_um - there_um, 1)
    assert (line.slope_um_m, line.offset_um) == (pytest.approx(slope), pytest.approx(offset))
    grown = CURVE + 40.0 * GRID
    later = compensation.advance(plan, state, estimate(grown, 101.0), GRID)
    np.testing.assert_allclose(later.table_um, np.interp(plan.screw_m, GRID, grown) - there_um, atol=1e-9)


def test_a_machine_that_runs_against_the_screw_is_zeroed_at_the_same_place() -> None:
    config = machine(reverse=True, zero_m=0.4, zero_at_m=0.3, **FAST)
    compensator = Compensator(config, GRID, "0a0a0a0a")
    compensator.zero("anna@desk")
    compensator.step(estimate(100.0 * GRID, 10.0), at(config, 10.0, 0.15), 0)
    compensator.arm()
    document = compensator.step(estimate(120.0 * GRID, 10.5), at(config, 10.5, 0.15), 1)
    document = compensator.step(estimate(120.0 * GRID, 11.0), at(config, 11.0, 0.15), 2)
    assert document["zero"] == {
        "time_s": 10.0, "by": "anna@desk", "position_m": pytest.approx(0.1), "error_um": pytest.approx(-30.0),
        "sigma_um": 0.5, "bound_um": 3.0,
    }  # fmt: skip
    assert document["error_um"] == pytest.approx((-(120.0 * np.linspace(0.1, 0.3, 21) - 30.0)).tolist())
    assert document["nut"]["error_um"] == pytest.approx(-(120.0 * 0.15 - 30.0))


def test_how_sure_a_difference_is_is_never_said_better_than_it_can_be() -> None:
    """Errors at two times may move against each other: σ and bound of a difference reach the sums."""
    config = machine(zero_at_m=0.2, **FAST)
    compensator = Compensator(config, GRID)
    compensator.zero("anna")
    compensator.step(estimate(CURVE, 10.0, bound_um=4.0), at(config, 10.0, 0.15), 0)
    compensator.arm()
    document = compensator.step(estimate(CURVE, 10.5, bound_um=5.0), at(config, 10.5, 0.15), 1)
    assert document["sigma_um"] == pytest.approx([0.5 + 0.5] * 21)
    assert document["bound_um"] == pytest.approx([5.0 + 4.0] * 21)
    assert document["nut"]["sigma_um"] == pytest.approx(1.0)


def test_after_homing_an_armed_compensation_is_released_and_goes_to_zero_at_its_rate() -> None:
    plan = compensation.plan_of(machine(**FAST | {"rate_limit_um_s": 20.0}))
    state = followed(plan, np.full(9, 30.0), 5.0)
    zeroed = _zeroed(state, plan, np.full(9, 30.0), state.time_s + 0.5, 0.2)
    assert "anna has zeroed the machine; arm again" in zeroed.released
    np.testing.assert_array_equal(zeroed.table_um, state.table_um)
    later = compensation.advance(plan, zeroed, estimate(np.full(9, 30.0), state.time_s + 0.5), GRID)
    np.testing.assert_allclose(later.table_um, 20.0)


def test_after_probing_an_armed_compensation_continues_without_a_jump() -> None:
    """The probed offset absorbed what the compensation, at its rate, had left of the error there."""
    plan = compensation.plan_of(machine(zero_after="probing", rate_limit_um_s=2.0, gradient_limit_um_m=1e6))
    state = followed(plan, CURVE, 4.0)
    assert state.limited
    wanted_um = np.interp(plan.screw_m, GRID, CURVE)
    left_um = np.interp(0.2, plan.screw_m, wanted_um - state.table_um)
    assert left_um > 1.0
    zeroed = _zeroed(state, plan, CURVE, state.time_s + 0.5, 0.2)
    assert zeroed.armed
    np.testing.assert_array_equal(zeroed.table_um, state.table_um)
    after = compensation.advance(plan, zeroed, estimate(CURVE, state.time_s + 0.5), GRID)
    assert np.abs(after.table_um - state.table_um).max() <= 2.0 * 0.5 * (1 + 1e-12)
    assert np.interp(0.2, plan.screw_m, after.table_um) == pytest.approx(
        np.interp(0.2, plan.screw_m, state.table_um)
    )
    settled = followed(plan, CURVE, 20.0, after)
    np.testing.assert_allclose(settled.table_um, wanted_um - left_um)
    # what the machine is off after all is zero where it was probed, at that time
    residual_um = (wanted_um - left_um) - settled.table_um
    np.testing.assert_allclose(residual_um, 0.0, atol=1e-9)


def test_a_zero_while_the_error_is_not_known_keeps_it_from_being_armed_until_one_that_is() -> None:
    config = machine(**FAST)
    compensator = Compensator(config, GRID)
    good = estimate(np.full(9, 30.0), 10.0)

    def step(time_s: float, quality: int = 0, nut_m: float = 0.2) -> dict[str, Any]:
        return compensator.step(estimate(np.full(9, 30.0), time_s, quality), at(config, time_s, nut_m), 0)

    compensator.step(good, at(config, 10.0, 0.2), 0)
    for time_s, quality, nut_m, why in (
        (10.5, 2, 0.2, "the estimate is degraded"),
        (11.0, 0, float("nan"), "the nut's position is not known"),
    ):
        compensator.zero("anna")
        document = step(time_s, quality, nut_m)
        assert document["reason"].startswith(f"zero refused: {why}")
        assert compensator.state.zero.missed
        compensator.arm()
        document = step(time_s + 0.25)
        assert not document["armed"]
        assert "zero it again, then arm" in document["reason"]
    compensator.zero("anna")
    compensator.fail(11.5, 0, "ValueError: no")
    compensator.arm()
    assert not step(12.0)["armed"]
    compensator.zero("anna")
    assert not step(12.5)["armed"]
    compensator.arm()
    assert step(13.0)["armed"]
    assert step(13.5)["gradient_cut_um"] == 0.0
    assert step(14.0)["error_um"] is not None
    assert np.abs(compensator.state.table_um).max() < 1e-9  # the error has not changed since the zero


def test_a_zero_cancels_an_earlier_request_to_arm() -> None:
    config = machine(**FAST)
    compensator = Compensator(config, GRID)
    compensator.arm()
    compensator.zero("anna")
    assert not compensator.step(estimate(CURVE, 10.0), at(config, 10.0, 0.2), 0)["armed"]


def test_the_limit_holds_for_the_error_itself_and_for_that_since_the_zero() -> None:
    plan = compensation.plan_of(machine(limit_um=40.0, zero_at_m=0.2, **FAST))
    state = _zeroed(compensation.initial(plan), plan, np.full(9, -30.0), 10.0, 0.2)
    assert compensation.advance(plan, state, estimate(np.zeros(9), 10.5), GRID, arm=True).armed
    since = compensation.advance(plan, state, estimate(np.full(9, 15.0), 10.5), GRID, arm=True)
    assert since.reason.startswith("the error of 45 µm is beyond compensation.limit_um = 40 µm")
    plain = compensation.advance(plan, state, estimate(np.full(9, -41.0), 10.5), GRID, arm=True)
    assert plain.reason.startswith("the error of 41 µm is beyond compensation.limit_um = 40 µm")
    wide = compensation.advance(plan, state, estimate(np.zeros(9), 10.5, bound_um=38.0), GRID, arm=True)
    assert "could hide 41 µm, allowed are 40 µm" in wide.reason  # 38 now and 3 then
    assert _zeroed(state, plan, np.full(9, 50.0), 11.0, 0.2).zero.missed


def test_a_position_beyond_the_screw_is_rejected() -> None:
    with pytest.raises(ConfigError, match=r"zero_at_m reaches 0\.9 m, beyond the screw's length_m"):
        machine(zero_at_m=0.9)


def test_a_refused_zero_says_whether_zeroing_again_helps() -> None:
    plan = compensation.plan_of(machine(limit_um=200.0, **FAST))
    cold = compensation.initial(plan)
    wide = _zeroed(cold, plan, CURVE, 10.0, 0.2, bound_um=347.0)
    assert wide.reason.startswith(
        "zero refused: a faulty sensor could hide 347 µm, allowed are 200 µm (add a sensor, or raise "
        "compensation.limit_um). Zero again once that is less, then arm"
    )
    starting = _zeroed(cold, plan, CURVE, 10.0, 0.2, quality=1)
    assert "Zero again once `observer health` shows good estimates" in starting.reason
    nowhere = _zeroed(cold, plan, CURVE, 10.0, float("nan"))
    assert "Give compensation.zero_at_m" in nowhere.reason
    for refused in (wide, starting, nowhere):
        assert refused.zero.missed
        assert not compensation.advance(plan, refused, estimate(CURVE, 10.5), GRID, arm=True).armed
