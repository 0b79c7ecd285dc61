"""The compensation of one axis: follows its estimates, obeys commands, and makes the documents to publish."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from observer.config.machine import Config
from observer.control.compensation import (
    CompensationState,
    advance,
    after_restart,
    at_zero,
    hold,
    initial,
    line_through,
    off,
    plan_of,
    released,
    valid_s,
    zeroed,
)
from observer.control.zero import since, zero_document
from observer.frames import EstimateBlock, EstimateQuality, FloatArray, FrameBlock, Quality
from observer.model.rod.supports import error_at
from observer.process.clock import stepped


class Compensator:
    """Follows the estimates of one axis, in the loop's thread; nothing in it waits.

    Requests take effect with the next `step` or `fail`.
    """

    def __init__(
        self,
        config: Config,
        grid_m: FloatArray,
        instance: str = "",
        earlier_state: CompensationState | None = None,
    ) -> None:
        """Plan the compensation of a configuration whose `[compensation]` is enabled.

        Args:
            config: The configuration.
            grid_m: The grid of its estimates on the screw, (g,).
            instance: Names the start of the service, in every document.
            earlier_state: The state of an earlier service: its zero stays, and if it was armed this is a
                release. None without one.
        """
        self._instance = instance
        self._plan = plan_of(config)
        self._state = initial(self._plan)
        if earlier_state is not None:
            self._state = after_restart(self._plan, earlier_state)
        self._offset_s = 0.0
        self._grid_m = grid_m
        nuts = [s.position_channel for s in config.source if s.position_channel is not None]
        self._nut_channel = nuts[0] if nuts else None
        self._sensors = [s.name for s in config.sensor]
        self._sensor_channels = {s.channel for s in config.sensor}
        self._arm_without: Sequence[str] | None = None
        self._zero_by: str | None = None
        self._sequence = 0

    @property
    def state(self) -> CompensationState:
        """The state of the compensation after the last step."""
        return self._state

    @property
    def reason(self) -> str | None:
        """Why it is off; None while it is armed."""
        return self._state.reason

    def arm(self, without: Sequence[str] = ()) -> None:
        """Ask for the compensation to be armed with the next estimate, if that is good.

        It has to use every sensor but those in `without`.
        """
        self._arm_without = tuple(without)

    def disarm(self, reason: str) -> None:
        """Switch it off, as a person has asked for; what is off keeps its reason, and its alarm ends."""
        is_asked, self._arm_without = self._arm_without is not None, None
        reason = reason if self._state.armed or is_asked else self._state.reason or reason
        self._state = off(self._state, reason)

    def release(self, cause: str) -> None:
        """Switch it off for a cause that no person has asked for; a request to arm it is dropped."""
        if self._arm_without is not None and not self._state.armed:
            self._state = replace(self._state, reason=f"{cause}; arm again")
        self._arm_without = None
        self._state = released(self._state, cause)

    def release_unfollowed(self, cause: str) -> None:
        """Release it, without a ramp, because the control does not follow."""
        if self._state.in_force:
            self._state = at_zero(released(self._state, cause))

    def zero(self, by: str) -> None:
        """Note that the machine has been zeroed; the next estimate counts from there."""
        self._zero_by, self._arm_without = by, None

    def see_clock(self, offset_s: float) -> None:
        """Note how far the computer's clock is ahead of the service's time; if it was set, release.

        A control compares the time up to which a document holds with a clock of its own.
        """
        self._offset_s = offset_s
        if (why := stepped(offset_s)) is not None:
            self.release(why)

    def step(
        self, block: EstimateBlock, frame: FrameBlock, sequence: int, cause: str | None = None
    ) -> dict[str, Any]:
        """Follow an estimate; return the document to publish.

        Args:
            block: One estimate.
            frame: The frame behind it, which gives the nut's position.
            sequence: The estimate's number.
            cause: Why it may not be used although it is good; None where it may.
        """
        without, self._arm_without = self._arm_without, None
        if self._zero_by is not None:
            at_m = self._plan.zero_at_m
            at_m = self._nut_m(frame) if math.isnan(at_m) else at_m
            self._state = zeroed(self._plan, self._state, block, self._grid_m, at_m, self._zero_by)
            self._zero_by = None
        refusal = None if without is None else self._sensor_refusal(block, without)
        self._state = advance(
            self._plan,
            self._state,
            block,
            self._grid_m,
            arm=without is not None and refusal is None,
            cause=cause or self._cause(block, frame),
        )
        if refusal is not None and not self._state.armed:
            self._state = replace(self._state, reason=refusal)
        quality = EstimateQuality(block.error_quality[0]).label
        document = self._document(float(block.time_s[0]), sequence, quality)
        return document | self._doubts(block) | {"nut": self._nut(block, frame)}

    def fail(self, time_s: float, sequence: int, reason: str) -> dict[str, Any]:
        """Take a step that gave no estimate; return the document to publish.

        Values in force are held for the hold time. A request to arm or to zero is refused.

        Args:
            time_s: The time of the step.
            sequence: The number that the estimate would have had.
            reason: Why there is no estimate, as a clause.
        """
        if self._arm_without is not None and not self._state.armed:
            self._state = replace(self._state, reason=f"{reason}, so it cannot be armed")
        self._arm_without = None
        self._state = hold(self._plan, self._state, time_s, reason)
        if self._zero_by is not None:
            self._state = replace(self._state, zero=replace(self._state.zero, missed=True))
            self._state = released(self._state, f"{self._zero_by} has zeroed the machine, but {reason}")
            self._state = replace(self._state, reason=f"zero refused: {reason}; zero it again, then arm")
            self._zero_by = None
        return self._document(time_s, sequence, "invalid")

    def ended(self) -> dict[str, Any]:
        """Release it because the service ends; return the last document, whose values are null."""
        state = self._state = at_zero(released(self._state, "the service ended"))
        return self._document(state.time_s, self._sequence, "invalid") | {"valid_until_s": state.time_s}

    def _document(self, time_s: float, sequence: int, quality: str) -> dict[str, Any]:
        """The document of a step; σ, bound and nut are null, because they need an estimate."""
        state, self._sequence = self._state, sequence
        return {
            "time_s": time_s,
            "sequence": sequence,
            "instance": self._instance,
            "valid_until_s": time_s + valid_s(self._plan) + min(0.0, self._offset_s),
            "armed": state.armed,
            "phase": state.phase,
            "reason": state.reason,
            "hold_reason": state.doubt or None,
            "released_s": None if math.isnan(state.released_s) else state.released_s,
            **self._values(),
            "zero": zero_document(state.zero, self._plan.direction, self._plan.zero_m),
            "nut": None,
            "quality": quality,
        }

    def _values(self) -> dict[str, Any]:
        """Return the active table and line; all are null while compensation is off."""
        plan, state = self._plan, self._state
        if not state.in_force:
            return dict.fromkeys(_VALUES)
        line = line_through(plan, state.ends_um)
        on_line = line.offset_um + line.slope_um_m * (plan.machine_m - plan.reference_m)
        return {
            "reference_m": plan.reference_m,
            "offset_um": round(line.offset_um, 6),
            "slope_um_m": round(line.slope_um_m, 6),
            "off_line_um": round(float(np.max(np.abs(state.table_um - on_line))), 6),
            "position_m": np.round(plan.machine_m, 9).tolist(),
            "error_um": np.round(state.table_um, 6).tolist(),
            "sigma_um": None,
            "bound_um": None,
            "limited": state.limited,
            "gradient_cut_um": round(state.cut_um, 6),
        }

    def _doubts(self, block: EstimateBlock) -> dict[str, Any]:
        """σ and bound of an estimate along the table; null where they are not known, and while it is off."""
        if not self._state.armed:
            return {}
        errors = since(self._state.zero, block)
        columns_um = {"sigma_um": errors.sigma_um, "bound_um": errors.bound_um}
        tables_um = {n: np.interp(self._plan.screw_m, self._grid_m, um) for n, um in columns_um.items()}
        return {
            name: np.round(table_um, 6).tolist() if np.isfinite(table_um).all() else None
            for name, table_um in tables_um.items()
        }

    def _sensor_refusal(self, block: EstimateBlock, without: Sequence[str]) -> str | None:
        """Why it may not be armed with the sensors that a good estimate uses; None if it may."""
        names = ", ".join(self._sensors)
        if strange := [name for name in without if name not in self._sensors]:
            return f"there is no sensor {', '.join(strange)}; the sensors are {names}"
        qualities = zip(self._sensors, block.sensor_quality[0].tolist(), strict=True)
        unused = {name: Quality(quality).label for name, quality in qualities if quality != Quality.GOOD}
        missing = {name: label for name, label in unused.items() if name not in without}
        if not missing or block.error_quality[0] != EstimateQuality.GOOD:
            return None
        states = ", ".join(f"{name} is {label}" for name, label in missing.items())
        options = " ".join(f"--without {name}" for name in unused)
        return f"{states}; repair the sensor, or arm without it: `observer arm {options}`"

    def _cause(self, block: EstimateBlock, frame: FrameBlock) -> str | None:
        """Why an estimate is not good, by the first input or sensor that fails; None where none does."""
        if block.error_quality[0] == EstimateQuality.GOOD:
            return None
        qualities = dict(zip(frame.channels, frame.quality[0].tolist(), strict=True))
        ages_s = dict(zip(frame.channels, frame.age_s[0].tolist(), strict=True))
        inputs = sorted(qualities, key=lambda channel: channel != self._nut_channel)
        for channel in inputs:
            if qualities[channel] != Quality.GOOD and channel not in self._sensor_channels:
                is_position = channel == self._nut_channel
                value = "position from the control" if is_position else f"value of {channel}"
                age_s = ages_s[channel]
                return f"no {value}" + (f" for {age_s:.1f} s" if math.isfinite(age_s) else " yet")
        sensors = zip(self._sensors, block.sensor_quality[0].tolist(), strict=True)
        unused = [f"{name} is {Quality(q).label}" for name, q in sensors if q != Quality.GOOD]
        return f"{unused[0]}, and the estimate is {_label(block)}" if unused else None

    def _nut_m(self, frame: FrameBlock) -> float:
        """The nut's position on the screw; NaN where it is not known."""
        if self._nut_channel is None:
            return math.nan
        return float(frame.values[0, frame.channels.index(self._nut_channel)])

    def _nut(self, block: EstimateBlock, frame: FrameBlock) -> dict[str, Any] | None:
        """The nut's position and the estimated error there since the zero, not limited by rate or gradient.

        None where one of them is not known.
        """
        if block.error_quality[0] != EstimateQuality.GOOD:
            return None
        position_m, now = np.array([self._nut_m(frame)]), since(self._state.zero, block)
        at_nut = error_at(position_m, self._grid_m, now.error_um[None], now.sigma_um[None])
        error_um, sigma_um = (float(value[0]) for value in at_nut)
        if not math.isfinite(error_um):
            return None
        plan = self._plan
        return {
            "position_m": round(plan.direction * (float(position_m[0]) - plan.zero_m), 9),
            "error_um": round(plan.direction * error_um, 6),
            "sigma_um": round(sigma_um, 6),
        }


def _label(block: EstimateBlock) -> str:
    return EstimateQuality(block.error_quality[0]).label


_VALUES = (
    "reference_m", "offset_um", "slope_um_m", "off_line_um", "position_m", "error_um", "sigma_um", "bound_um",
    "limited", "gradient_cut_um",
)  # fmt: skip
