"""The one file that knows pymodbus: one connection to one Modbus device, reads only.

pymodbus's own retries and reconnects are off. A connection that did not answer in time is not used again
before a late reply can no longer be taken for the next one: over TCP it is closed, on a serial line the link
stays quiet until nothing has arrived for a while (an RTU reply carries no number that tells which request
it answers).
"""

from __future__ import annotations

import asyncio
import logging

from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ExceptionResponse, ModbusPDU

from drivers.decode import Block
from drivers.places import Device
from drivers.protocol import Clock

# Everything pymodbus logs is also told by the exceptions below, and then counted in the driver's status.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)

CONNECT_TIMEOUT_S = 0.5  # a peer that comes back between two attempts is found by the next


class LinkTimeoutError(Exception):
    """The device did not answer in time."""


class LinkLostError(Exception):
    """The connection is gone."""


class BadReplyError(Exception):
    """The device answered, but not what was asked."""


class DeviceExceptionError(Exception):
    """The device answered with a Modbus exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


class ModbusLink:
    """One connection; `lost` is set when it ends, whoever ended it. Made anew for each connection.

    `heard_s` is when the last bytes came, by the clock `now`.
    """

    def __init__(self, device: Device, now: Clock) -> None:
        self.lost = asyncio.Event()
        self.heard_s = now()
        self._now = now
        self._unit_id = device.unit_id
        self._quiet_s = device.quiet_s
        self._last_byte_s = 0.0
        client = AsyncModbusSerialClient if device.serial else AsyncModbusTcpClient
        self._client: AsyncModbusTcpClient | AsyncModbusSerialClient = client(
            device.address,
            **device.options,
            timeout=device.timeout_s,
            retries=0,
            reconnect_delay=0,
            trace_connect=self._connection_changed,
            trace_packet=self._bytes_passed,
        )

    def _connection_changed(self, connected: bool) -> None:
        if not connected:
            self.lost.set()

    def _bytes_passed(self, sending: bool, data: bytes) -> bytes:
        if not sending:
            self.heard_s = self._now()
            self._last_byte_s = asyncio.get_running_loop().time()
        return data

    async def open(self) -> None:
        """Connect, once. Raises `LinkLostError` with the reason when that fails."""
        try:
            connected = await asyncio.wait_for(self._client.connect(), CONNECT_TIMEOUT_S)
        except TimeoutError:
            raise LinkLostError("no answer to the attempt to connect") from None
        except (OSError, ValueError, ModbusException) as error:
            raise LinkLostError(str(error)) from None
        if not connected:
            raise LinkLostError("cannot connect")

    def close(self) -> None:
        """Close the connection; what was waiting for it is told."""
        self._client.close()
        self.lost.set()

    async def read(self, block: Block) -> dict[int, int]:
        """Read the registers of a block, by address.

        Raises `LinkTimeoutError`, `LinkLostError`, `BadReplyError` or `DeviceExceptionError`; after the
        first two the link must not be used before `settle`.
        """
        client = self._client
        read = client.read_holding_registers if block.function == "holding" else client.read_input_registers
        answer = asyncio.ensure_future(read(block.first, count=block.count, device_id=self._unit_id))
        lost = asyncio.ensure_future(self.lost.wait())
        try:
            await asyncio.wait({answer, lost}, return_when=asyncio.FIRST_COMPLETED)
            if not answer.done():
                raise LinkLostError("connection closed by the device")
            response = answer.result()
        except ModbusException as error:
            if self.lost.is_set():
                raise LinkLostError("connection closed by the device") from None
            raise LinkTimeoutError(str(error)) from None
        finally:
            answer.cancel()
            lost.cancel()
        return _registers(response, block)

    async def settle(self) -> bool:
        """After a timeout, make a late reply harmless; False when that needs a new connection."""
        if self._quiet_s is None:
            return False
        loop = asyncio.get_running_loop()
        quiet_from_s = loop.time()
        while not self.lost.is_set():
            quiet_from_s = max(quiet_from_s, self._last_byte_s)
            remaining_s = quiet_from_s + self._quiet_s - loop.time()
            if remaining_s <= 0:
                return True
            await asyncio.sleep(remaining_s)
        return False


def _registers(response: ModbusPDU, block: Block) -> dict[int, int]:
    """The registers in a response, by address, after checking that it answers this very request."""
    if isinstance(response, ExceptionResponse):
        raise DeviceExceptionError(response.exception_code)
    expected_function = 3 if block.function == "holding" else 4
    if response.function_code != expected_function or len(response.registers) != block.count:
        raise BadReplyError(
            f"asked for {block.count} registers by function {expected_function}, "
            f"got {len(response.registers)} by function {response.function_code}"
        )
    return {block.first + i: word for i, word in enumerate(response.registers)}
