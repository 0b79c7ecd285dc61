"""The interface for writing to a control, in four functions; not a driver, since nothing here reads a
machine.

A correction is in whole numbers, so that what a control reads back either is what was written or is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


class ControlError(Exception):
    """The control cannot be reached, refuses, or does not obey; the text says which."""


class ControlUnreachableError(ControlError):
    """The control does not answer, or cannot be reached; it may again."""


@dataclass(frozen=True, slots=True)
class AxisCorrection:
    """The thermal error that a control takes out, in the machine's coordinates; it subtracts it.

    A line, error(x) = offset + slope · (x − reference), and a table over equidistant places from `first_um`
    to `last_um`; a control takes the one or the other.
    """

    reference_um: int
    offset_nm: int
    slope_nm_m: int
    first_um: int
    last_um: int
    error_nm: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ReadBack:
    """The correction that the control holds, whether it follows it, and if not, the reason in words."""

    correction: AxisCorrection
    following: bool
    reason: str | None = None


class ControlLink(Protocol):
    """A control that takes out an error, at its own rate, and ramps to zero when the sign of life stops.

    Each function waits for an answer at most for a time of its own and raises `ControlError`. After a
    `ControlUnreachableError` the next function connects again, without switching the control off.
    """

    def open(self) -> None:
        """Connect, and switch the control off, whatever it was before."""

    def write(self, correction: AxisCorrection, valid_s: float) -> None:
        """Make the control follow a correction for `valid_s`, and advance the sign of life."""

    def read_back(self) -> ReadBack:
        """The control's state after the last write."""

    def release(self) -> None:
        """Make the control go to zero by its own ramp, and disconnect."""
