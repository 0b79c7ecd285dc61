"""What the driver tests share: a driver at work, and real servers on loopback."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

import drivers
from drivers.protocol import Driver
from observer.frames import Reading
from tests.patience import PATIENCE_S, Stopwatch

RUNNING: list[Driver] = []
DRIVERS = Path(drivers.__file__).parent


@dataclass
class Recorder:
    """The readings a running driver has delivered."""

    driver: Driver
    readings: list[Reading] = field(default_factory=list)
    _arrived: asyncio.Event = field(default_factory=asyncio.Event)

    def take(self, reading: Reading) -> None:
        """Keep a reading."""
        self.readings.append(reading)
        self._arrived.set()

    async def until(self, wanted: Callable[[Reading], bool], timeout_s: float = PATIENCE_S) -> Reading:
        """The first reading from now on that is wanted; a time-out is a claim about driver and device."""
        watch, seen = Stopwatch(), len(self.readings)
        async with asyncio.timeout(PATIENCE_S):
            while (found := next((r for r in self.readings[seen:] if wanted(r)), None)) is None:
                self._arrived.clear()
                await self._arrived.wait()
        assert watch.took_s() < timeout_s
        return found

    async def more(self, count: int) -> list[Reading]:
        """The next readings."""
        seen = len(self.readings)
        await self.until(lambda _: len(self.readings) >= seen + count)
        return self.readings[seen:]

    async def good(self, channel: str, timeout_s: float = PATIENCE_S) -> float:
        """The next value of a channel that has no fault."""
        return (
            await self.until(lambda r: channel in r.values and channel not in r.faults, timeout_s)
        ).values[channel]

    async def fault(self, channel: str, timeout_s: float = PATIENCE_S) -> str:
        """The next fault of a channel."""
        return (await self.until(lambda r: channel in r.faults, timeout_s)).faults[channel]


@asynccontextmanager
async def running(driver: Driver, now: Callable[[], float] = time.time) -> AsyncIterator[Recorder]:
    """Run a driver; afterwards nothing of it may be left."""
    recorder = Recorder(driver)
    RUNNING.append(driver)
    task = asyncio.create_task(driver.run(recorder.take, now))
    try:
        yield recorder
    finally:
        if task.done():
            task.result()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        RUNNING.remove(driver)
        left = [t.get_coro().cr_code.co_filename for t in asyncio.all_tasks() if not t.done()]
        assert RUNNING or not [file for file in left if Path(file).parent == DRIVERS], (
            "the driver left a task behind"
        )


class Device:
    """A Modbus TCP device on loopback that notes every request, and can refuse or delay its answers."""

    def __init__(self, holding: list[int], inputs: list[int]) -> None:
        self.port = 0
        self.requests: list[tuple[int, int, int]] = []
        self.refuse: ExcCodes | None = None
        self.delay_s = 0.0
        self._registers = (holding, inputs)
        self._server: ModbusTcpServer | None = None

    async def start(self) -> None:
        blocks = [[SimData(0, values=r, datatype=DataType.REGISTERS)] for r in self._registers]
        bits = [[SimData(0, values=[False] * 16, datatype=DataType.BITS)] for _ in range(2)]
        device = SimDevice(id=1, simdata=(*bits, *blocks), action=self._answer)
        self._server = ModbusTcpServer(device, address=("127.0.0.1", self.port))
        await self._server.serve_forever(background=True)
        self.port = self._server.transport.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        if self._server is not None:
            await self._server.shutdown()
            self._server = None
            await asyncio.sleep(0)  # let asyncio close the sockets

    async def _answer(self, function, first, address, count, current, written):
        self.requests.append((function, address, count))
        if self.delay_s:
            await asyncio.sleep(self.delay_s)
        return self.refuse


@asynccontextmanager
async def device(holding: list[int] | None = None, inputs: list[int] | None = None) -> AsyncIterator[Device]:
    """A running `Device`."""
    served = Device(holding or [0], inputs or [0])
    await served.start()
    try:
        yield served
    finally:
        await served.stop()
