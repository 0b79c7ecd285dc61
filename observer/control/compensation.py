"""What a control corrects the thermal error with: a table over the travel and a straight line.

Pure: estimates go in, frozen states come out. Everything is the *error* in the machine's coordinates: where
the nut stands minus where its encoder says it stands. The table and the line follow the estimate at a
limited rate, with a limited gradient, and only while the compensation is armed. It is armed by hand, and the
first estimate that is not good, that comes late, or that lies beyond the absolute limit, disarms it for good:
it is armed again by hand only. So does the first whose bound, of how far a sensor's fault may have taken
it, is beyond that limit, or is not known though the estimator has bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from observer.config import Config
from observer.frames import EstimateBlock, EstimateQuality, FloatArray, FrameBlock
from observer.model.rod.supports import error_at
from observer.process.clock import stepped

LATE_PERIODS = 3.0
"""An armed compensation whose next estimate does not come within so many periods is off."""
NOT_ARMED = "not armed yet"


@dataclass(frozen=True, slots=True)
class CompensationLine:
    """error(x) = `offset_um` + `slope_um_m` (x − reference), x in the machine's coordinates."""

    offset_um: float
    slope_um_m: float


@dataclass(frozen=True, slots=True)
class CompensationPlan:
    """Where and how fast a compensation may go.

    `screw_m`, `machine_m` (n,) are the table's points on the screw and in the machine, whose zero is `zero_m`
    on the screw and which runs in its `direction`, +1 or −1. `reference_m` is the line's reference in the
    machine's coordinates, `reference` the point of the table next to it; `fit` (2, n) gives a line's offset
    and slope by least squares. `bounded` says that the estimator knows bounds, so that none is a doubt.
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


@dataclass(frozen=True, slots=True)
class CompensationState:
    """What is in force: `table_um` (n,), and the line by its values at both ends of the travel, (2,), µm.

    `reason` says why it is off, None while it is armed; `time_s` is that of the last estimate it followed.
    `limited` says that rate or gradient keep it from where the estimate is.
    """

    reason: str | None
    time_s: float
    table_um: FloatArray
    ends_um: FloatArray
    limited: bool = False

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
    )


def initial(plan: CompensationPlan) -> CompensationState:
    """Return the state before anybody has armed: off, at zero."""
    return CompensationState(NOT_ARMED, float("nan"), np.zeros(len(plan.screw_m)), np.zeros(2))


def table_of(plan: CompensationPlan, grid_m: FloatArray, error_um: FloatArray) -> FloatArray:
    """Return the error at the table's points (n,) from that on the grid (g,), in the machine's direction."""
    return np.asarray(plan.direction * np.interp(plan.screw_m, grid_m, error_um))


def bound_of(plan: CompensationPlan, grid_m: FloatArray, block: EstimateBlock) -> FloatArray:
    """Return the bound of an estimate's error at the table's points (n,); NaN where it is not known."""
    if not block.error_bound_um.size:
        return np.full(len(plan.screw_m), np.nan)
    return np.asarray(np.interp(plan.screw_m, grid_m, block.error_bound_um[0]))


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
    if not 0.0 <= elapsed_s <= plan.late_s:
        return off(state, f"no estimate came for {elapsed_s:.3g} s; arm again")
    whole_um = table_of(plan, grid_m, error_um)
    wanted_um = within_gradient(plan, whole_um)
    line = line_of(plan, whole_um)
    first_um, last_um = (
        line.offset_um + line.slope_um_m * (x_m - plan.reference_m) for x_m in plan.machine_m[[0, -1]]
    )
    largest_um = max(float(np.abs(whole_um).max()), abs(first_um), abs(last_um))
    why = _why_beyond(plan, largest_um, bound_of(plan, grid_m, block))
    if why is not None:
        return off(state, f"{why}; arm again")
    table_um = toward(state.table_um, wanted_um, plan.rate_um_s * elapsed_s)
    ends_um = toward(state.ends_um, np.array([first_um, last_um]), plan.rate_um_s * elapsed_s)
    limited = not (np.array_equal(table_um, whole_um) and np.allclose(ends_um, [first_um, last_um]))
    return CompensationState(None, time_s, table_um, ends_um, limited)


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


class Compensator:
    """Follows the estimates of one axis."""

    def __init__(
        self,
        config: Config,
        grid_m: FloatArray,
        instance: str = "",
        held: CompensationState | None = None,
    ) -> None:
        """Plan the compensation of a configuration whose `[compensation]` is enabled.

        `held` is what one before held: off, with its values for the next arming to start from.
        """
        self._instance = instance
        self._plan = plan_of(config)
        self._state = held or initial(self._plan)
        self._offset_s = 0.0
        self._grid_m = grid_m
        nuts = [s.position_channel for s in config.source if s.position_channel is not None]
        self._nut_channel = nuts[0] if nuts else None
        self._asked = False

    @property
    def reason(self) -> str | None:
        """Why it is off; None while it is armed."""
        return self._state.reason

    def arm(self) -> None:
        """Ask for the compensation to be armed with the next estimate, if that is good."""
        self._asked = True

    def disarm(self, reason: str) -> None:
        """Switch it off, and forget who asked for it to be armed; what is off keeps its reason."""
        if self._state.armed or self._asked:
            self._state = off(self._state, reason)
        self._asked = False

    @property
    def held(self) -> CompensationState:
        """What is in force, or was last."""
        return self._state

    def see_clock(self, offset_s: float) -> None:
        """Take how far the computer's clock is ahead of the service's time; where it was set, disarm.

        A control compares the time up to which a document holds with a clock of its own.
        """
        self._offset_s = offset_s
        if (why := stepped(offset_s)) is not None:
            self.disarm(f"{why}; arm again")

    def step(self, block: EstimateBlock, frame: FrameBlock, sequence: int) -> dict[str, Any]:
        """Follow an estimate, a block of one; return the document to publish."""
        asked, self._asked = self._asked, False
        self._state = advance(self._plan, self._state, block, self._grid_m, arm=asked)
        return {
            "time_s": float(block.time_s[0]),
            "sequence": sequence,
            "instance": self._instance,
            "valid_until_s": float(block.time_s[0]) + self._plan.late_s + min(0.0, self._offset_s),
            "armed": self._state.armed,
            "reason": self._state.reason,
            **self._values(block),
            "nut": self._nut(block, frame),
            "quality": EstimateQuality(block.quality[0]).label,
        }

    def fail(self, time_s: float, sequence: int, reason: str) -> dict[str, Any]:
        """Disarm because a step gave no estimate; return the document to publish."""
        self.disarm(f"{reason}; arm again")
        off = {"time_s": time_s, "sequence": sequence, "instance": self._instance}
        off |= {"valid_until_s": time_s, "armed": False}
        values = dict.fromkeys((*_VALUES, "nut"))
        return {**off, "reason": self._state.reason, **values, "quality": "invalid"}

    def _values(self, block: EstimateBlock) -> dict[str, Any]:
        """Table and line in force; all null while it is off, so that nobody can take them for good."""
        plan, state = self._plan, self._state
        if not state.armed:
            return dict.fromkeys(_VALUES)
        line = line_through(plan, state.ends_um)
        on_line = line.offset_um + line.slope_um_m * (plan.machine_m - plan.reference_m)
        sigma_um = np.interp(plan.screw_m, self._grid_m, block.error_sigma_um[0])
        bound_um = bound_of(plan, self._grid_m, block)
        return {
            "reference_m": plan.reference_m,
            "offset_um": round(line.offset_um, 6),
            "slope_um_m": round(line.slope_um_m, 6),
            "off_line_um": round(float(np.max(np.abs(state.table_um - on_line))), 6),
            "position_m": np.round(plan.machine_m, 9).tolist(),
            "error_um": np.round(state.table_um, 6).tolist(),
            "sigma_um": np.round(sigma_um, 6).tolist(),
            "bound_um": None if np.isnan(bound_um).any() else np.round(bound_um, 6).tolist(),
            "limited": state.limited,
        }

    def _nut(self, block: EstimateBlock, frame: FrameBlock) -> dict[str, Any] | None:
        """Where the nut stands and the estimated error there, not limited; None where either is unknown."""
        if self._nut_channel is None or block.quality[0] != EstimateQuality.GOOD:
            return None
        position_m = frame.values[:, frame.channels.index(self._nut_channel)]
        found = error_at(position_m, self._grid_m, block.error_um, block.error_sigma_um)
        error_um, sigma_um = (float(value[0]) for value in found)
        if not math.isfinite(error_um):
            return None
        plan = self._plan
        return {
            "position_m": round(plan.direction * (float(position_m[0]) - plan.zero_m), 9),
            "error_um": round(plan.direction * error_um, 6),
            "sigma_um": round(sigma_um, 6),
        }


_VALUES = (
    "reference_m", "offset_um", "slope_um_m", "off_line_um", "position_m", "error_um", "sigma_um", "bound_um",
    "limited",
)  # fmt: skip
