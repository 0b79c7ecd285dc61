"""CAN: a live bus that is reopened for ever."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Any

import can
from can.interfaces.slcan import slcanBus

from drivers.can_reader import BusReader, SilentBusError, Take, bus_error
from drivers.connecting import why_not_opened
from drivers.places import CanTable
from drivers.protocol import Clock, Decoded, Deliver, DriverStatus, faulty
from drivers.socketcand import SocketcandBus
from drivers.stamps import DeviceClock, wall_time
from observer.frames import Reading

# What python-can logs about a lost bus also comes as the exceptions below, counted in the status.
logging.getLogger("can").setLevel(logging.CRITICAL)

RETRY_S = 0.25  # before a lost bus is opened again, doubled while that fails, up to
MOST_RETRY_S = 5.0
ERROR_S = 10.0  # how long after the last error frame a bus counts as disturbed
RECEIVE_TIMEOUT_S = 0.1  # how soon the receiving thread sees that it is to end
MAX_PENDING = 10_000  # frames that may wait for a busy event loop

# Whose stamps are of this computer's clock: the kernel's, or what python-can puts in the place of none.
WALL_CLOCKED = {"socketcan", "udp_multicast", "virtual", "robotell", "iscan", "neousys"}
SLCAN_TURN_S = 60.0  # an adapter counts the milliseconds of a minute
_SLCAN_TURN_MS = 60_000
_SLCAN_STAMP_DIGITS = 4
# When the counter of an interface wraps.
TURNS_S = {"slcan": SLCAN_TURN_S, "serial": 2**32 * 1e-3, "gs_usb": 2**32 * 1e-6}

Pump = Callable[[BusReader, threading.Event], None]
Decode = Callable[[can.Message], Decoded | None]  # values and faults; None where a frame holds none
Stamps = Callable[[float, float], float]  # stamp and arrival to the time on the wire


def stamps_of(wire: CanTable) -> Stamps:
    """Return a function from a frame's stamp and arrival to its time, all in s.

    It keeps the state of the adapter's clock, so a new one is made each time the bus is opened.

    Interfaces of `WALL_CLOCKED` stamp with this computer's clock. Any other stamps with the clock of its
    device, whose offset is estimated from the frames.

    Args:
        wire: The table of the bus; its interface and the option `preserve_timestamps` decide.

    Returns:
        A function whose result is never later than the arrival.
    """
    sender_stamped = bool(wire.options.get("preserve_timestamps"))  # of `virtual`: they are of whoever sent
    if wire.interface in WALL_CLOCKED and not sender_stamped:
        return lambda stamp_s, arrival_s: wall_time(stamp_s, arrival_s, time.time())
    return DeviceClock(TURNS_S.get(wire.interface)).time_s


def receive(reader: BusReader, stop: threading.Event) -> None:
    """Take every frame off the bus, without ever sending one, until `stop` is set.

    It raises what `BusReader.read` raises. Setting `stop` ends it within `RECEIVE_TIMEOUT_S`.

    Args:
        reader: The open bus.
        stop: Set by the event loop's thread when the driver is to end.
    """
    while not stop.is_set():
        reader.read(RECEIVE_TIMEOUT_S)


class BusDriver:
    """Channels that arrive on a CAN bus.

    python-can blocks. So a thread receives the frames, determines their times, and hands them to the event
    loop. The function `decode` turns a frame into values and faults, and `pump` moves frames from the bus.
    Each period, a channel that is overdue gets a faulty reading.

    A lost or silent bus is opened again: after `RETRY_S` at first, after up to `MOST_RETRY_S` while that
    fails. More than `MAX_PENDING` frames that wait for the event loop are dropped and counted.

    Args:
        name: The driver's name in the configuration, and part of its thread's name.
        wire: The table of the bus.
        decode: Called on the event loop's thread; None for a frame without a channel.
        pump: Called in the driver's thread with the open bus; it returns when its event is set.
    """

    def __init__(self, name: str, wire: CanTable, decode: Decode, pump: Pump = receive) -> None:
        self.name = name
        self.channels = wire.delivered or ()
        self.period_s = wire.period_s
        self.status = DriverStatus()
        self._bus = wire
        self._decode = decode
        self._pump = pump
        self._stamps = stamps_of(wire)
        self._pending = 0
        self._heard_s: dict[str, float] = {}
        self._error_s = self._frame_s = 0.0

    async def run(self, deliver: Deliver, now: Clock) -> None:
        """Deliver a reading for every frame that holds a channel, and a fault for every overdue channel,
        until cancelled.

        The fault of an overdue channel is `silent` while the bus is open, else `disconnected`. After
        cancellation the thread has 0.25 s to close the bus; a hanging interface is left to its daemon thread.

        Raises:
            RuntimeError: If the driver's thread ended by a defect.
        """
        loop = asyncio.get_running_loop()
        stop, ended = threading.Event(), asyncio.Event()
        start_s = loop.time()
        self._heard_s = dict.fromkeys(self.channels, start_s)

        def post(call: Callable[..., None], *arguments: Any) -> None:
            try:
                loop.call_soon_threadsafe(call, *arguments)
            except RuntimeError:  # the event loop is gone, and with it everyone who would listen
                stop.set()

        def on_frame(frame: can.Message | None) -> None:
            arrival_s = now()
            if frame is None:
                post(self._garbled, "a garbled frame")
            elif self._pending >= MAX_PENDING:
                post(self._dropped)
            else:
                self._pending += 1
                post(self._on_frame, frame, self._stamps(frame.timestamp, arrival_s), deliver)

        def run_thread() -> None:
            try:
                self._keep_open(on_frame, post, stop)
            finally:
                post(ended.set)

        threading.Thread(target=run_thread, name=f"can {self.name}", daemon=True).start()
        try:
            await self._watch(deliver, now, ended)
        finally:
            stop.set()
            # A driver that hangs while it opens its device must not hold up the end of the program.
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(ended.wait(), timeout=0.25)

    def _keep_open(self, take: Take, post: Callable[..., None], stop: threading.Event) -> None:
        """Open the bus and pump it; open it again when it is lost or silent. Runs in the driver's thread."""
        delay_s = RETRY_S
        while not stop.is_set():
            reader = None
            try:
                with open_bus(self._bus) as bus:
                    self._stamps = stamps_of(self._bus)
                    reader = BusReader(bus, take, self._bus.longest_silence_s)
                    post(self._opened)
                    self._pump(reader, stop)
            except SilentBusError as error:
                post(self._silenced, str(error))
            except Exception as error:  # noqa: BLE001  (an interface may raise anything, and is opened again)
                reason = str(error) or type(error).__name__
                post(self._failed, reason if reader else why_not_opened(error, self._bus.channel))
                has_read = reader is not None and reader.has_read
                delay_s = RETRY_S if has_read else min(2.0 * delay_s, MOST_RETRY_S)
            stop.wait(delay_s)

    async def _watch(self, deliver: Deliver, now: Clock, ended: asyncio.Event) -> None:
        """Each period, report every overdue channel."""
        loop = asyncio.get_running_loop()
        while not ended.is_set():
            await asyncio.sleep(self.period_s)
            limit_s = loop.time() - self._bus.silence_s
            overdue = [name for name, heard_s in self._heard_s.items() if heard_s < limit_s]
            if overdue:
                is_open = self.status.state != "disconnected"
                deliver(faulty(overdue, "silent" if is_open else "disconnected", now()))
            if self.status.bus_error and self._error_s < min(self._frame_s, loop.time() - ERROR_S):
                self.status = dataclasses.replace(self.status, bus_error=None)
        raise RuntimeError(f"driver {self.name}: its thread ended unexpectedly; see the error above")

    def _on_frame(self, frame: can.Message, time_s: float, deliver: Deliver) -> None:
        """Decode a received frame on the event loop, deliver its reading, and update the status."""
        self._pending -= 1
        heard_s = asyncio.get_running_loop().time()
        if frame.is_error_frame:
            self._error_s = heard_s
            self.status = self.status.with_bus_error(bus_error(frame, self._bus.interface))
            return
        self._frame_s = heard_s
        if self.status.state == "silent":
            self.status = self.status.opened()
        decoded = self._decode(frame)
        if decoded is None or not decoded[0]:
            return
        values, faults = decoded
        self._heard_s.update(dict.fromkeys(values, heard_s))
        if "short_frame" in faults.values():
            self._garbled(f"short frame {frame.arbitration_id:#x}")
        deliver(Reading(time_s, values, faults))

    def _opened(self) -> None:
        if self.status.state != "silent":  # a silent bus is connected once a frame has come
            self.status = self.status.opened()

    def _silenced(self, reason: str) -> None:
        self.status = self.status.silenced(reason)

    def _failed(self, error: str) -> None:
        self.status = self.status.failed(error)

    def _garbled(self, error: str) -> None:
        status = self.status
        self.status = dataclasses.replace(status, errors=status.errors + 1, last_error=error)

    def _dropped(self) -> None:
        self.status = dataclasses.replace(self.status, drops=self.status.drops + 1)


def open_bus(wire: CanTable) -> can.BusABC:
    """Open the bus, in listen-only mode where the interface has one.

    The options of the table override those chosen here.

    Returns:
        The open bus of python-can; the caller closes it, best by `with`.

    Raises:
        Exception: Whatever the interface raises if its device or server is missing.
    """
    options: dict[str, Any] = {}
    if wire.interface == "slcan":
        # No two seconds of sleep, whose frames would then pass for new, and a read that waits, not spins.
        options = {"sleep_after_open": 0.0, "timeout": RECEIVE_TIMEOUT_S / 2, "listen_only": wire.listens}
    elif wire.interface == "pcan" and wire.listens:
        options = {"state": can.BusState.PASSIVE}
    if wire.bitrate is not None:
        options["bitrate"] = wire.bitrate
    options |= wire.options
    if wire.interface == "slcan":
        return StampedSlcanBus(channel=wire.channel, **options)
    if wire.interface == "socketcand":
        return SocketcandBus(channel=wire.channel, **options)
    return can.Bus(channel=wire.channel, interface=wire.interface, **options)


class StampedSlcanBus(slcanBus):
    """A serial CAN adapter of the Lawicel kind, with the time stamps that it appends to its lines.

    python-can skips these stamps and gives every frame the time at which it was read. Here `timestamp` is the
    adapter's stamp in s, or NaN if the line has no stamp.
    """

    _line: str | None = None

    def _read(self, timeout: float | None) -> str | None:
        self._line = super()._read(timeout)
        return self._line

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message, filtered = super()._recv_internal(timeout)
        if message is not None:
            message.timestamp = stamp_of(self._line or "", message)
        return message, filtered


def stamp_of(line: str, message: can.Message) -> float:
    """Return the stamp at the end of a frame's line, in s of the adapter's minute.

    The Lawicel protocol appends the milliseconds of the minute as four hexadecimal digits if its time stamps
    are switched on.

    Args:
        line: The adapter's line, with or without its carriage return.
        message: The frame of that line; its length gives the place of the stamp.

    Returns:
        Seconds from 0 to less than 60; NaN if the line has no valid stamp.
    """
    data = 0 if message.is_remote_frame else 2 * message.dlc
    digits = line.rstrip("\r")[(10 if message.is_extended_id else 5) + data :]
    try:
        count_ms = int(digits, 16)
    except ValueError:
        return math.nan
    return 1e-3 * count_ms if len(digits) == _SLCAN_STAMP_DIGITS and count_ms < _SLCAN_TURN_MS else math.nan
