"""A Modbus device, TCP or RTU, polled for ever: one reading each period, whatever happens on the wire.

The one file that knows pymodbus as a driver; reads only. pymodbus's own retries and reconnects are off. A
connection that did not answer in time is not used again before a late reply can no longer be taken for the
next one: over TCP it is closed, on a serial line the link stays quiet until nothing has arrived for a while
(an RTU reply carries no number that says which request it answers).
"""

from __future__ import annotations

import asyncio
import dataclasses
import logging
from math import nan

from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ExceptionResponse, ModbusPDU

from drivers.decode import RegisterBlock, decode, read_plan, spans
from drivers.places import Device, ModbusChannel
from drivers.protocol import Clock, Deliver, DriverStatus, faulty
from observer.frames import Reading

# Everything pymodbus logs also comes as the exceptions below, which are counted in the driver's status.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)

CONNECT_TIMEOUT_S = 0.5  # a peer that comes back between two attempts is found by the next
RETRY_S = 0.25  # pause between attempts to connect, so that a returned peer is met within a second
_ASK_AGAIN_S = 0.1


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
        """Close the connection; `lost` is set."""
        self._client.close()
        self.lost.set()

    async def read(self, block: RegisterBlock) -> dict[int, int]:
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


def _registers(response: ModbusPDU, block: RegisterBlock) -> dict[int, int]:
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


class ModbusDriver:
    """A device whose registers are read each period.

    A task of its own keeps the connection. A poll that is still under way when its period ends leaves a
    faulty reading for that period, so no channel is ever silently old.
    """

    def __init__(self, name: str, period_s: float, device: Device, places: dict[str, ModbusChannel]) -> None:
        self.name = name
        self.period_s = period_s
        self.status = DriverStatus()
        self._device = device
        self._map = places
        self.channels = tuple(self._map)
        self._plan = read_plan(list(self._map.values()))
        self._link: ModbusLink | None = None
        self._connected = asyncio.Event()
        self._answered_before = False

    async def run(self, deliver: Deliver, now: Clock) -> None:
        """Deliver one reading each period until cancelled."""
        loop = asyncio.get_running_loop()
        keeper = loop.create_task(self._keep_connected(now))
        poll: asyncio.Task[Reading] | None = None
        next_s = loop.time()
        try:
            while True:
                next_s = max(next_s + self.period_s, loop.time())
                poll = poll or loop.create_task(self._poll(now))
                await asyncio.wait({poll}, timeout=next_s - loop.time())
                if keeper.done():
                    keeper.result()
                if poll.done():
                    deliver(poll.result())
                    poll = None
                else:
                    deliver(faulty(self.channels, "timeout" if self._link else "disconnected", now()))
                await asyncio.sleep(next_s - loop.time())
        finally:
            running = {keeper} if poll is None else {keeper, poll}
            while running:
                for task in running:
                    task.cancel()
                # a connection that opens at this very moment swallows it (`asyncio.wait_for` before 3.12)
                ended, running = await asyncio.wait(running, timeout=_ASK_AGAIN_S)
                await asyncio.gather(*ended, return_exceptions=True)
            if self._link:
                self._link.close()

    async def _keep_connected(self, now: Clock) -> None:
        """Connect, wait until the connection is lost, and start again: at once, then every `RETRY_S`."""
        loop = asyncio.get_running_loop()
        while True:
            link = ModbusLink(self._device, now)
            tried_s = loop.time()
            try:
                await link.open()
                self._link = link
                self._connected.set()
                await link.lost.wait()
            except LinkLostError as error:
                self._note(error)
            link.close()
            self._link = None
            self._connected.clear()
            self.status = dataclasses.replace(self.status, connected=False)
            if loop.time() - tried_s < RETRY_S:  # refused, or accepted and closed at once
                await asyncio.sleep(RETRY_S)

    async def _poll(self, now: Clock) -> Reading:
        """One reading of every channel, as soon as there is a connection.

        Its time is when the last reply came. The module sampled before; but the middle of request and reply
        is nearer by milliseconds only, and may lie before the fault that a reply after its period has left.
        """
        await self._connected.wait()
        words: dict[str, dict[int, int]] = {"holding": {}, "input": {}}
        faults: dict[RegisterBlock, str] = {}
        heard_s: float | None = None
        for block in self._plan:
            link = self._link
            if link is None or "timeout" in faults.values():
                faults[block] = "timeout" if link else "disconnected"
                continue
            try:
                words[block.function] |= await link.read(block)
                heard_s = link.heard_s
                self._answered()
            except DeviceExceptionError as error:
                faults[block] = f"exception_{error.code}"
                self._answered()
                self._note(error)
            except (BadReplyError, LinkTimeoutError) as error:
                faults[block] = "timeout" if isinstance(error, LinkTimeoutError) else "bad_reply"
                self.status = dataclasses.replace(self.status, connected=False)
                self._note(error)
                if not await link.settle():  # a late reply may still come
                    link.close()
            except LinkLostError as error:
                faults[block] = "disconnected"
                self._note(error)
                link.close()
        return self._reading(words, faults, now() if heard_s is None else heard_s)

    def _answered(self) -> None:
        """The device is there; it counts as connected only when it answers, not when its port opens."""
        if not self.status.connected:
            again = self.status.reconnects + self._answered_before
            self.status = dataclasses.replace(self.status, connected=True, reconnects=again)
            self._answered_before = True

    def _note(self, error: Exception) -> None:
        self.status = dataclasses.replace(self.status, errors=self.status.errors + 1, last_error=str(error))

    def _reading(
        self, words: dict[str, dict[int, int]], block_faults: dict[RegisterBlock, str], time_s: float
    ) -> Reading:
        """Decode every channel; a channel with a register that was not read takes that request's fault."""
        values: dict[str, float] = {}
        faults: dict[str, str] = {}
        for name, channel in self._map.items():
            fault = next((f for b, f in block_faults.items() if _touches(channel, b)), None)
            value = nan
            if fault is None:
                value, fault = decode(words[channel.function], channel)
            values[name] = value
            if fault is not None:
                faults[name] = fault
        return Reading(time_s, values, faults)


def _touches(channel: ModbusChannel, block: RegisterBlock) -> bool:
    """Whether a block holds a register that the channel needs."""
    return any(
        span.function == block.function and block.first <= span.first < block.first + block.count
        for span in spans(channel)
    )
