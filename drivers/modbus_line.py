"""The one connection to a Modbus address, shared by all drivers that read there; one request at a time.

A TCP reply carries the number of its request. An RTU reply carries only unit, function and number of
registers, so a late reply can be taken for that of another request. Devices answer in order. So after
an unanswered request none of the same shape follows until the unit has answered one of another shape.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from pymodbus.transport.serialtransport import create_serial_connection

from drivers.connecting import why_not_opened
from drivers.decode import MAX_REGISTERS
from drivers.modbus import ModbusAddress
from drivers.modbus_frames import (
    EXCEPTION_BIT,
    RTU_FRAMES,
    ModbusFrame,
    NotModbusError,
    Request,
    RtuFrames,
    TcpFrames,
)
from drivers.polled import RETRY_S, LostError
from drivers.protocol import Clock

CONNECT_TIMEOUT_S = 0.5  # a peer that returns between two attempts is found by the next
FORGET_S = 8.0  # after which a request is taken as lost, unless later replies have been seen
_LONGEST_QUIET_S = 10.0
_GAP_S = 0.02  # within which a reply that nothing asked for follows the one that was taken in its place
_DISTURBED_S = 30.0  # for which a line is watched longer, after such a reply
_RTU_TRIAL_EACH = 10  # silent requests on Modbus TCP between two trials with an RTU frame

_REMEDIES = {4: "look at its lamps and its manual", 6: "it is busy, so raise period_s"}
_CHECK_WIRE = "check unit_id, power and cable"

_LINES: dict[tuple[object, ...], Line] = {}


class DeviceExceptionError(Exception):
    """The device answered with a Modbus exception code.

    Attributes:
        code: The exception's code in the Modbus protocol; 2 is a register that the device does not have.
    """

    def __init__(self, code: int, request: Request) -> None:
        remedy = _REMEDIES.get(code, "check register, function and unit_id")
        super().__init__(f"the device answers {request} with Modbus exception {code}: {remedy}")
        self.code = code


class ModbusReply(NamedTuple):
    """The registers of a reply, and when its last bytes came.

    Attributes:
        words: Unsigned 16-bit integers in the order of the addresses.
        heard_s: The arrival in s of the service's clock.
    """

    words: list[int]
    heard_s: float


@dataclass
class _Unit:
    """The unanswered requests of a unit by shape, with the times of sending; times of the event loop."""

    unanswered: dict[tuple[int, int], float] = field(default_factory=dict)
    timed_out_s: float = 0.0
    latest_s: float = 0.0  # the longest time that a late reply took
    settled: asyncio.Event = field(default_factory=asyncio.Event)

    def sent(self, shape: tuple[int, int], sent_s: float, now_s: float) -> None:
        """Record a request without a reply."""
        self.unanswered[shape] = sent_s
        self.timed_out_s = now_s
        self.settled.clear()

    def answered(self, shape: tuple[int, int] | None = None) -> None:
        """Forget the requests up to that of this shape, or all of them."""
        limit_s = self.unanswered[shape] if shape else math.inf
        self.forget(limit_s)

    def forget(self, until_s: float) -> None:
        """Forget the requests sent up to a time."""
        self.unanswered = {s: sent_s for s, sent_s in self.unanswered.items() if sent_s > until_s}
        if not self.unanswered:
            self.settled.set()


class _Heard(NamedTuple):
    """A reply on a line without transaction numbers, and whether a request took it; time of the event
    loop.
    """

    heard_s: float
    frame: ModbusFrame
    is_taken: bool


@dataclass
class _Pending:
    """The request whose reply is awaited."""

    request: Request
    transaction: int
    reply: asyncio.Future[ModbusReply]
    mismatch: str | None = None  # a reply that came instead


class _Wire(asyncio.Protocol):
    """Hands received bytes on to its line, as long as the line uses this connection."""

    def __init__(self, line: Line) -> None:
        self.line: Line | None = line

    def data_received(self, data: bytes) -> None:
        """Hand bytes on."""
        if self.line is not None:
            self.line.received(data)

    def connection_lost(self, _error: Exception | None) -> None:
        """Report the end of the connection."""
        if self.line is not None:
            self.line.drop(self.line.closed_by_device)


def shared_line(address: ModbusAddress, now: Clock) -> Line:
    """Return the line of an address in the running event loop.

    The first caller makes it and others get the same one. `Line.join` begins its use, and `Line.leave` ends
    it.

    Args:
        address: Where the connection leads; its `place` is the key.
        now: The service's clock in s, which stamps replies.
    """
    key = asyncio.get_running_loop(), address.place
    return _LINES.setdefault(key, Line(address, now, key))


class Line:
    """A connection to one address, opened when it is needed.

    It belongs to one event loop. Drivers await their turn, so the device gets one request at a time.

    Attributes:
        unexpected: A sentence about a reply that does not answer a request of this line; None if there was
            not one. The reader of the sentence sets it back to None.
        has_numbers: Whether each reply carries the number of its request, as on Modbus TCP.
    """

    def __init__(self, address: ModbusAddress, now: Clock, key: tuple[object, ...]) -> None:
        self.unexpected: str | None = None  # a reply that no request of ours explains
        self.has_numbers = address.transport == "tcp"
        self._address = address
        self._now = now
        self._key = key
        self._turn = asyncio.Lock()
        self._wire: _Wire | None = None
        self._transport: asyncio.Transport | None = None
        self._frames: RtuFrames | TcpFrames = TcpFrames() if self.has_numbers else RtuFrames()
        self._transaction = 0
        self._pending: _Pending | None = None
        self._units: dict[int, _Unit] = {}
        self._users: Counter[int] = Counter()
        self._shapes: Counter[tuple[int, tuple[int, int]]] = Counter()
        self._failure: tuple[float, str] | None = None
        self._heard_at_s = 0.0  # by the event loop's clock
        self._heard: deque[_Heard] = deque(maxlen=64)
        self._disturbed_s = -math.inf
        self._slowest_s = 0.0  # of the replies
        self._silent = 0  # requests in a row without a single byte

    def join(self, unit: int) -> None:
        """Begin to read a unit here; each call needs one call of `leave`."""
        self._users[unit] += 1

    def leave(self, unit: int) -> None:
        """End the use of a unit; the last user's end closes the connection."""
        self._users = +(self._users - Counter([unit]))
        if not self._users:
            self.drop("closed")
            _LINES.pop(self._key, None)

    @property
    def _where(self) -> str:
        """The place in words: the serial port, or host and port."""
        address = self._address
        return address.host if address.transport == "serial" else f"{address.host}:{address.port}"

    @property
    def closed_by_device(self) -> str:
        """A sentence about a connection that its other end has closed."""
        return f"{self._where} has closed the connection; see whether it allows another client"

    @property
    def has_other_units(self) -> bool:
        """Whether a unit that does not answer would keep others waiting."""
        return len(self._users) > 1

    def reserve(self, request: Request, limit: int) -> Request:
        """Return the request, made longer where another of the unit has the same length.

        So each reply identifies its request. On Modbus TCP, and where every other length is taken, the
        request is unchanged.

        Args:
            request: The registers that are needed.
            limit: The most registers in one request.

        Returns:
            A request from the same register on. `release` gives its length back.
        """
        counts = range(request.count, min(limit, 0x10000 - request.first) + 1)
        used_counts = {c for c in counts if self._shapes[request.unit, (request.function, c)]}
        count = next((c for c in counts if c not in used_counts), request.count)
        chosen = (
            request if self.has_numbers else Request(request.unit, request.function, request.first, count)
        )
        self._shapes[chosen.unit, chosen.shape] += 1
        return chosen

    def release(self, request: Request) -> None:
        """Give the length of a reserved request back."""
        self._shapes[request.unit, request.shape] -= 1

    async def open(self) -> None:
        """Connect once, unless the connection is open.

        Raises:
            LostError: If that fails, with the reason; again without an attempt for `RETRY_S`.
        """
        async with self._turn:
            await self._open()

    async def read(self, request: Request, timeout_s: float, quiet_s: float) -> ModbusReply:
        """Read registers in this caller's turn.

        After a missing RTU reply no request goes to the unit for `quiet_s`, or for as long as its latest
        reply has taken. A silent TCP connection is closed, and the next call opens it again.

        Args:
            request: The registers; on RTU a request that `reserve` returned.
            timeout_s: The longest wait for the reply, in s, from sending on.
            quiet_s: The shortest silence, in s, after a missing RTU reply.

        Returns:
            The registers of the reply, with its arrival.

        Raises:
            LostError: If there is no connection or no reply that fits. Its fault is `disconnected`,
                `timeout`, `bad_reply` or `rtu_frames`.
            DeviceExceptionError: If the device rejects the request.
        """
        unit = self._units.setdefault(request.unit, _Unit())
        if not self.has_numbers:
            await self._settle(unit, quiet_s)
        async with self._turn:
            await self._open()
            if not self.has_numbers:
                await self._tell_apart(request, unit, timeout_s)
            return await self._exchange(request, unit, timeout_s)

    async def last_replies(self, requests: Iterable[Request], period_s: float) -> None:
        """Wait until a reply for which another was taken would have come.

        Modbus TCP has no such replies, so the call returns at once.

        Args:
            requests: The requests of the poll.
            period_s: The period of the polls in s; on a quiet line the wait is at most a tenth of it.
        """
        if self.has_numbers:
            return
        if self._is_disturbed() or any(self._has_twin(request) for request in requests):
            await asyncio.sleep(max(_GAP_S, 2.0 * self._slowest_s))
        else:
            await asyncio.sleep(min(_GAP_S, 0.1 * period_s))

    def is_ambiguous(self, request: Request, since_s: float) -> bool:
        """Whether the reply taken since `since_s` may have been meant for another request.

        This is so if other replies that fit have come and differ, or if two requests look alike and
        unrequested replies have come.

        Args:
            request: The request whose reply was taken.
            since_s: The start of the poll in s of the event loop's clock.
        """
        if self._has_twin(request) and self._is_disturbed():
            return True
        frames: tuple[list[ModbusFrame], list[ModbusFrame]] = [], []
        for heard_s, frame, is_taken in self._heard:
            if heard_s >= since_s and frame.unit == request.unit and frame.shape == request.shape:
                frames[is_taken].append(frame)
        return any(stray.data != accepted.data for stray in frames[False] for accepted in frames[True])

    def _has_twin(self, request: Request) -> bool:
        """Whether another request of the unit has the same shape, so that their replies cannot be
        distinguished.
        """
        return not self.has_numbers and self._shapes[request.unit, request.shape] > 1

    def _is_disturbed(self) -> bool:
        """Whether an unrequested reply has come within the last `_DISTURBED_S`."""
        return self._heard_at_s - self._disturbed_s < _DISTURBED_S

    def received(self, data: bytes) -> None:
        """Take bytes that have arrived, and give each complete frame to the request that waits for it.

        Bytes that are not Modbus end the connection.
        """
        self._heard_s = self._now()
        self._heard_at_s = asyncio.get_running_loop().time()
        self._silent = 0
        try:
            frames = self._frames.feed(data)
        except NotModbusError as error:
            self.drop(str(error), "rtu_frames" if str(error) == RTU_FRAMES else "bad_reply")
            return
        for frame in frames:
            self._take(frame)

    def drop(self, why: str, fault: str = "disconnected") -> None:
        """End the connection; a request that waits for its reply fails with `LostError`.

        Args:
            why: The sentence of that error.
            fault: The fault of the channels.
        """
        wire, transport = self._wire, self._transport
        self._wire = self._transport = None
        if wire is not None:
            wire.line = None
        if transport is not None:
            transport.abort()
        self._fail(LostError(fault, why))

    async def _open(self) -> None:
        """Open the port or the connection, unless it is open.

        Raises `LostError`; for `RETRY_S` after a failure it is raised at once, with the same reason.
        """
        if self._transport is not None:
            return
        loop, address = asyncio.get_running_loop(), self._address
        if self._failure is not None and loop.time() - self._failure[0] < RETRY_S:
            raise LostError("disconnected", self._failure[1])
        wire = _Wire(self)
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                if address.transport == "serial":
                    transport, _ = await create_serial_connection(
                        loop, lambda: wire, address.host, bytesize=8, timeout=0.0, **address.line
                    )
                else:
                    transport, _ = await loop.create_connection(lambda: wire, address.host, address.port)
        except (OSError, ValueError) as error:  # a time-out is an OSError
            self._failure = loop.time(), why_not_opened(error, self._where)
        else:
            self._failure = None
            self._wire, self._transport = wire, transport
            self._frames = TcpFrames() if self.has_numbers else RtuFrames()
            return
        raise LostError("disconnected", self._failure[1])

    async def _settle(self, unit: _Unit, quiet_s: float) -> None:
        """After a missing reply, wait until it has come or is too late even for this unit."""
        loop = asyncio.get_running_loop()
        if not unit.unanswered:
            return
        latest_s = min(1.2 * unit.latest_s, _LONGEST_QUIET_S)
        until_s = max(unit.timed_out_s + quiet_s, max(unit.unanswered.values()) + latest_s)
        try:
            async with asyncio.timeout_at(until_s):
                await unit.settled.wait()
        except TimeoutError:
            unit.latest_s *= 0.8
        if self._heard_at_s + _GAP_S > loop.time():
            await asyncio.sleep(_GAP_S)

    async def _tell_apart(self, request: Request, unit: _Unit, timeout_s: float) -> None:
        """Make sure that no reply to an earlier request can be taken for the reply to this one.

        If one could, a request of another length is exchanged first. Raises `LostError` if that does not
        help.
        """
        loop = asyncio.get_running_loop()
        unit.forget(loop.time() - max(FORGET_S, 2.0 * unit.latest_s))
        if request.shape in unit.unanswered:
            counts = [*range(1, request.count), *range(request.count + 1, MAX_REGISTERS + 1)]
            count = next(c for c in counts if (request.function, c) not in unit.unanswered)
            first = min(request.first, 0x10000 - count)
            with contextlib.suppress(DeviceExceptionError):
                await self._exchange(Request(request.unit, request.function, first, count), unit, timeout_s)
            if request.shape in unit.unanswered:
                raise LostError(
                    "timeout", f"{request} must wait for the reply to an earlier one; {_CHECK_WIRE}"
                )

    async def _exchange(self, request: Request, unit: _Unit, timeout_s: float) -> ModbusReply:
        """Send a request and await its reply. Raises `LostError` or `DeviceExceptionError`."""
        if self._transport is None:
            raise LostError("disconnected", self.closed_by_device)
        loop = asyncio.get_running_loop()
        self._transaction = self._transaction % 0xFFFF + 1 if self.has_numbers else 0
        pending = self._pending = _Pending(request, self._transaction, loop.create_future())
        self._frames.reset()
        sent_s = loop.time()
        self._transport.write(self._frames.encode(request, self._transaction))
        try:
            await asyncio.wait({pending.reply}, timeout=timeout_s)
            if pending.reply.done():
                self._slowest_s = max(0.9 * self._slowest_s, self._heard_at_s - sent_s)
                return pending.reply.result()
        finally:
            self._pending = None
            if not pending.reply.done() and not self.has_numbers:
                unit.sent(request.shape, sent_s, loop.time())
        if self._heard_at_s < sent_s:
            await self._nothing_heard(request, timeout_s)
        if pending.mismatch is not None:
            raise LostError("bad_reply", pending.mismatch)
        raise LostError("timeout", f"no answer within {timeout_s:g} s to {request}; {_CHECK_WIRE}")

    async def _nothing_heard(self, request: Request, timeout_s: float) -> None:
        """Close a silent TCP connection, after testing with one RTU frame whether the device uses RTU.

        Raises `LostError` with the fault `rtu_frames` if the device answers that frame.
        """
        self._silent += 1
        if self._address.transport == "serial" or (self.has_other_units and self._silent < 2):
            return
        if self.has_numbers and self._silent % _RTU_TRIAL_EACH in (1, 2) and self._transport is not None:
            trial = Request(request.unit, request.function, max(request.first, 1), 1)  # no Modbus TCP, ever
            pending = self._pending = _Pending(trial, -1, asyncio.get_running_loop().create_future())
            self._transport.write(RtuFrames().encode(trial, 0))
            try:
                await asyncio.wait({pending.reply}, timeout=min(timeout_s, CONNECT_TIMEOUT_S))
                error = pending.reply.exception() if pending.reply.done() else None
            finally:
                self._pending = None
            if isinstance(error, LostError) and error.fault == "rtu_frames":
                raise error
        self.drop(f"{self._where} sends nothing; {_CHECK_WIRE}")

    def _take(self, frame: ModbusFrame) -> None:
        """Give a frame to the request that it answers, or record it as unrequested."""
        pending = self._pending
        unit = self._units.setdefault(frame.unit, _Unit())
        if pending is None or pending.reply.done() or not frame.answers(pending.request, pending.transaction):
            self._stray(frame, unit)
            return
        self._heard.append(_Heard(self._heard_at_s, frame, True))
        if frame.exception is None:
            unit.answered()
            pending.reply.set_result(ModbusReply(frame.words(), self._heard_s))
            return
        if not unit.latest_s:  # else it may be the late reply to an earlier request
            unit.answered()
        self._fail(DeviceExceptionError(frame.exception, pending.request))

    def _stray(self, frame: ModbusFrame, unit: _Unit) -> None:
        """Record a frame that does not answer the pending request: a late one, a duplicate, or another
        master's.
        """
        shape: tuple[int, int] | None = frame.shape
        if frame.exception is not None:  # to the oldest of its function
            shape = next((s for s in unit.unanswered if s[0] == frame.function ^ EXCEPTION_BIT), None)
        if shape in unit.unanswered:
            unit.latest_s = max(unit.latest_s, self._heard_at_s - unit.unanswered[shape])
            unit.answered(shape)
            return
        pending = self._pending
        if not self.has_numbers and frame.exception is None:
            self._heard.append(_Heard(self._heard_at_s, frame, False))
            self._disturbed_s = self._heard_at_s
            self.unexpected = f"an unrequested reply of unit {frame.unit} came; look for a second master"
        if pending is None or frame.unit not in (pending.request.unit, 0):
            return
        if self.has_numbers and 0 < frame.transaction < pending.transaction:
            return  # late, and harmless
        pending.mismatch = (
            f"the reply to {pending.request}, transaction {pending.transaction}, has function "
            f"{frame.function}, {frame.shape[1]} registers, transaction {frame.transaction}; look for a "
            "second master"
        )
        if self.has_numbers and frame.transaction == pending.transaction:
            self._fail(LostError("bad_reply", pending.mismatch))

    def _fail(self, error: Exception) -> None:
        if self._pending is not None and not self._pending.reply.done():
            self._pending.reply.set_exception(error)
