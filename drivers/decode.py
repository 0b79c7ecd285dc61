"""From registers to numbers; pure.

Words are unsigned 16-bit integers in the order of their addresses. A value that the device itself marks
as bad decodes to NaN with a reason, however plausible the number in its register.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.places import WORDS, ModbusChannel

_FORMAT = {"int16": ">h", "uint16": ">H", "int32": ">i", "uint32": ">I", "float32": ">f"}
MAX_REGISTERS = 125  # of one read request (Modbus Application Protocol 1.1b3, 6.3)


@dataclass(frozen=True, slots=True)
class RegisterBlock:
    """Contiguous registers that one request reads."""

    function: str
    first: int
    count: int


def bytes_of(words: Sequence[int], word_order: str = "big") -> bytes:
    """The words of one value, the most significant byte first."""
    return struct.pack(f">{len(words)}H", *(words if word_order == "big" else words[::-1]))


def raw_of(data: bytes, kind: str) -> float:
    """The number encoded in the bytes of a value, before scaling."""
    number: float = struct.unpack(_FORMAT[kind], data)[0]
    return number


def decode(words: Mapping[int, int], channel: ModbusChannel) -> tuple[float, str | None]:
    """The value of a channel and its fault, from the registers by address.

    value = scale · raw + offset. The status word is judged first, because a module may clamp a value that
    is out of its range to one that looks right; then codes that stand for faults; then the limits.
    """
    if channel.status_register is not None:
        status = words[channel.status_register]
        for bits, fault in channel.status_faults.items():
            if status & bits == bits:
                return math.nan, fault
    own = [words[channel.register_ + i] for i in range(WORDS[channel.type])]
    data = bytes_of(own, channel.word_order)
    code = int.from_bytes(data, "big")
    if code in channel.fault_codes:
        return math.nan, channel.fault_codes[code]
    value = channel.value(raw_of(data, channel.type))
    if not math.isfinite(value):
        return math.nan, "not_a_number"
    if not (channel.low is None or value >= channel.low) or not (
        channel.high is None or value <= channel.high
    ):
        return math.nan, "out_of_range"
    return value, None


def spans(channel: ModbusChannel) -> list[RegisterBlock]:
    """The registers a channel needs; each span is read in one request, so no value is torn."""
    needed = [RegisterBlock(channel.function, channel.register_, WORDS[channel.type])]
    if channel.status_register is not None:
        needed.append(RegisterBlock(channel.function, channel.status_register, 1))
    return needed


def read_plan(channels: Sequence[ModbusChannel]) -> tuple[RegisterBlock, ...]:
    """The fewest requests that read these channels without touching a register nobody asked for."""
    needed = {span for channel in channels for span in spans(channel)}
    plan: list[RegisterBlock] = []
    for span in sorted(needed, key=lambda b: (b.function, b.first, b.count)):
        end = span.first + span.count
        if plan and plan[-1].function == span.function and span.first <= plan[-1].first + plan[-1].count:
            first = plan[-1].first
            count = max(end, first + plan[-1].count) - first
            if count <= MAX_REGISTERS:
                plan[-1] = RegisterBlock(span.function, first, count)
                continue
        plan.append(span)
    return tuple(plan)
