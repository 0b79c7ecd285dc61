"""The interface for writing to a control, in four functions.

It is not a driver, since nothing here reads a machine. A correction consists of whole numbers, so a value
that is read back from a control must equal the written one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


class ControlError(Exception):
    """The control cannot be reached, rejects a request, or does not obey; the text gives the reason."""


class ControlUnreachableError(ControlError):
    """The control does not answer or cannot be reached. A later attempt may succeed."""


@dataclass(frozen=True, slots=True)
class AxisCorrection:
    """The thermal error that a control subtracts, in the machine's coordinates.

    It holds both forms, and a control uses one of them. The line is error(x) = offset + slope · (x −
    reference). The table has equidistant places from `first_um` to `last_um`.

    Attributes:
        reference_um: The place of the line's `offset_nm`, in µm.
        offset_nm: The error at the reference, in nm.
        slope_nm_m: The error's growth along the axis, in nm per m.
        first_um: The first place of the table, in µm.
        last_um: The last place of the table, in µm.
        error_nm: The error at each place, in nm; at least two.
    """

    reference_um: int
    offset_nm: int
    slope_nm_m: int
    first_um: int
    last_um: int
    error_nm: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ReadBack:
    """The correction that the control holds, whether the control follows it, and if not, the reason as a
    sentence.

    Attributes:
        correction: As decoded from the control, to compare with the written one.
        following: Whether the control applies the correction now.
        reason: A sentence; None if the control gives no reason.
    """

    correction: AxisCorrection
    following: bool
    reason: str | None = None


class ControlLink(Protocol):
    """A control that takes out an error, at its own rate, and ramps to zero when the sign of life stops.

    Each function waits for an answer for a limited time and raises `ControlError`. After a
    `ControlUnreachableError` the next function connects again, without switching the control off.

    All functions block and belong to one thread.
    """

    def open(self) -> None:
        """Connect, and switch the control off, whatever its state was.

        A control whose dead-man has let go accepts writes again only after this.

        Raises:
            ControlUnreachableError: If the control does not answer.
            ControlError: If it rejects the request.
        """

    def write(self, correction: AxisCorrection, valid_s: float) -> None:
        """Make the control follow a correction, and advance the sign of life.

        Args:
            correction: The whole correction; a control never sees half of one.
            valid_s: The time, in s, after which the control ramps to zero without a further write.

        Raises:
            ControlUnreachableError: If the control does not answer.
            ControlError: If it rejects the correction, or its registers cannot hold a value.
        """

    def read_back(self) -> ReadBack:
        """Return the control's state after the last write.

        Raises:
            ControlUnreachableError: If the control does not answer.
            ControlError: If its registers have another layout or length.
        """

    def release(self) -> None:
        """Make the control go to zero by its own ramp, and disconnect.

        The connection is closed even if the control does not obey.

        Raises:
            ControlUnreachableError: If the control does not answer; its dead-man then ends the correction.
            ControlError: If it rejects the request.
        """
