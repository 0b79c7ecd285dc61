"""Polling a Modbus device, TCP or RTU, for ever: one reading each period, whatever happens on the wire."""

from __future__ import annotations

import asyncio
import dataclasses
from math import nan

from drivers.decode import Block, decode, read_plan, spans
from drivers.modbus_link import (
    BadReplyError,
    DeviceExceptionError,
    LinkLostError,
    LinkTimeoutError,
    ModbusLink,
)
from drivers.places import Device, ModbusChannel
from drivers.protocol import Clock, Deliver, DriverStatus, faulty
from observer.frames import Reading

_ASK_AGAIN_S = 0.1
RETRY_S = 0.25  # pause between attempts to connect, so that a returned peer is met within a second


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
        faults: dict[Block, str] = {}
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
        self, words: dict[str, dict[int, int]], block_faults: dict[Block, str], time_s: float
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


def _touches(channel: ModbusChannel, block: Block) -> bool:
    """Whether a block holds a register that the channel needs."""
    return any(
        span.function == block.function and block.first <= span.first < block.first + block.count
        for span in spans(channel)
    )
