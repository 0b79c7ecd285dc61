"""The correction of the thermal error for a control: a table over the travel and a straight line.

Pure: estimates go in, frozen states come out. Everything is the *error* in the machine's coordinates: where
the nut stands minus where its encoder says it stands. The table and the line follow the estimate at a
limited rate, with a limited gradient, and only while the compensation is armed. It is armed by hand, and the
first estimate that is not good, that comes late, or that lies beyond the absolute limit, disarms it for good:
it is armed again by hand only. So does the first whose bound (how far a sensor's fault may have shifted
it) is beyond that limit, or is unknown although the estimator has bounds.

A machine that is homed or probed is set to zero at a place and a time, whatever the thermal error there was.
From then on the compensation is the error since: less the error there and then, everywhere (`zeroed`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.control.zero import NEVER, ZeroPoint, since
from observer.frames import EstimateBlock, EstimateQuality, FloatArray

LATE_PERIODS = 3.0
"""An armed compensation whose next estimate does not come within so many periods is off."""
NOT_ARMED = "not armed yet"
_ROUNDING_UM = 1e-6
"""Rounding of sums along the table stays below this; published values have as many digits."""
_MISSED = "the machine was zeroed while the error there was unknown; zero it again, then arm"


@dataclass(frozen=True, slots=True)
class CompensationLine:
    """error(x) = `offset_um` + `slope_um_m` (x − reference), x in the machine's coordinates."""

    offset_um: float
    slope_um_m: float


@dataclass(frozen=True, slots=True)
class CompensationPlan:
    """Range and rate of a compensation.

    `screw_m`, `machine_m` (n,) are the table's points on the screw and in the machine, whose zero is `zero_m`
    on the screw and which runs in its `direction`, +1 or −1. `reference_m` is the line's reference in the
    machine's coordinates, `reference` the point of the table next to it; `fit` (2, n) gives a line's offset
    and slope by least squares. `bounded` says that the estimator knows bounds, so that none is a doubt.
    `zero_at_m` is where on the screw the machine is set to zero, NaN if where the nut stands; `absorbs_all`
    says that this absorbs the whole error there, not only what the compensation in force left of it.
    """

    screw_m: FloatArray
    machine_m: FloatArray
    zero_m: float
    direction: float
    reference: int
    reference_m: float
    fit: FloatArray
    rate_um_s: float
    gradient_um_m: float
    limit_um: float
    late_s: float
    bounded: bool
    zero_at_m: float
    absorbs_all: bool


@dataclass(frozen=True, slots=True)
class CompensationState:
    """What is in force: `table_um` (n,), and the line by its values at both ends of the travel, (2,), µm.

    `reason` says why it is off, None while it is armed; `time_s` is that of the last estimate it followed.
    `limited` says that rate or gradient keep it from where the estimate is. `zero` is what it counts from.
    """

    reason: str | None
    time_s: float
    table_um: FloatArray
    ends_um: FloatArray
    limited: bool = False
    zero: ZeroPoint = NEVER

    @property
    def armed(self) -> bool:
        """Whether a control may use it."""
        return self.reason is None


def plan_of(config: Config) -> CompensationPlan:
    """Return the plan of a configuration; the travel is, unless given, the first stroke, else the screw."""
    settings = config.compensation
    strokes = [s.stroke_m for s in config.source if s.stroke_m is not None]
    low, high = settings.travel_m or (strokes[0] if strokes else (0.0, config.screw.length_m))
    direction = -1.0 if settings.reverse else 1.0
    screw_m = np.linspace(low, high, settings.points)
    machine_m = direction * (screw_m - settings.zero_m)
    reference_m = settings.reference_m if settings.reference_m is not None else (low + high) / 2
    at_m = direction * (reference_m - settings.zero_m)
    design = np.column_stack([np.ones_like(machine_m), machine_m - at_m])
    return CompensationPlan(
        screw_m=screw_m,
        machine_m=machine_m,
        zero_m=settings.zero_m,
        direction=direction,
        reference=int(np.argmin(np.abs(machine_m - at_m))),
        reference_m=at_m,
        fit=np.asarray(np.linalg.pinv(design), dtype=float),
        rate_um_s=settings.rate_limit_um_s,
        gradient_um_m=settings.gradient_limit_um_m,
        limit_um=settings.limit_um,
        late_s=LATE_PERIODS * config.estimator.period_s,
        bounded=config.integrity.enabled and config.estimator.screens,
        zero_at_m=math.nan if settings.zero_at_m is None else settings.zero_at_m,
        absorbs_all=settings.zero_after == "homing",
    )


def initial(plan: CompensationPlan) -> CompensationState:
    """Return the state before anybody has armed: off, at zero."""
    return CompensationState(NOT_ARMED, float("nan"), np.zeros(len(plan.screw_m)), np.zeros(2))


def table_of(plan: CompensationPlan, grid_m: FloatArray, error_um: FloatArray) -> FloatArray:
    """Return the error at the table's points (n,) from that on the grid (g,), in the machine's direction."""
    return np.asarray(plan.direction * np.interp(plan.screw_m, grid_m, error_um))


class _Goal(NamedTuple):
    """The targets of table and line: the whole error, then what the limits leave; `why_not` if there are
    none.
    """

    whole_um: FloatArray
    table_um: FloatArray
    ends_um: FloatArray
    why_not: str | None


def _goal(plan: CompensationPlan, zero: ZeroPoint, block: EstimateBlock, grid_m: FloatArray) -> _Goal:
    """Return the targets of an estimate, a block of one. The limit holds for the error and for that since the
    zero.
    """
    found = since(zero, block)
    whole_um = table_of(plan, grid_m, found.error_um)
    line = line_of(plan, whole_um)
    ends_um = line.offset_um + line.slope_um_m * (plan.machine_m[[0, -1]] - plan.reference_m)
    absolute_um = table_of(plan, grid_m, block.error_um[0])
    largest_um = float(np.abs(np.concatenate([absolute_um, whole_um, ends_um])).max())
    why_not = _why_beyond(plan, largest_um, np.interp(plan.screw_m, grid_m, found.bound_um))
    return _Goal(whole_um, within_gradient(plan, whole_um), ends_um, why_not)


def line_of(plan: CompensationPlan, table_um: FloatArray) -> CompensationLine:
    """Return the line that fits a table best, by least squares over the travel, within the gradient limit.

    Where the slope is cut, the line keeps its value at the reference.
    """
    offset_um, slope_um_m = plan.fit @ table_um
    limit = plan.gradient_um_m
    return CompensationLine(float(offset_um), float(np.clip(slope_um_m, -limit, limit)))


def within_gradient(plan: CompensationPlan, table_um: FloatArray) -> FloatArray:
    """Return the table with no step between neighbours above the gradient limit, true at the reference."""
    most = plan.gradient_um_m * np.abs(np.diff(plan.machine_m))
    steps = np.clip(np.diff(table_um), -most, most)
    running = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(running - running[plan.reference] + table_um[plan.reference])


def toward(now_um: FloatArray, wanted_um: FloatArray, most_um: float) -> FloatArray:
    """Return values that go from `now_um` toward `wanted_um` by at most `most_um` each.

    What held for both, of gradients between neighbours, holds on the way.
    """
    return now_um + np.clip(wanted_um - now_um, -most_um, most_um)


def line_through(plan: CompensationPlan, ends_um: FloatArray) -> CompensationLine:
    """Return the line through two values at the ends of the travel."""
    first_m, last_m = plan.machine_m[0], plan.machine_m[-1]
    slope_um_m = (ends_um[1] - ends_um[0]) / (last_m - first_m)
    return CompensationLine(float(ends_um[0] + slope_um_m * (plan.reference_m - first_m)), float(slope_um_m))


def advance(
    plan: CompensationPlan,
    state: CompensationState,
    block: EstimateBlock,
    grid_m: FloatArray,
    *,
    arm: bool = False,
) -> CompensationState:
    """Return the state after an estimate, a block of one; `arm` says that somebody has armed by hand.

    Arming starts from the values last in force (zero after a cold start), and needs a good estimate.
    """
    quality, time_s = EstimateQuality(block.quality[0]), float(block.time_s[0])
    error_um = block.error_um[0]
    if quality != EstimateQuality.GOOD or not np.isfinite(error_um).all():
        if state.armed:
            return off(state, f"the estimate of {time_s:.3f} is {quality.label}; arm again")
        return off(state, f"the estimate is {quality.label}, so it cannot be armed") if arm else state
    if not state.armed and not arm:
        return state
    elapsed_s = time_s - state.time_s if state.armed else 0.0
    goal = _goal(plan, state.zero, block, grid_m)
    why_not = None if goal.why_not is None else f"{goal.why_not}; arm again"
    if not 0.0 <= elapsed_s <= plan.late_s:
        why_not = f"no estimate came for {elapsed_s:.3g} s; arm again"
    if state.zero.missed:
        why_not = _MISSED
    if why_not is not None:
        return off(state, why_not)
    table_um = toward(state.table_um, goal.table_um, plan.rate_um_s * elapsed_s)
    ends_um = toward(state.ends_um, goal.ends_um, plan.rate_um_s * elapsed_s)
    there = (table_um, goal.whole_um), (ends_um, goal.ends_um)
    limited = not all(np.allclose(now_um, to_um, rtol=0.0, atol=_ROUNDING_UM) for now_um, to_um in there)
    return CompensationState(None, time_s, table_um, ends_um, limited, state.zero)


def zeroed(
    plan: CompensationPlan,
    state: CompensationState,
    block: EstimateBlock,
    grid_m: FloatArray,
    at_m: float,
    by: str,
) -> CompensationState:
    """Return the state after the machine has been set to zero at `at_m` on the screw, at an estimate's time.

    While it is off nobody follows it, so table and line are those of the new zero at once. Armed, it stays so
    if the zero absorbed only what the compensation had left: at `at_m` nothing changes then, and elsewhere
    the rate limit holds. If it absorbed the whole error, table and line would have to jump: it is off, to be
    armed again. Where the error at `at_m` is not known, nothing can be armed until a zero that is.
    """
    why_not = _why_not_zeroed(block, at_m) or _goal(plan, NEVER, block, grid_m).why_not
    if why_not is not None:
        missed = replace(state, zero=replace(state.zero, missed=True))
        return off(missed, f"{by} has zeroed the machine, but {why_not}; zero it again, then arm")
    stays = state.armed and not plan.absorbs_all
    left_um = plan.direction * float(np.interp(at_m, plan.screw_m, state.table_um)) if stays else 0.0
    columns = (block.error_um, block.error_sigma_um, block.error_bound_um)
    error_um, sigma_um, bound_um = (float(np.interp(at_m, grid_m, column[0])) for column in columns)
    zero = ZeroPoint(float(block.time_s[0]), at_m, error_um - left_um, sigma_um, bound_um, by)
    if stays:
        return replace(state, zero=zero)
    goal = _goal(plan, zero, block, grid_m)
    reason = f"{by} has zeroed the machine; arm again" if state.armed else state.reason
    if state.zero.missed:
        reason = NOT_ARMED
    return CompensationState(reason, state.time_s, goal.table_um, goal.ends_um, zero=zero)


def _why_not_zeroed(block: EstimateBlock, at_m: float) -> str | None:
    """Why the error at a place on the screw is not known from an estimate; None if it is."""
    quality = EstimateQuality(block.quality[0])
    if quality != EstimateQuality.GOOD or not np.isfinite(block.error_um).all():
        return f"the estimate is {quality.label}"
    if not math.isfinite(at_m):
        return "the nut's position is not known (compensation.zero_at_m can give it)"
    return None


def _why_beyond(plan: CompensationPlan, error_um: float, bound_um: FloatArray) -> str | None:
    """Why an error of this size, with these bounds at the table's points, may not be used; None if it
    may.
    """
    if error_um > plan.limit_um:
        return f"the error of {error_um:.0f} µm is beyond limit_um = {plan.limit_um:g}"
    if np.isnan(bound_um).any():
        return "the error's bound is not known" if plan.bounded else None
    widest_um = float(bound_um.max())
    if widest_um <= plan.limit_um:
        return None
    return f"the error's bound of {widest_um:.0f} µm is beyond compensation.limit_um = {plan.limit_um:g} µm"


def off(state: CompensationState, reason: str) -> CompensationState:
    """Return the state disarmed; its values stay, for the next arming to start from."""
    return replace(state, reason=reason)
