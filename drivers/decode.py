"""From registers to numbers; pure.

Words are unsigned 16-bit integers in the order of their addresses. A value that the device itself marks
as bad decodes to NaN with a reason, however plausible the number in its register.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

from drivers.places import WORDS, ByteOrder, ModbusChannel

_FORMAT = {
    "int16": ">h", "uint16": ">H", "int32": ">i", "uint32": ">I", "float32": ">f",
    "int64": ">q", "uint64": ">Q", "float64": ">d",
}  # fmt: skip
_SMALLEST = {"float32": 2.0**-126, "float64": 2.0**-1022}  # that is not denormal
_TINY_DEGC = 1e-6  # no sensor resolves it
_EVERYDAY_DEGC, _EVERYDAY = (-60.0, 300.0), (1e-4, 1e5)  # temperatures; sizes of other values
_SENSIBLE_DEGC, _SENSIBLE = (-100.0, 1500.0), 1e9
MAX_REGISTERS = 125  # of one read request (Modbus Application Protocol 1.1b3, 6.3)


@dataclass(frozen=True, slots=True)
class RegisterBlock:
    """Contiguous registers that one request reads.

    Attributes:
        function: `"holding"` or `"input"`.
        first: The first register, counted from 0 as transmitted.
        count: How many registers.
    """

    function: str
    first: int
    count: int


def bytes_of(words: Sequence[int], order: ByteOrder = "ABCD") -> bytes:
    """Return the bytes of one value's words, the most significant byte first.

    Args:
        words: One, two or four unsigned 16-bit integers in the order of their addresses.
        order: The device's order of bytes, the most significant being A.
    """
    ordered = words if order in ("ABCD", "BADC") else words[::-1]
    return struct.pack(f"{'>' if order in ('ABCD', 'CDAB') else '<'}{len(words)}H", *ordered)


def words_of(raw: float, kind: str, order: ByteOrder) -> list[int]:
    """Return the words of a number by its type and order: the inverse of `bytes_of` and `raw_of`.

    Args:
        raw: The number before scaling; integer types round it.
        kind: A type of `places.WORDS`, such as `"int16"`.
        order: The device's order of bytes.

    Raises:
        struct.error: If the integer type cannot hold the number.
        OverflowError: If the floating-point type cannot hold it.
    """
    number = raw if kind.startswith("float") else round(raw)
    data = struct.pack(_FORMAT[kind], number)
    words = list(struct.unpack(f"{'>' if order in ('ABCD', 'CDAB') else '<'}{len(data) // 2}H", data))
    return words if order in ("ABCD", "BADC") else words[::-1]


def raw_of(data: bytes, kind: str) -> float:
    """Return the number encoded in the bytes of a value, before scaling.

    Args:
        data: The bytes of `bytes_of`, as many as the type has.
        kind: A type of `places.WORDS`, such as `"float32"`.
    """
    number: float = struct.unpack(_FORMAT[kind], data)[0]
    return number


def decode(
    words: Mapping[int, int], channel: ModbusChannel, is_temperature: bool = False
) -> tuple[float, str | None]:
    """Return the value of a channel and its fault, from the registers by address.

    value = scale · raw + offset. The status word is judged first, because a module may clamp a value beyond
    its range to one that looks right. Fault codes come next, then the limits. A denormal number, or a
    temperature closer to 0 than any sensor resolves, belongs to another byte order and gives the fault
    `tiny_number`.

    Args:
        words: Unsigned 16-bit integers by register; those of `spans(channel)` must be present.
        channel: The place of the value, its type, limits and fault codes.
        is_temperature: Whether the value is in °C.

    Returns:
        The value in the channel's unit and None, or NaN and the name of the fault.
    """
    if channel.status_register is not None:
        status = words[channel.status_register]
        for bits, fault in channel.status_faults.items():
            if status & bits == bits:
                return math.nan, fault
    data = bytes_of(_words_of(words, channel), channel.order)
    code = int.from_bytes(data, "big")
    if code in channel.fault_codes:
        return math.nan, channel.fault_codes[code]
    raw = raw_of(data, channel.type)
    value = channel.value(raw)
    if not math.isfinite(value):
        return math.nan, "not_a_number"
    if _is_tiny(raw, channel, is_temperature):
        return math.nan, "tiny_number"
    if not (channel.low is None or value >= channel.low) or not (
        channel.high is None or value <= channel.high
    ):
        return math.nan, "out_of_range"
    return value, None


def order_hint(words: Mapping[int, int], channel: ModbusChannel, is_temperature: bool) -> str | None:
    """Return which other byte orders would give an everyday value where this one does not.

    Args:
        words: Unsigned 16-bit integers by register.
        channel: The place of the value; only floating-point types are judged.
        is_temperature: Whether the value is in °C; everyday is then −60 to 300 °C.

    Returns:
        The end of a sentence that begins with the channel; None if the value is sensible, or if none of the
        other orders makes it so.
    """
    channel_words = _words_of(words, channel)
    raw = raw_of(bytes_of(channel_words, channel.order), channel.type)
    if not channel.is_float or _is_sensible(raw, channel, is_temperature):
        return None
    fitting = [
        f"{order} would give {value:.6g}"
        for order in get_args(ByteOrder)
        if _is_everyday(
            value := channel.value(raw_of(bytes_of(channel_words, order), channel.type)), is_temperature
        )
    ]
    return f"{raw:.3g} in byte_order {channel.order}; {', '.join(fitting)}" if fitting else None


def _words_of(words: Mapping[int, int], channel: ModbusChannel) -> list[int]:
    """Return the words of a channel's value, in the order of their addresses."""
    return [words[channel.register_ + i] for i in range(WORDS[channel.type])]


def _is_tiny(raw: float, channel: ModbusChannel, is_temperature: bool) -> bool:
    """Whether a floating-point number is not 0 and yet smaller than any measured one."""
    smallest = max(
        _SMALLEST.get(channel.type, 0.0), _TINY_DEGC if is_temperature and channel.is_float else 0.0
    )
    return 0.0 < abs(raw) < smallest


def _is_sensible(raw: float, channel: ModbusChannel, is_temperature: bool) -> bool:
    value = channel.value(raw)
    in_range = _SENSIBLE_DEGC[0] < value < _SENSIBLE_DEGC[1] if is_temperature else abs(value) < _SENSIBLE
    return in_range and not _is_tiny(raw, channel, is_temperature)


def _is_everyday(value: float, is_temperature: bool) -> bool:
    if is_temperature:
        return _EVERYDAY_DEGC[0] < value < _EVERYDAY_DEGC[1] and abs(value) > _TINY_DEGC
    return _EVERYDAY[0] < abs(value) < _EVERYDAY[1]


def spans(channel: ModbusChannel) -> list[RegisterBlock]:
    """Return the registers that a channel needs. One request reads each of them, so that no value is torn.

    Returns:
        The block of the value and, if there is one, the block of its status register.
    """
    blocks = [RegisterBlock(channel.function, channel.register_, WORDS[channel.type])]
    if channel.status_register is not None:
        blocks.append(RegisterBlock(channel.function, channel.status_register, 1))
    return blocks


def read_plan(
    channels: Sequence[ModbusChannel], max_registers: int = MAX_REGISTERS
) -> tuple[RegisterBlock, ...]:
    """Return the fewest requests that read these channels without reading a register between them.

    A device may reject a request for a register that it does not have.

    Args:
        channels: The places of the values.
        max_registers: The most registers in one request; at least as many as the longest value has.
    """
    return plan_of({span for channel in channels for span in spans(channel)}, max_registers)


def plan_of(
    blocks: Collection[RegisterBlock], max_registers: int = MAX_REGISTERS
) -> tuple[RegisterBlock, ...]:
    """Return the fewest requests that read these blocks, none of which is torn.

    Args:
        blocks: The registers that belong together; they may overlap.
        max_registers: The most registers in one request. A longer block becomes a request of its own.

    Returns:
        Requests in the order of function and register.
    """
    plan: list[RegisterBlock] = []
    for span in sorted(blocks, key=lambda b: (b.function, b.first, b.count)):
        end = span.first + span.count
        if plan and plan[-1].function == span.function and span.first <= plan[-1].first + plan[-1].count:
            first = plan[-1].first
            count = max(end, first + plan[-1].count) - first
            if count <= max_registers:
                plan[-1] = RegisterBlock(span.function, first, count)
                continue
        plan.append(span)
    return tuple(plan)
