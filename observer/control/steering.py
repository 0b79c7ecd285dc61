"""Write the compensation to a control, in a thread; release the control when it does not follow.

It decides nothing. The values that the loop's compensation publishes are written. The first document without
values, a control that does not follow in time and the end of the service release the control. A sign of life
is only sent with a document from the loop, so that to the control a stalled loop looks like a dead one.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import structlog

from drivers.control import AxisCorrection, ControlError, ControlLink, ControlUnreachableError

_ATTEMPTS = 2
_REFUSED = "check unit_id and first_register in [compensation.control], and the control's limits"
_LOOK_S = 0.02  # between two looks at a control that does not follow yet

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class _Job:
    """A correction to write until a time; None releases the control."""

    correction: AxisCorrection | None
    until_s: float


class Steering:
    """Writes to one control; the loop never waits for it.

    `valid_s` is how long a document holds. A control may be out of reach for as long. `follow_s` is the time
    that it may take to report that it follows.

    A control that fails is released, and `failure` says why until the next arming.

    Args:
        control: The control, used only in the thread that this starts.
        valid_s: How long a document holds, in s.
        follow_s: How long the control may take to follow, in s.
    """

    def __init__(self, control: ControlLink, valid_s: float, follow_s: float) -> None:
        self._control = control
        self._valid_s, self._follow_s = valid_s, follow_s
        self._changed = threading.Condition()
        self._next: _Job | None = None
        self._closing = False
        self._armed = False
        self._failure: str | None = None
        self._written: AxisCorrection | None = None
        self._holds_until_s: float | None = None
        self._is_open = False
        self._thread = threading.Thread(target=self._live, name="control", daemon=True)
        self._thread.start()

    @property
    def failure(self) -> str | None:
        """Why the control does not follow, since it was armed last; None while it does."""
        if self._failure is None and not self._thread.is_alive():
            return "control: its thread has ended; restart the service"
        return self._failure

    @property
    def is_pending(self) -> bool:
        """Whether values are being written and it is not known yet that the control follows them."""
        return self._armed and self._holds_until_s is None and self.failure is None

    def take(self, document: Mapping[str, Any]) -> None:
        """Take a document of the compensation; returns at once.

        Before a document has values, the control is not touched at all. A document that was not written yet
        is replaced by the newer one.
        """
        correction = None if document["error_um"] is None else correction_of(document)
        with self._changed:
            if correction is None and not self._armed:
                return
            if not self._armed:
                self._failure, self._holds_until_s = None, None
            self._armed = correction is not None
            self._next = _Job(correction, time.monotonic() + self._valid_s)
            self._changed.notify()

    def close(self, timeout_s: float) -> bool:
        """Release the control, and end the thread.

        Args:
            timeout_s: The longest wait, in s.

        Returns:
            False if that did not end in time; the control's dead-man then ends the correction.
        """
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _live(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._next is not None or self._closing)
                job, self._next = self._next, None
                closing = self._closing
            if closing or job is None or job.correction is None:
                self._let_go()
            elif self._failure is None:
                self._try(job, job.correction)
            if closing:
                return

    def _try(self, job: _Job, correction: AxisCorrection) -> None:
        try:
            self._write(job, correction)
        except ControlUnreachableError as error:
            self._written = None
            if self._holds_until_s is None or time.monotonic() > self._holds_until_s:
                self._fail(error)
        except Exception as error:  # whatever it is, it is reported and the control released
            if not isinstance(error, ControlError):
                log.error("control failed", error=repr(error), exc_info=True)
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        self._failure = f"control: {str(error) or type(error).__name__}"
        self._let_go()

    def _write(self, job: _Job, correction: AxisCorrection) -> None:
        """Verify what was written last, write, and wait until the control follows."""
        if not self._is_open:
            self._is_open = True
            self._control.open()
        elif self._written is not None and (problem := self._problem(self._written)) is not None:
            raise ControlError(problem)
        if time.monotonic() > job.until_s:
            raise ControlError(
                f"nothing could be written for {self._valid_s:g} s; check the control's cable and load"
            )
        try:
            self._control.write(correction, self._valid_s)
        except ControlUnreachableError:
            raise
        except ControlError as error:
            raise ControlError(f"{error}{self._why()}") from None
        if self._is_followed(correction):
            self._written = correction
            self._holds_until_s = time.monotonic() + self._valid_s

    def _is_followed(self, correction: AxisCorrection) -> bool:
        """Wait until the control follows a correction; False where it is to be released meanwhile.

        Raises `ControlError` where it does not follow in time.
        """
        until_s = time.monotonic() + self._follow_s
        while (problem := self._problem(correction)) is not None:
            if time.monotonic() >= until_s:
                raise ControlError(problem)
            with self._changed:
                if self._changed.wait_for(self._is_to_release, _LOOK_S):
                    return False
        return True

    def _is_to_release(self) -> bool:
        return self._closing or (self._next is not None and self._next.correction is None)

    def _problem(self, written: AxisCorrection) -> str | None:
        """How the control does not follow what was written, None if it does."""
        back = self._control.read_back()
        if back.reason is not None or not back.following:
            return f"it does not follow: {back.reason or 'it is off'}"
        if back.correction != written:
            return "it reads back something other than was written; find out what else writes to it"
        return None

    def _why(self) -> str:
        """The control's own reason for refusing, or the remedy if it gives none."""
        try:
            reason = self._control.read_back().reason
        except ControlError:
            reason = None
        return f"; {reason or _REFUSED}"

    def _let_go(self) -> None:
        """Release the control, once; where that fails, its dead-man does it."""
        self._written = None
        for _ in range(_ATTEMPTS if self._is_open else 0):
            try:
                self._control.release()
                break
            except ControlError as error:
                log.warning("control not released; its dead-man takes it to zero", error=str(error))
        self._is_open = False


class NoControl:
    """Writes nowhere, where no control is named."""

    failure: str | None = None
    is_pending = False

    def take(self, document: Mapping[str, Any]) -> None:
        """Leave a document out."""

    def close(self, _timeout_s: float) -> bool:
        """End at once."""
        return True


def correction_of(document: Mapping[str, Any]) -> AxisCorrection:
    """Return the document of an armed compensation in a control's whole numbers: µm for places, nm for
    errors.
    """
    places_m = document["position_m"]
    return AxisCorrection(
        reference_um=round(1e6 * document["reference_m"]),
        offset_nm=round(1e3 * document["offset_um"]),
        slope_nm_m=round(1e3 * document["slope_um_m"]),
        first_um=round(1e6 * places_m[0]),
        last_um=round(1e6 * places_m[-1]),
        error_nm=tuple(round(1e3 * error_um) for error_um in document["error_um"]),
    )
