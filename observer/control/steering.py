"""Write the compensation to a control, in a thread; release the control whenever in doubt.

It decides nothing. What the loop's compensation publishes as armed is written; the first document
that is not armed, a failed write and the end of the service release the control. A sign of life is only
sent with a document from the loop, so that to the control a stalled loop looks like a dead one.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import structlog

from drivers.control import AxisCorrection, ControlError, ControlLink

_ATTEMPTS = 2

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class _Job:
    """What to write, and until when; None releases the control."""

    correction: AxisCorrection | None
    until_s: float


class Steering:
    """Writes to one control; the loop never waits for it. `valid_s` is how long a document holds."""

    def __init__(self, control: ControlLink, valid_s: float) -> None:
        self._control = control
        self._valid_s = valid_s
        self._changed = threading.Condition()
        self._next: _Job | None = None
        self._closing = False
        self._armed = False
        self._failure: str | None = None
        self._written: AxisCorrection | None = None
        self._held = False
        self._thread = threading.Thread(target=self._live, name="control", daemon=True)
        self._thread.start()

    @property
    def failure(self) -> str | None:
        """Why the control does not follow, since it was armed last; None while it does."""
        if self._failure is None and not self._thread.is_alive():
            return "control: its thread has ended; restart the service"
        return self._failure

    def take(self, document: Mapping[str, Any]) -> None:
        """Take a document of the compensation; before one is armed, the control is not touched at all."""
        correction = correction_of(document) if document["armed"] else None
        with self._changed:
            if correction is None and not self._armed:
                return
            if not self._armed:
                self._failure = None
            self._armed = correction is not None
            self._next = _Job(correction, time.monotonic() + self._valid_s)
            self._changed.notify()

    def close(self, timeout_s: float) -> bool:
        """Release the control; False where that did not end in time, and its dead-man must do it."""
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
        except Exception as error:  # whatever it is, it is reported and the control released
            if not isinstance(error, ControlError):
                log.error("control failed", error=repr(error), exc_info=True)
            self._failure = f"control: {str(error) or type(error).__name__}"
            self._let_go()

    def _write(self, job: _Job, correction: AxisCorrection) -> None:
        """Verify what was written last, write, and verify again."""
        if self._written is not None:
            self._check(self._written)
        else:
            self._held = True
            self._control.open()
        if time.monotonic() > job.until_s:
            raise ControlError(f"nothing could be written for {self._valid_s:g} s")
        try:
            self._control.write(correction, self._valid_s)
        except ControlError as error:
            raise ControlError(f"{error}{self._why()}") from None
        self._check(correction)
        self._written = correction

    def _check(self, written: AxisCorrection) -> None:
        back = self._control.read_back()
        if back.reason is not None or not back.following:
            raise ControlError(f"it does not follow: {back.reason or 'it is off'}")
        if back.correction != written:
            raise ControlError(
                "it reads back something other than was written; find out what else writes to it"
            )

    def _why(self) -> str:
        """The control's own reason for refusing, if it gives one."""
        try:
            reason = self._control.read_back().reason
        except ControlError:
            return ""
        return f"; {reason}" if reason else ""

    def _let_go(self) -> None:
        """Release the control, once; where that fails, its dead-man does it."""
        self._written = None
        for _ in range(_ATTEMPTS if self._held else 0):
            try:
                self._control.release()
                break
            except ControlError as error:
                log.warning("control not released; its dead-man takes it to zero", error=str(error))
        self._held = False


class NoControl:
    """Writes nowhere, where no control is named."""

    failure: str | None = None

    def take(self, document: Mapping[str, Any]) -> None:
        """Leave a document out."""

    def close(self, _timeout_s: float) -> bool:
        """End at once."""
        return True


def correction_of(document: Mapping[str, Any]) -> AxisCorrection:
    """The document of an armed compensation in a control's whole numbers."""
    places_m = document["position_m"]
    return AxisCorrection(
        reference_um=round(1e6 * document["reference_m"]),
        offset_nm=round(1e3 * document["offset_um"]),
        slope_nm_m=round(1e3 * document["slope_um_m"]),
        first_um=round(1e6 * places_m[0]),
        last_um=round(1e6 * places_m[-1]),
        error_nm=tuple(round(1e3 * error_um) for error_um in document["error_um"]),
    )
