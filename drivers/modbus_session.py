"""The one file that knows pymodbus as a driver: one connection to a Modbus device, TCP or RTU; reads only.

pymodbus's own retries and reconnects are off. A connection that did not answer in time is not used again
before a late reply can no longer be taken for the next one: over TCP it is closed, on a serial line it stays
quiet until nothing has arrived for a while (an RTU reply carries no number of its request).
"""

from __future__ import annotations

import asyncio
import logging
from math import nan

from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ExceptionResponse, ModbusPDU

from drivers.decode import RegisterBlock, decode, read_plan, spans
from drivers.modbus import ModbusTable
from drivers.places import ModbusChannel
from drivers.polled import LostError
from drivers.protocol import Clock
from observer.frames import Reading

# Everything pymodbus logs also comes as the exceptions below, which are counted in the driver's status.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)

CONNECT_TIMEOUT_S = 0.5  # a peer that returns between two attempts is found by the next


class _DeviceExceptionError(Exception):
    """The device answered with a Modbus exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


async def connect(table: ModbusTable, now: Clock) -> ModbusSession:
    """Connect, once. Raises `LostError`."""
    session = ModbusSession(table, now)
    try:
        await session.open()
    except BaseException:
        await session.close()
        raise
    return session


class ModbusSession:
    """One connection to a device whose registers are read; recreated for each connection."""

    def __init__(self, table: ModbusTable, now: Clock) -> None:
        self.problem: str | None = None
        self._now = now
        self._unit_id = table.unit_id
        self._quiet_s = table.silence_s
        self._places = table.map()
        self._plan = read_plan(list(self._places.values()))
        self._unsettled = False  # a late reply may still come
        self._lost = asyncio.Event()  # set when the connection ends, whoever ended it
        self._heard_s = now()  # when the last bytes came, by the clock `now`
        self._last_byte_s = 0.0
        client = AsyncModbusSerialClient if table.silence_s is not None else AsyncModbusTcpClient
        self._client: AsyncModbusTcpClient | AsyncModbusSerialClient = client(
            table.address,
            **table.line,
            timeout=table.timeout_s,
            retries=0,
            reconnect_delay=0,
            trace_connect=self._connection_changed,
            trace_packet=self._bytes_passed,
        )

    def _connection_changed(self, connected: bool) -> None:
        if not connected:
            self._lost.set()

    def _bytes_passed(self, sending: bool, data: bytes) -> bytes:
        if not sending:
            self._heard_s = self._now()
            self._last_byte_s = asyncio.get_running_loop().time()
        return data

    async def open(self) -> None:
        """Connect, once. Raises `LostError` with the reason when that fails."""
        try:
            connected = await asyncio.wait_for(self._client.connect(), CONNECT_TIMEOUT_S)
        except TimeoutError:
            raise LostError("disconnected", "no answer to the attempt to connect") from None
        except (OSError, ValueError, ModbusException) as error:
            raise LostError("disconnected", str(error)) from None
        if not connected:
            raise LostError("disconnected", "cannot connect")

    async def close(self) -> None:
        """Close the connection."""
        self._client.close()

    async def ask(self) -> list[Reading]:
        """One reading of every channel; one with a register that was not read has that request's fault.

        Its time is when the last reply came. The module sampled before; but the middle of request and reply
        is nearer by milliseconds only, and may lie before the fault that a reply after its period has left.

        Raises `LostError`, with a reading unless the connection is gone.
        """
        if self._unsettled and not await self.settle():
            raise LostError("disconnected", "connection closed by the device")
        self.problem, self._unsettled = None, False
        words: dict[str, dict[int, int]] = {"holding": {}, "input": {}}
        faults: dict[RegisterBlock, str] = {}
        heard_s: float | None = None
        for number, block in enumerate(self._plan):
            try:
                words[block.function] |= await self._read(block)
            except _DeviceExceptionError as error:
                faults[block] = f"exception_{error.code}"
                self.problem = str(error)
            except LostError as error:
                if error.fault != "disconnected":
                    faults |= dict.fromkeys(self._plan[number:], error.fault)
                    error.readings = [self._reading(words, faults, heard_s)]
                    error.lasts = self._unsettled = self._quiet_s is not None
                raise
            else:
                heard_s = self._heard_s
        return [self._reading(words, faults, heard_s)]

    async def _read(self, block: RegisterBlock) -> dict[int, int]:
        """Read the registers of a block, by address. Raises `LostError` or `_DeviceExceptionError`."""
        client = self._client
        if not client.connected:
            raise LostError("disconnected", "connection closed by the device")
        read = client.read_holding_registers if block.function == "holding" else client.read_input_registers
        answer = asyncio.ensure_future(read(block.first, count=block.count, device_id=self._unit_id))
        lost = asyncio.ensure_future(self._lost.wait())
        try:
            await asyncio.wait({answer, lost}, return_when=asyncio.FIRST_COMPLETED)
            if answer.done():
                return _registers(answer.result(), block)
        except ModbusException as error:
            if not self._lost.is_set():
                raise LostError("timeout", str(error)) from None
        finally:
            answer.cancel()
            lost.cancel()
        raise LostError("disconnected", "connection closed by the device")

    async def settle(self) -> bool:
        """After a timeout, wait until no late reply can come; False when the connection is lost."""
        loop = asyncio.get_running_loop()
        quiet_from_s = loop.time()
        while not self._lost.is_set():
            quiet_from_s = max(quiet_from_s, self._last_byte_s)
            remaining_s = quiet_from_s + (self._quiet_s or 0.0) - loop.time()
            if remaining_s <= 0:
                return True
            await asyncio.sleep(remaining_s)
        return False

    def _reading(
        self, words: dict[str, dict[int, int]], block_faults: dict[RegisterBlock, str], heard_s: float | None
    ) -> Reading:
        values: dict[str, float] = {}
        faults: dict[str, str] = {}
        for name, channel in self._places.items():
            fault = next((f for b, f in block_faults.items() if _touches(channel, b)), None)
            value = nan
            if fault is None:
                value, fault = decode(words[channel.function], channel)
            values[name] = value
            if fault is not None:
                faults[name] = fault
        return Reading(self._now() if heard_s is None else heard_s, values, faults)


def _registers(response: ModbusPDU, block: RegisterBlock) -> dict[int, int]:
    """The registers in a response, by address, after checking that it answers this very request."""
    if isinstance(response, ExceptionResponse):
        raise _DeviceExceptionError(response.exception_code)
    expected_function = 3 if block.function == "holding" else 4
    if response.function_code != expected_function or len(response.registers) != block.count:
        raise LostError(
            "bad_reply",
            f"asked for {block.count} registers by function {expected_function}, "
            f"got {len(response.registers)} by function {response.function_code}",
        )
    return {block.first + i: word for i, word in enumerate(response.registers)}


def _touches(channel: ModbusChannel, block: RegisterBlock) -> bool:
    """Whether a block holds a register that the channel needs."""
    return any(
        span.function == block.function and block.first <= span.first < block.first + block.count
        for span in spans(channel)
    )
