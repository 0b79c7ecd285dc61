"""The compensation of one axis: follows its estimates, obeys commands, and makes the documents to publish."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from observer.config import Config
from observer.control.compensation import (
    CompensationState,
    advance,
    initial,
    line_through,
    off,
    plan_of,
    zeroed,
)
from observer.control.zero import ZeroPoint, since, zero_document
from observer.frames import EstimateBlock, EstimateQuality, FloatArray, FrameBlock
from observer.model.rod.supports import error_at
from observer.process.clock import stepped


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
        self._zero_by: str | None = None

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

    def zero(self, by: str) -> None:
        """Note that the machine has been zeroed; the next estimate counts from there."""
        self._zero_by, self._asked = by, False

    @property
    def zero_point(self) -> ZeroPoint:
        """What the compensation counts from, and whether a later zero was missed."""
        return self._state.zero

    @property
    def held(self) -> CompensationState:
        """What is in force, or was last."""
        return self._state

    def see_clock(self, offset_s: float) -> None:
        """Note how far the computer's clock is ahead of the service's time; if it was set, disarm.

        A control compares the time up to which a document holds with a clock of its own.
        """
        self._offset_s = offset_s
        if (why := stepped(offset_s)) is not None:
            self.disarm(f"{why}; arm again")

    def step(self, block: EstimateBlock, frame: FrameBlock, sequence: int) -> dict[str, Any]:
        """Follow an estimate, a block of one; return the document to publish."""
        asked, self._asked = self._asked, False
        if self._zero_by is not None:
            at_m = self._plan.zero_at_m
            at_m = self._nut_m(frame) if math.isnan(at_m) else at_m
            self._state = zeroed(self._plan, self._state, block, self._grid_m, at_m, self._zero_by)
            self._zero_by = None
        self._state = advance(self._plan, self._state, block, self._grid_m, arm=asked)
        return {
            "time_s": float(block.time_s[0]),
            "sequence": sequence,
            "instance": self._instance,
            "valid_until_s": float(block.time_s[0]) + self._plan.late_s + min(0.0, self._offset_s),
            "armed": self._state.armed,
            "reason": self._state.reason,
            **self._values(block),
            "zero": self._zero_document(),
            "nut": self._nut(block, frame),
            "quality": EstimateQuality(block.quality[0]).label,
        }

    def fail(self, time_s: float, sequence: int, reason: str) -> dict[str, Any]:
        """Disarm because a step gave no estimate; return the document to publish."""
        self.disarm(f"{reason}; arm again")
        if self._zero_by is not None:
            missed = replace(self._state.zero, missed=True)
            self._state = replace(self._state, zero=missed, reason=f"{reason}; zero it again, then arm")
            self._zero_by = None
        off = {"time_s": time_s, "sequence": sequence, "instance": self._instance}
        off |= {"valid_until_s": time_s, "armed": False}
        values = dict.fromkeys((*_VALUES, "nut"))
        return {
            **off,
            "reason": self._state.reason,
            **values,
            "zero": self._zero_document(),
            "quality": "invalid",
        }

    def _values(self, block: EstimateBlock) -> dict[str, Any]:
        """Table and line in force; all null while it is off, so that nobody takes them for good."""
        plan, state = self._plan, self._state
        if not state.armed:
            return dict.fromkeys(_VALUES)
        line = line_through(plan, state.ends_um)
        on_line = line.offset_um + line.slope_um_m * (plan.machine_m - plan.reference_m)
        found = since(state.zero, block)
        sigma_um = np.interp(plan.screw_m, self._grid_m, found.sigma_um)
        bound_um = np.interp(plan.screw_m, self._grid_m, found.bound_um)
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

    def _nut_m(self, frame: FrameBlock) -> float:
        """Where the nut stands on the screw; NaN where that is not known."""
        if self._nut_channel is None:
            return math.nan
        return float(frame.values[0, frame.channels.index(self._nut_channel)])

    def _zero_document(self) -> dict[str, Any] | None:
        return zero_document(self._state.zero, self._plan.direction, self._plan.zero_m)

    def _nut(self, block: EstimateBlock, frame: FrameBlock) -> dict[str, Any] | None:
        """Where the nut stands and the estimated error there since the zero, not limited; None where either
        is unknown.
        """
        if block.quality[0] != EstimateQuality.GOOD:
            return None
        position_m, now = np.array([self._nut_m(frame)]), since(self._state.zero, block)
        found = error_at(position_m, self._grid_m, now.error_um[None], now.sigma_um[None])
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
