"""The correction of the thermal error for a control: a table over the travel and a straight line.

Pure: estimates go in, frozen states come out. All values are the *error* in the machine's coordinates: the
nut's position minus the position that its encoder shows. The table and the line follow the estimate at a
limited rate, with a limited gradient, while the compensation is armed. A person arms it.

`doubt_about` decides whether an estimate may be compensated. While it may not, the last values are held for
the hold time. After that the compensation is released: it is off, its values go to zero at the limited rate,
and a person has to arm it again.

A machine that is homed or probed is set to zero at a place and a time, whatever the thermal error was.
After that the compensation is the change of the error: the error less that at this place and time (`zeroed`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import datetime
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.control.zero import NEVER, ZeroPoint, since
from observer.frames import EstimateBlock, EstimateQuality, FloatArray

LATE_PERIODS = 3.0
"""An estimate is late when it does not come within so many periods."""
BELIEVED_SIGMAS = 3.0
"""Standard deviations within which the error counts as known where there is no bound."""
NOT_ARMED = "not armed yet"
SINCE_RESTART = "not armed since the restart; arm again"
_ROUNDING_UM = 1e-6
"""Rounding of sums along the table stays below this; published values have as many digits."""
_MISSED = "the machine was zeroed while the error there was unknown; zero it again, then arm"
_EPOCH_FROM_S = 1e8  # a smaller time counts from the start of a log


@dataclass(frozen=True, slots=True)
class CompensationLine:
    """error(x) = `offset_um` + `slope_um_m` (x − reference), x in the machine's coordinates.

    Attributes:
        offset_um: The error at the reference, in µm.
        slope_um_m: Its growth along the machine's axis, in µm/m.
    """

    offset_um: float
    slope_um_m: float


@dataclass(frozen=True, slots=True)
class CompensationPlan:
    """Range and rate of a compensation.

    Attributes:
        screw_m: The table's n points on the screw, in m from its left end, (n,).
        machine_m: The same points in the machine's coordinates, (n,).
        zero_m: The machine's zero on the screw.
        direction: The direction in which the machine counts, +1 or −1.
        reference: The index of the table's point nearest to the line's reference.
        reference_m: The line's reference in the machine.
        fit: Gives a line's offset and slope from a table by least squares, (2, n).
        rate_um_s: The largest change of a value, in µm/s.
        gradient_um_m: The largest slope along the table, in µm/m.
        limit_um: The largest error that is compensated, in µm.
        hold_s: The time for which values are held while an estimate may not be compensated, in s.
        period_s: The period of the estimates, in s.
        bounded: Whether estimates have bounds; an unknown bound is a doubt then, and else σ decides.
        zero_at_m: The place on the screw at which the machine is zeroed; NaN: the nut's position.
        absorbs_all: Whether a zero absorbs the whole error, or only the part that was not compensated.
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
    hold_s: float
    period_s: float
    bounded: bool
    zero_at_m: float
    absorbs_all: bool


@dataclass(frozen=True, slots=True)
class CompensationState:
    """The values in force.

    Attributes:
        reason: Why it is off; None while it is armed.
        time_s: The time of the last step; NaN before the first.
        table_um: The table, in µm, (n,).
        ends_um: The line's values at the travel's ends, in µm, (2,).
        limited: Whether rate or gradient keep it from the estimate.
        zero: The zero from which it counts.
        cut_um: The largest difference to the error that the gradient limit causes, in µm.
        held_since_s: Since when values are held; NaN while they are not.
        doubt: The reason while values are held; else empty.
        released: The last release as a sentence, until a person arms or disarms; empty without.
        released_s: The time of that release; NaN without.
    """

    reason: str | None
    time_s: float
    table_um: FloatArray
    ends_um: FloatArray
    limited: bool = False
    zero: ZeroPoint = NEVER
    cut_um: float = 0.0
    held_since_s: float = math.nan
    doubt: str = ""
    released: str = ""
    released_s: float = math.nan

    @property
    def armed(self) -> bool:
        """Whether it follows the estimates, or holds its values."""
        return self.reason is None

    @property
    def in_force(self) -> bool:
        """Whether there are values for a control: armed, or on the way to zero after a release."""
        return self.armed or bool(self.table_um.any() or self.ends_um.any())

    @property
    def phase(self) -> str:
        """`following`, `holding`, `releasing` or `off`."""
        if self.armed:
            return "following" if math.isnan(self.held_since_s) else "holding"
        return "releasing" if self.in_force else "off"


def plan_of(config: Config) -> CompensationPlan:
    """Return the plan of a configuration.

    The travel is `compensation.travel_m`, else the first stroke, else the whole screw.
    """
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
        hold_s=settings.hold_s,
        period_s=config.estimator.period_s,
        bounded=config.gives_bounds,
        zero_at_m=math.nan if settings.zero_at_m is None else settings.zero_at_m,
        absorbs_all=settings.zero_after == "homing",
    )


def initial(plan: CompensationPlan) -> CompensationState:
    """Return the state before anybody has armed: off, at zero."""
    return CompensationState(NOT_ARMED, float("nan"), np.zeros(len(plan.screw_m)), np.zeros(2))


def table_of(plan: CompensationPlan, grid_m: FloatArray, error_um: FloatArray) -> FloatArray:
    """Return the error at the table's points, in the machine's direction.

    Args:
        plan: The plan of n points.
        grid_m: The estimate's grid on the screw, ascending, (g,).
        error_um: The error on the grid, in µm, (g,).

    Returns:
        The error in µm, (n,), by linear interpolation.
    """
    return np.asarray(plan.direction * np.interp(plan.screw_m, grid_m, error_um))


class _Target(NamedTuple):
    """The values to approach: the whole error, and table and line within the gradient limit."""

    whole_um: FloatArray
    table_um: FloatArray
    ends_um: FloatArray
    cut_um: float


def _target(plan: CompensationPlan, zero: ZeroPoint, block: EstimateBlock, grid_m: FloatArray) -> _Target:
    """Return the target of an estimate, a block of one, since a zero."""
    whole_um = table_of(plan, grid_m, since(zero, block).error_um)
    table_um, line = within_gradient(plan, whole_um), line_of(plan, whole_um)
    arms_m = plan.machine_m[[0, -1]] - plan.reference_m
    slope_cut_um_m = float(plan.fit[1] @ whole_um) - line.slope_um_m
    cut_um = max(np.abs(whole_um - table_um).max(), np.abs(slope_cut_um_m * arms_m).max())
    cut_um = float(cut_um) if cut_um > _ROUNDING_UM else 0.0
    return _Target(whole_um, table_um, line.offset_um + line.slope_um_m * arms_m, cut_um)


def doubt_about(
    plan: CompensationPlan, zero: ZeroPoint, block: EstimateBlock, grid_m: FloatArray
) -> str | None:
    """Return why an estimate may not be compensated; None if it may.

    This is the only place that judges its quality, its size and its bound. The limit holds for the error and
    for that since the zero.

    Args:
        plan: The plan.
        zero: The zero from which the error counts.
        block: One estimate.
        grid_m: Its grid on the screw, (g,).
    """
    quality = EstimateQuality(block.error_quality[0])
    if quality != EstimateQuality.GOOD or not np.isfinite(block.error_um[0]).all():
        return f"the estimate is {quality.label}"
    target = _target(plan, zero, block, grid_m)
    absolute_um = table_of(plan, grid_m, block.error_um[0])
    largest_um = float(np.abs(np.concatenate([absolute_um, target.whole_um, target.ends_um])).max())
    if largest_um > plan.limit_um:
        return (
            f"the error of {largest_um:.0f} µm is beyond compensation.limit_um = {plan.limit_um:g} µm (find "
            "the cause, or raise the limit)"
        )
    errors = since(zero, block)
    reach_um = errors.bound_um if plan.bounded else BELIEVED_SIGMAS * errors.sigma_um
    reach_um = np.interp(plan.screw_m, grid_m, reach_um)
    if plan.bounded and np.isnan(reach_um).any():
        return "how much a faulty sensor could hide is not known (`observer check` says what is missing)"
    if not reach_um.max() > plan.limit_um:
        return None
    allowed = f"allowed are {plan.limit_um:g} µm (add a sensor, or raise compensation.limit_um)"
    if plan.bounded:
        return f"a faulty sensor could hide {reach_um.max():.0f} µm, {allowed}"
    return f"the error is known to ± {reach_um.max():.0f} µm only, {allowed}"


def line_of(plan: CompensationPlan, table_um: FloatArray) -> CompensationLine:
    """Return the line that fits a table best, by least squares over the travel, within the gradient limit.

    Where the slope is cut, the line keeps its value at the reference.

    Args:
        plan: The plan of n points.
        table_um: The table, in µm, (n,).
    """
    offset_um, slope_um_m = plan.fit @ table_um
    limit = plan.gradient_um_m
    return CompensationLine(float(offset_um), float(np.clip(slope_um_m, -limit, limit)))


def within_gradient(plan: CompensationPlan, table_um: FloatArray) -> FloatArray:
    """Return the table with no step between neighbours above the gradient limit, true at the reference.

    Args:
        plan: The plan of n points.
        table_um: The table, in µm, (n,).
    """
    limits_um = plan.gradient_um_m * np.abs(np.diff(plan.machine_m))
    steps = np.clip(np.diff(table_um), -limits_um, limits_um)
    running = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(running - running[plan.reference] + table_um[plan.reference])


def toward(now_um: FloatArray, wanted_um: FloatArray, most_um: float) -> FloatArray:
    """Return values on their way to others; if both keep a limit of the gradient, so does the result.

    Args:
        now_um: The values in force, in µm.
        wanted_um: The values to approach, of the same shape or (1,).
        most_um: The largest change of each.
    """
    return now_um + np.clip(wanted_um - now_um, -most_um, most_um)


def line_through(plan: CompensationPlan, ends_um: FloatArray) -> CompensationLine:
    """Return the line through two values at the ends of the travel, in µm, (2,)."""
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
    cause: str | None = None,
) -> CompensationState:
    """Return the state after an estimate.

    An armed state follows the estimate, or holds its values while the estimate is in doubt. One that is off
    goes to zero. Arming starts from the values in force, which are zero once a release has ended.

    Args:
        plan: The plan.
        state: The state before.
        block: One estimate, later than the state.
        grid_m: Its grid on the screw, (g,).
        arm: Whether a person has armed it.
        cause: Why the estimate is not good, or may not be used; None where that is not known.
    """
    time_s = float(block.time_s[0])
    doubt = doubt_about(plan, state.zero, block, grid_m)
    if cause is not None and (doubt is None or block.error_quality[0] != EstimateQuality.GOOD):
        doubt = cause
    if not state.armed:
        state = _toward_zero(plan, state, time_s)
        if not arm:
            return state
        why_not = _MISSED if state.zero.missed else doubt
        if why_not is not None:
            return replace(state, reason=f"{why_not}, so it cannot be armed")
        state = replace(state, reason=None, released="", released_s=math.nan)
    if state.zero.missed:
        return replace(released(state, _MISSED), time_s=time_s)
    if doubt is not None:
        return hold(plan, state, time_s, doubt, latest=cause is not None)
    if (late_state := _late(plan, state, time_s)) is not None:
        return late_state
    target, most_um = _target(plan, state.zero, block, grid_m), _most_um(plan, state, time_s)
    table_um = toward(state.table_um, target.table_um, most_um)
    ends_um = toward(state.ends_um, target.ends_um, most_um)
    pairs = (table_um, target.whole_um), (ends_um, target.ends_um)
    limited = not all(np.allclose(now_um, to_um, rtol=0.0, atol=_ROUNDING_UM) for now_um, to_um in pairs)
    return CompensationState(None, time_s, table_um, ends_um, limited, state.zero, target.cut_um)


def hold(
    plan: CompensationPlan, state: CompensationState, time_s: float, doubt: str, *, latest: bool = True
) -> CompensationState:
    """Return the state at a time at which the estimate may not be compensated.

    An armed one holds its values, and is released once that has lasted for the hold time.

    Args:
        plan: The plan.
        state: The state before.
        time_s: The time.
        doubt: The reason, as a clause.
        latest: Whether `doubt` replaces the reason with which the hold began.
    """
    if not state.armed:
        return _toward_zero(plan, state, time_s)
    if (late_state := _late(plan, state, time_s)) is not None:
        return late_state
    since_s = time_s if math.isnan(state.held_since_s) else state.held_since_s
    doubt = doubt if latest or not state.doubt else state.doubt
    state = replace(state, time_s=time_s, held_since_s=since_s, doubt=doubt)
    return released(state, doubt) if time_s - since_s >= plan.hold_s else state


def released(state: CompensationState, cause: str) -> CompensationState:
    """Return an armed state after its release at its own time; a state that is off does not change."""
    if not state.armed:
        return state
    sentence = f"switched off at {_clock(state.time_s)}: {cause}; arm again"
    return replace(
        state, reason=sentence, held_since_s=math.nan, doubt="", released=sentence, released_s=state.time_s
    )


def off(state: CompensationState, reason: str) -> CompensationState:
    """Return the state after a person has disarmed it; its values go to zero from where they are."""
    return replace(state, reason=reason, held_since_s=math.nan, doubt="", released="", released_s=math.nan)


def at_zero(state: CompensationState) -> CompensationState:
    """Return a state with all values at zero, for a control that does not follow them."""
    zero_um = np.zeros_like(state.table_um), np.zeros_like(state.ends_um)
    return replace(state, table_um=zero_um[0], ends_um=zero_um[1], limited=False)


def after_restart(plan: CompensationPlan, state: CompensationState) -> CompensationState:
    """Return what a start takes over from an earlier service: off and at zero, released if it was armed."""
    state = released(state, "the service ended or began anew")
    return replace(
        initial(plan),
        reason=state.released or SINCE_RESTART,
        time_s=state.time_s,
        zero=state.zero,
        released=state.released,
        released_s=state.released_s,
    )


def _late(plan: CompensationPlan, state: CompensationState, time_s: float) -> CompensationState | None:
    """Return the release of a state whose values had lapsed before `time_s`; None if they had not.

    A control goes to zero when values lapse, so no ramp is needed.
    """
    elapsed_s = time_s - state.time_s
    if math.isnan(elapsed_s) or 0.0 <= elapsed_s <= valid_s(plan):
        return None
    lapsed = released(replace(state, time_s=time_s), f"no estimate came for {elapsed_s:.3g} s")
    return at_zero(lapsed) if elapsed_s > 0.0 else lapsed


def valid_s(plan: CompensationPlan) -> float:
    """Return how long values may be used without newer ones, in s: until an estimate is late, then the hold.

    The published `valid_until_s` and the control's dead-man follow from it.
    """
    return LATE_PERIODS * plan.period_s + plan.hold_s


def _most_um(plan: CompensationPlan, state: CompensationState, time_s: float) -> float:
    """The largest change of a value in a step; after a pause it is that of one period, never a jump."""
    elapsed_s = time_s - state.time_s
    return plan.rate_um_s * min(max(elapsed_s, 0.0), plan.period_s) if math.isfinite(elapsed_s) else 0.0


def _toward_zero(plan: CompensationPlan, state: CompensationState, time_s: float) -> CompensationState:
    """The state of a compensation that is off, with its values nearer to zero by the rate."""
    most_um, zero_um = _most_um(plan, state, time_s), np.zeros(1)
    return replace(
        state,
        time_s=time_s,
        table_um=toward(state.table_um, zero_um, most_um),
        ends_um=toward(state.ends_um, zero_um, most_um),
        limited=False,
        cut_um=0.0,
    )


def _clock(time_s: float) -> str:
    """A time for people: hour, minute and second, or seconds where a log counts from its own start."""
    if not time_s > _EPOCH_FROM_S:
        return f"{time_s:.1f} s"
    return f"{datetime.fromtimestamp(time_s).astimezone():%H:%M:%S}"


def zeroed(
    plan: CompensationPlan,
    state: CompensationState,
    block: EstimateBlock,
    grid_m: FloatArray,
    at_m: float,
    by: str,
) -> CompensationState:
    """Return the state after the machine has been set to zero.

    If the zero absorbed only what the values in force had left, at `at_m` nothing changes, and an armed
    compensation stays armed. If it absorbed the whole error, an armed one is released. Where the error at
    `at_m` is not known, nothing can be armed until a zero whose error is known.

    Args:
        plan: The plan.
        state: The state before.
        block: The estimate at whose time the machine was zeroed.
        grid_m: Its grid on the screw, (g,).
        at_m: The place on the screw, in m; NaN if it is not known.
        by: Who has zeroed it, for the reason.
    """
    if (refusal := _zero_refusal(plan, block, grid_m, at_m)) is not None:
        missed = replace(state, zero=replace(state.zero, missed=True))
        missed = released(missed, f"{by} has zeroed the machine while the error there is not known")
        return replace(missed, reason=refusal)
    left_um = 0.0 if plan.absorbs_all else float(np.interp(at_m, plan.screw_m, state.table_um))
    columns = (block.error_um, block.error_sigma_um, block.error_bound_um)
    error_um, sigma_um, bound_um = (float(np.interp(at_m, grid_m, column[0])) for column in columns)
    absorbed_um = error_um - plan.direction * left_um
    zero = ZeroPoint(float(block.time_s[0]), at_m, absorbed_um, sigma_um, bound_um, by)
    if not state.armed:
        return replace(state, zero=zero, reason=NOT_ARMED if state.zero.missed else state.reason)
    state = replace(state, zero=zero)
    return released(state, f"{by} has zeroed the machine") if plan.absorbs_all else state


def _zero_refusal(
    plan: CompensationPlan, block: EstimateBlock, grid_m: FloatArray, at_m: float
) -> str | None:
    """Why the error at a place on the screw is not known, and the remedy; None where it is known."""
    doubt = doubt_about(plan, NEVER, block, grid_m)
    if doubt is None and math.isfinite(at_m):
        return None
    if doubt is None:
        return (
            "zero refused: the nut's position is not known. Give compensation.zero_at_m, or zero again once "
            "the position comes, then arm"
        )
    if block.error_quality[0] != EstimateQuality.GOOD:
        return f"zero refused: {doubt}. Zero again once `observer health` shows good estimates, then arm"
    return f"zero refused: {doubt}. Zero again once that is less, then arm"
