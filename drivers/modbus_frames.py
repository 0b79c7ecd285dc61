"""Read requests and their replies as bytes: Modbus RTU and Modbus TCP frames; pure.

pymodbus encodes the frames and computes their checksum. Replies are parsed here, because a reply counts only
if it fits its request: transaction, unit, function and number of bytes.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import NamedTuple

from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU

FUNCTIONS = {"holding": 3, "input": 4}
EXCEPTION_BIT = 0x80
_LONGEST_RTU = 256  # bytes of one RTU frame
_HEADER = struct.Struct(">HHHB")  # of a TCP frame: transaction, protocol, length, unit


class NotModbusError(Exception):
    """The bytes cannot be frames of this kind; the text says what they look like."""


@dataclass(frozen=True, slots=True)
class Request:
    """A request to read `count` registers of a unit from `first` on.

    Attributes:
        unit: The unit's number, 0 to 255.
        function: The code of the function: 3 for holding, 4 for input registers.
        first: The first register, counted from 0 as transmitted.
        count: How many registers, 1 to 125.
    """

    unit: int
    function: int
    first: int
    count: int

    @property
    def shape(self) -> tuple[int, int]:
        """Function and number of registers: with the unit, all that identifies the request of an RTU
        reply.
        """
        return self.function, self.count

    def __str__(self) -> str:
        return f"unit {self.unit}, function {self.function}, {self.count} registers from {self.first}"


class ModbusFrame(NamedTuple):
    """A reply, or an exception reply, of a device.

    Attributes:
        transaction: The number of its request; 0 in an RTU frame.
        unit: The unit that answers.
        function: The code of the function; `EXCEPTION_BIT` is set in an exception reply.
        data: The bytes after the function, without the checksum: a count of bytes and the registers, or the
            exception's code.
    """

    transaction: int
    unit: int
    function: int
    data: bytes

    @property
    def exception(self) -> int | None:
        """The code of an exception reply, else None."""
        return self.data[0] if self.function & EXCEPTION_BIT else None

    @property
    def shape(self) -> tuple[int, int]:
        """The function and the number of registers."""
        return self.function, self.data[0] // 2 if self.data else 0

    def answers(self, request: Request, transaction: int) -> bool:
        """Whether this is a reply, or an exception reply, to a request.

        A reply must have the transaction, unit, function and length of the request. Unit 0 accepts a reply of
        any unit.

        Args:
            request: The request that waits.
            transaction: Its number; 0 on RTU.
        """
        if self.transaction != transaction or (request.unit and self.unit != request.unit):
            return False
        if self.exception is not None:
            return self.function == request.function | EXCEPTION_BIT
        return self.shape == request.shape and len(self.data) == 1 + 2 * request.count

    def words(self) -> list[int]:
        """Return the registers in a reply that is not an exception.

        Each is an unsigned 16-bit integer, in the order of the addresses.
        """
        return list(struct.unpack(f">{(len(self.data) - 1) // 2}H", self.data[1:]))


class RtuFrames:
    """Extracts RTU replies from a stream of bytes that may contain other bytes too.

    A frame counts only if its checksum is right. Other bytes, such as echoes and noise, are skipped.
    """

    numbered = False

    def __init__(self) -> None:
        self._framer = FramerRTU(DecodePDU(False))
        self._buffer = bytearray()

    def encode(self, request: Request, _transaction: int) -> bytes:
        """Return the bytes of a request, with its checksum. RTU frames have no place for the transaction."""
        return self._framer.encode(_body(request), request.unit, 0)

    def reset(self) -> None:
        """Forget bytes that belong to no complete frame."""
        self._buffer.clear()

    def feed(self, data: bytes) -> list[ModbusFrame]:
        """Return the frames that are complete with these bytes.

        Bytes of an incomplete frame stay for the next call, at most as many as the longest frame has.
        """
        self._buffer += data
        frames, start = [], 0
        while start < len(self._buffer):
            length = self._frame_length(start)
            if length:
                frame = bytes(self._buffer[start : start + length])
                frames.append(ModbusFrame(0, frame[0], frame[1], frame[2:-2]))
                del self._buffer[: start + length]
                start = 0
            else:
                start += 1
        del self._buffer[:-_LONGEST_RTU]
        return frames

    def _frame_length(self, start: int) -> int:
        """Return the length of a complete reply with a valid checksum that begins at `start`, else 0."""
        part = self._buffer[start : start + _LONGEST_RTU]
        if len(part) < 5:
            return 0
        if part[1] in FUNCTIONS.values():
            length = 5 + part[2]
        elif part[1] ^ EXCEPTION_BIT in FUNCTIONS.values():
            length = 5
        else:
            return 0
        frame = bytes(part[:length])
        if len(frame) < length or not FramerRTU.check_CRC(frame[:-2], int.from_bytes(frame[-2:], "big")):
            return 0
        return length


class TcpFrames:
    """Cuts a stream of bytes into Modbus TCP frames."""

    numbered = True

    def __init__(self) -> None:
        self._framer = FramerSocket(DecodePDU(False))
        self._buffer = bytearray()

    def encode(self, request: Request, transaction: int) -> bytes:
        """Return the bytes of a request, with its transaction, 1 to 65535, in the header."""
        return self._framer.encode(_body(request), request.unit, transaction)

    def reset(self) -> None:
        """Do nothing: the bytes so far begin a frame that its transaction identifies."""

    def feed(self, data: bytes) -> list[ModbusFrame]:
        """Return the frames that are complete with these bytes.

        Bytes of an incomplete frame stay for the next call.

        Raises:
            NotModbusError: If the bytes have another header. The text is `RTU_FRAMES` if they are RTU frames.
        """
        self._buffer += data
        frames = []
        while len(self._buffer) >= _HEADER.size + 1:
            transaction, protocol, length, unit = _HEADER.unpack_from(self._buffer)
            if protocol or not 3 <= length <= 254:
                raise NotModbusError(_foreign(bytes(self._buffer)))
            if len(self._buffer) < 6 + length:
                break
            body = bytes(self._buffer[_HEADER.size : 6 + length])
            frames.append(ModbusFrame(transaction, unit, body[0], body[1:]))
            del self._buffer[: 6 + length]
        if 5 <= len(self._buffer) < _HEADER.size + 1 and RtuFrames().feed(bytes(self._buffer)):
            raise NotModbusError(RTU_FRAMES)
        return frames


RTU_FRAMES = 'the device answers in RTU frames: set transport = "rtu-over-tcp"'


def _foreign(data: bytes) -> str:
    return (
        RTU_FRAMES
        if RtuFrames().feed(data)
        else f"the answer {data[:16]!r} is no Modbus TCP frame: correct host and port"
    )


def _body(request: Request) -> bytes:
    return struct.pack(">BHH", request.function, request.first, request.count)
