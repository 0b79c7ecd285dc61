"""One driver's use of a Modbus line: the requests that read its registers, and the effect of each failure.

A request that fails affects its own channels only. A request that the device rejects is split until the
rejected registers are alone. A request without an answer is sent last, and less and less often where it
delays others.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from math import nan

from drivers.decode import RegisterBlock, decode, order_hint, plan_of, spans
from drivers.modbus import ModbusTable
from drivers.modbus_frames import FUNCTIONS, Request
from drivers.modbus_line import DeviceExceptionError, Line, shared_line
from drivers.places import ModbusChannel
from drivers.polled import LostError
from drivers.protocol import Clock
from observer.frames import Reading

_SPLIT_ON = (2, 3, 4)  # exceptions that a part of a request may have caused
_NO_ANSWER = (10, 11)  # a gateway's, in the name of a unit that does not answer
_PAUSE, _LONGEST_PAUSE_S = 10.0, 60.0  # time-outs between two trials of what did not answer
_SPLIT_AGAIN_S = 10.0  # after a device has refused every part


@dataclass(eq=False)
class _RegisterRange:
    """Registers that one request reads, with the outcome of its last attempts."""

    registers: RegisterBlock
    parts: tuple[RegisterBlock, ...]  # the values in it, none of which may be torn
    request: Request
    failures: int = 0  # time-outs in a row
    retry_s: float = 0.0  # not to be asked before, by the event loop's clock
    fault: str = "timeout"
    answered: bool = False
    trials: int = 0


@dataclass
class _Poll:
    """The registers, faults and counts of one poll so far."""

    words: dict[str, dict[int, int]] = field(default_factory=lambda: {name: {} for name in FUNCTIONS})
    faults: dict[str, dict[int, str]] = field(default_factory=lambda: {name: {} for name in FUNCTIONS})
    heard_s: float | None = None
    answers: int = 0  # replies with registers
    refusals: int = 0
    timeouts: int = 0
    problem: LostError | DeviceExceptionError | None = None

    def take(self, registers: RegisterBlock, words: list[int], heard_s: float) -> None:
        """Store the registers of a reply."""
        self.answers += 1
        self.heard_s = heard_s
        self.words[registers.function] |= {registers.first + i: word for i, word in enumerate(words)}

    def drop(self, registers: RegisterBlock, fault: str) -> None:
        """Discard registers that were read, and record their fault."""
        for number in range(registers.first, registers.first + registers.count):
            self.words[registers.function].pop(number, None)
        self.fail(registers, fault)

    def fail(self, registers: RegisterBlock, fault: str) -> None:
        """Record the fault of registers that were not read."""
        numbers = range(registers.first, registers.first + registers.count)
        self.faults[registers.function] |= dict.fromkeys(numbers, fault)


async def connect(table: ModbusTable, now: Clock) -> ModbusSession:
    """Connect once to the table's address.

    Args:
        table: The device and its channels.
        now: The service's clock in s.

    Returns:
        An open session. Drivers of the same address share its connection.

    Raises:
        LostError: If the connection cannot be opened; the text gives the remedy.
    """
    session = ModbusSession(table, now)
    try:
        await session.open()
    except BaseException:
        await session.close()
        raise
    return session


class ModbusSession:
    """The registers of one unit, read over the line of its address.

    Attributes:
        problem: A sentence about the last poll, such as a rejected register or a doubtful byte order; None if
            all is well.
    """

    def __init__(self, table: ModbusTable, now: Clock) -> None:
        self.problem: str | None = None
        self._now = now
        self._table = table
        self._places = table.map()
        self._line: Line | None = shared_line(table.address, now)
        self._line.join(table.unit_id)
        self._blocks = self._planned(self._required_blocks())
        self._split_from_s = 0.0
        self._doubt: str | None = None  # a value that seems to have another byte order
        self._silent_polls = 0  # in a row, without any answer
        self._retry_s = 0.0  # the unit is not to be asked before, by the event loop's clock
        self._silence = LostError("timeout", "no answer yet")

    def _required_blocks(self) -> set[RegisterBlock]:
        return {span for channel in self._places.values() for span in spans(channel)}

    def _planned(self, required: set[RegisterBlock]) -> list[_RegisterRange]:
        """Return the requests that read these blocks.

        On RTU their lengths differ, since a reply identifies its request only by the length.
        """
        blocks = []
        for registers in plan_of(required, self._table.max_registers):
            parts = tuple(
                span
                for span in sorted(required, key=lambda s: s.first)
                if span.function == registers.function
                and registers.first <= span.first <= registers.first + registers.count - span.count
            )
            blocks.append(_RegisterRange(registers, parts, self._reserved(registers)))
        return blocks

    def _reserved(self, registers: RegisterBlock) -> Request:
        exact = self._exact(registers)
        return exact if self._line is None else self._line.reserve(exact, self._table.max_registers)

    def _exact(self, registers: RegisterBlock) -> Request:
        return Request(self._table.unit_id, FUNCTIONS[registers.function], registers.first, registers.count)

    def _release(self, blocks: list[_RegisterRange]) -> None:
        for block in blocks:
            if self._line is not None:
                self._line.release(block.request)

    async def open(self) -> None:
        """Connect once, unless another driver has opened the connection.

        Raises:
            LostError: If the connection cannot be opened.
        """
        if self._line is not None:
            await self._line.open()

    async def close(self) -> None:
        """End the use of the line; the last driver's end closes the connection.

        A second call has no effect.
        """
        if self._line is not None:
            self._release(self._blocks)
            self._line.leave(self._table.unit_id)
            self._line = None

    async def ask(self) -> list[Reading]:
        """Return one reading of every channel; a channel with an unread register has the fault of its
        request.

        The reading's time is the arrival of the last reply. The module sampled before that, but the middle
        between request and reply is nearer by milliseconds only. That middle may also lie before a fault
        already delivered for this period.

        After two time-outs in a poll, or more time-outs than replies, the remaining requests wait for the
        next poll.

        Raises:
            LostError: If nothing has answered. It has a faulty reading and `lasts`, unless the connection is
                gone.
        """
        poll = _Poll()
        now_s = asyncio.get_running_loop().time()
        waiting = sorted(self._blocks, key=lambda block: block.failures)
        if now_s < self._retry_s:
            raise self._silent_unit(poll)
        while waiting:
            block = waiting.pop(0)
            if block.retry_s > now_s or poll.timeouts > poll.answers + poll.refusals or poll.timeouts > 1:
                poll.fail(block.registers, block.fault)
            else:
                waiting[:0] = await self._read(block, poll)
        await self._refuse_ambiguous(poll, now_s)
        return self._ended(poll)

    async def _refuse_ambiguous(self, poll: _Poll, since_s: float) -> None:
        """Discard registers whose reply may have been meant for another request."""
        if self._line is None or not poll.answers:
            return
        await self._line.last_replies((block.request for block in self._blocks), self._table.period_s)
        for block in self._blocks:
            if self._line.is_ambiguous(block.request, since_s):
                poll.drop(block.registers, "bad_reply")
                poll.problem = LostError(
                    "bad_reply",
                    f"unrequested replies look like those to {block.request}; look for a second master",
                )

    def _silent_unit(self, poll: _Poll) -> LostError:
        """Return the error of a poll without any answer, with its faulty reading."""
        if isinstance(poll.problem, LostError):
            self._silence = poll.problem
        for block in self._blocks:
            poll.fail(block.registers, self._silence.fault)
            block.retry_s = 0.0
        error = LostError(self._silence.fault, str(self._silence))
        error.readings, error.lasts = [self._reading(poll)], True
        return error

    def _ended(self, poll: _Poll) -> list[Reading]:
        """Return the reading of a poll. Raises `LostError` if nothing has answered."""
        readings = [self._reading(poll)]
        if not poll.answers and poll.refusals:
            self._release(self._blocks)
            self._blocks = self._planned(self._required_blocks())
            self._split_from_s = asyncio.get_running_loop().time() + _SPLIT_AGAIN_S
        if not poll.answers and not poll.refusals:
            self._silent_polls += 1
            if self._line is not None and self._line.has_other_units and self._silent_polls > 1:
                self._retry_s = asyncio.get_running_loop().time() + self._pause_s(self._silent_polls)
            raise self._silent_unit(poll)
        self._silent_polls = 0
        unexpected = self._line.unexpected if self._line is not None else None
        self.problem = str(poll.problem) if poll.problem is not None else self._doubt or unexpected
        if self._line is not None:
            self._line.unexpected = None
        return readings

    async def _read(self, block: _RegisterRange, poll: _Poll) -> list[_RegisterRange]:
        """Read a block; return the blocks to request at once in its place. Raises `LostError` if
        disconnected.
        """
        if block.failures and not poll.answers and len(block.parts) > 1:
            part = block.parts[block.trials % len(block.parts)]
            block.trials += 1
            if not await self._answers(part, poll):
                block.failures += 1
                poll.fail(block.registers, block.fault)
                return []
        try:
            words, heard_s = await self._reply_to(block.request)
        except DeviceExceptionError as error:
            return self._refused(block, error, poll)
        except LostError as error:
            if error.fault == "disconnected":
                raise
            self._silent(block, error, poll)
            return []
        block.failures, block.retry_s, block.answered = 0, 0.0, True
        poll.take(block.registers, words[: block.registers.count], heard_s)
        return []

    async def _answers(self, part: RegisterBlock, poll: _Poll) -> bool:
        """Whether the unit answers a request for a single value. Raises `LostError` if disconnected."""
        try:
            words, heard_s = await self._reply_to(self._exact(part))
            poll.take(part, words, heard_s)
        except DeviceExceptionError as error:
            poll.refusals += 1
            poll.problem = error
        except LostError as error:
            if error.fault == "disconnected":
                raise
            poll.timeouts += 1
            poll.problem = error
            return False
        return True

    async def _reply_to(self, request: Request) -> tuple[list[int], float]:
        """Return the registers of a reply and its arrival in s. Raises `LostError` or
        `DeviceExceptionError`.
        """
        if self._line is None:
            raise LostError("disconnected", "the connection is closed")
        return await self._line.read(request, self._table.timeout_s, self._table.quiet_s)

    def _refused(
        self, block: _RegisterRange, error: DeviceExceptionError, poll: _Poll
    ) -> list[_RegisterRange]:
        """Return the blocks to request in place of one that the device rejects."""
        if error.code in _NO_ANSWER:
            self._silent(block, LostError(f"exception_{error.code}", str(error)), poll)
            return []
        block.failures, block.retry_s = 0, 0.0
        if error.code in _SPLIT_ON:
            if self._is_widened(block):
                self._narrow(block)
                return [block]
            if len(block.parts) > 1 and asyncio.get_running_loop().time() >= self._split_from_s:
                return self._split(block)
        poll.refusals += 1
        poll.problem = error
        poll.fail(block.registers, f"exception_{error.code}")
        return []

    def _silent(self, block: _RegisterRange, error: LostError, poll: _Poll) -> None:
        """Record a request without a usable answer, and split it if the unit answers others."""
        poll.timeouts += 1
        poll.problem = error
        block.failures += 1
        block.fault = error.fault
        poll.fail(block.registers, error.fault)
        if self._is_widened(block) and not block.answered:
            self._narrow(block)
        elif block.failures > 1 and poll.answers + poll.refusals and len(block.parts) > 1:
            for half in self._split(block):
                half.failures = 1
        elif poll.answers + poll.refusals:  # it keeps others waiting
            block.retry_s = asyncio.get_running_loop().time() + self._pause_s(block.failures)

    def _pause_s(self, failures: int) -> float:
        """Return how long, in s, not to request registers after so many time-outs in a row."""
        return float(min(_PAUSE * 2.0 ** min(failures - 1, 10) * self._table.timeout_s, _LONGEST_PAUSE_S))

    def _is_widened(self, block: _RegisterRange) -> bool:
        return block.request.count != block.registers.count

    def _narrow(self, block: _RegisterRange) -> None:
        """Request only the registers of the block: the device does not have those beyond."""
        self._release([block])
        block.request = self._exact(block.registers)
        if self._line is not None:
            self._line.reserve(block.request, block.request.count)

    def _split(self, block: _RegisterRange) -> list[_RegisterRange]:
        """Replace a block by its two halves, and return these."""
        self._release([block])
        self._blocks.remove(block)
        middle = len(block.parts) // 2
        halves = self._planned(set(block.parts[:middle])) + self._planned(set(block.parts[middle:]))
        self._blocks += halves
        return halves

    def _reading(self, poll: _Poll) -> Reading:
        """Return the reading of all channels from the registers of a poll, and note a suspicious byte
        order.
        """
        values: dict[str, float] = {}
        faults: dict[str, str] = {}
        self._doubt = None
        for name, channel in self._places.items():
            fault = _fault_of(channel, poll)
            value = nan
            if fault is None:
                words, is_temperature = poll.words[channel.function], name.endswith("degC")
                value, fault = decode(words, channel, is_temperature)
                hint = order_hint(words, channel, is_temperature)
                self._doubt = self._doubt or (hint and f"{name} is {hint}")
            values[name] = value
            if fault is not None:
                faults[name] = fault
        return Reading(self._now() if poll.heard_s is None else poll.heard_s, values, faults)


def _fault_of(channel: ModbusChannel, poll: _Poll) -> str | None:
    """Return the fault of the registers that a channel needs; None if all of them were read."""
    for span in spans(channel):
        for number in range(span.first, span.first + span.count):
            if number not in poll.words[span.function]:
                return poll.faults[span.function].get(number, "timeout")
    return None
