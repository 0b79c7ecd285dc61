"""Frames from an open bus, and the signs that it has ended: an interface that no longer waits, or silence.

python-can does not report the end of a stream. An interface whose peer is gone may raise, stay silent, or
return at once without a frame, for ever. Each of these ends the reading here, and the driver opens the bus
again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Literal

import can

Take = Callable[[can.Message | None], None]  # None: something arrived that is not a frame

_MOST_HASTY = 100  # answers in a row that neither wait nor give a frame
# Interfaces whose error frames have the form of Linux (`linux/can/error.h`).
_LINUX_ERRORS = {"socketcan", "socketcand", "udp_multicast", "virtual", "gs_usb"}
_CONTROLLER, _BUS_OFF, _RESTARTED = 0x04, 0x40, 0x100
_PASSIVE, _ACTIVE = 0x30, 0x40

BusError = Literal["error frames", "error-passive", "bus-off"]


class EndedBusError(can.CanError):
    """The interface gives no more frames."""


class SilentBusError(can.CanError):
    """No frame has come for longer than the allowed silence."""


class BusReader:
    """Takes frames off an open bus, which may be silent for at most `silence_s`.

    `take` receives each frame, or None for bytes that are not a frame.

    It is used in one thread. Each opened bus needs a new reader.

    Attributes:
        bus: The open bus; a pump may send on it.
        has_read: Whether a frame other than an error frame has come.
    """

    def __init__(self, bus: can.BusABC, take: Take, silence_s: float) -> None:
        self.bus = bus
        self.has_read = False
        self._take = take
        self._silence_s = silence_s
        self._heard_s = time.monotonic()
        self._hasty = 0

    def read(self, timeout_s: float) -> None:
        """Wait at most `timeout_s` for a frame and hand it to `take`.

        Error frames are handed on too, but they do not end a silence.

        Raises:
            EndedBusError: If the interface has returned at once without a frame a hundred times in a row.
            SilentBusError: If no frame has come for longer than the allowed silence.
            Exception: Whatever the interface raises when its device or server has gone.
        """
        begin_s = time.monotonic()
        frame = self._received(timeout_s)
        now_s = time.monotonic()
        if frame is not None:
            self._hasty = 0
            if not frame.is_error_frame:
                self.has_read, self._heard_s = True, now_s
            self._take(frame)
            return
        self._hasty = self._hasty + 1 if now_s - begin_s < 0.5 * timeout_s else 0
        if self._hasty >= _MOST_HASTY:
            raise EndedBusError(
                f"{self.bus.channel_info} no longer waits for frames: plug its adapter in again, or restart "
                "its server"
            )
        if now_s - self._heard_s > self._silence_s:
            raise SilentBusError(
                f"no frame has come for {self._silence_s:g} s; check power, cable and bit rate of the bus"
            )

    def _received(self, timeout_s: float) -> can.Message | None:
        """Return a frame, or None if none came.

        This calls `_recv_internal`, because `recv` would call an interface that has ended without pause.
        """
        try:
            frame, _ = self.bus._recv_internal(timeout_s)
        except (ValueError, IndexError):  # a garbled line of a serial adapter; the next one is independent
            self._take(None)
            return None
        return frame


def bus_error(frame: can.Message, interface: str) -> BusError | None:
    """Return the state that an error frame reports.

    The bits are those of Linux (`linux/can/error.h`). Interfaces that do not use them give `error frames`.

    Args:
        frame: An error frame.
        interface: The interface's name in python-can.

    Returns:
        The state; None if the controller reports that it takes part again.
    """
    if interface not in _LINUX_ERRORS:
        return "error frames"
    if frame.arbitration_id & _BUS_OFF:
        return "bus-off"
    flags = frame.data[1] if frame.arbitration_id & _CONTROLLER and len(frame.data) > 1 else 0
    if flags & _PASSIVE:
        return "error-passive"
    return None if frame.arbitration_id & _RESTARTED or flags & _ACTIVE else "error frames"
