"""Modbus RTU over a pty pair: a real serial client and server, and a line that delays replies."""

import asyncio
import contextlib
import os
import tty
from contextlib import asynccontextmanager

from pymodbus.server import ModbusSerialServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers.modbus import ModbusRtuSettings
from tests.drivers.harness import running

TIMEOUT_S = 0.1
QUIET_S = 0.3


class Line:
    """Two pty pairs joined by their masters; what the device sends is held back for `delay_s`."""

    def __init__(self):
        self.delay_s = 0.0
        self.masters = []
        self.devices = []
        for _ in range(2):
            master, slave = os.openpty()
            tty.setraw(slave)
            os.set_blocking(master, False)
            self.masters.append(master)
            self.devices.append((slave, os.ttyname(slave)))
        loop = asyncio.get_running_loop()
        near, far = self.masters
        loop.add_reader(near, self._forward, near, far, False)
        loop.add_reader(far, self._forward, far, near, True)

    @property
    def client(self):
        return self.devices[0][1]

    @property
    def server(self):
        return self.devices[1][1]

    def _forward(self, source, target, is_reply):
        data = os.read(source, 4096)
        delay_s = self.delay_s if is_reply else 0.0
        asyncio.get_running_loop().call_later(delay_s, self._write, target, data)

    def _write(self, target, data):
        with contextlib.suppress(OSError):  # closed while the bytes were under way
            os.write(target, data)

    def close(self):
        masters, self.masters = self.masters, []  # closing twice is closing once
        for master in masters:
            asyncio.get_running_loop().remove_reader(master)
            os.close(master)
        for slave, _ in self.devices if masters else ():
            os.close(slave)


@asynccontextmanager
async def rtu_device(registers):
    line = Line()
    block = SimData(0, values=registers, datatype=DataType.REGISTERS)
    server = ModbusSerialServer(SimDevice(id=1, simdata=[block]), port=line.server, baudrate=19200)
    await server.serve_forever(background=True)
    try:
        yield line
    finally:
        await server.shutdown()
        line.close()


def settings(line, count, **more):
    channels = {f"r{i}_1": {"register": 3 * i} for i in range(count)}
    return ModbusRtuSettings(
        kind="modbus_rtu",
        port=line.client,
        channels=channels,
        **({"period_s": 0.05, "timeout_s": TIMEOUT_S, "quiet_s": QUIET_S} | more),
    )


def wrong_values(readings):
    """Each register holds its own address, so a reply that answers another request shows."""
    return [
        (name, value)
        for reading in readings
        for name, value in reading.values.items()
        if name not in reading.faults and value != 3 * int(name[1])
    ]


async def replies_that_come_late(line, rtu):
    """Delay some replies by more than the timeout, as a slow gateway does."""
    for delay_s in (0.15, 0.02, 0.3, 0.15, 0.02, 0.35, 0.0):
        line.delay_s = delay_s
        await rtu.more(10)
    await rtu.until(lambda r: not r.faults)


async def test_registers_arrive_over_the_serial_line():
    async with rtu_device(list(range(15))) as line, running(settings(line, 5).open("rtu")) as rtu:
        reading = await rtu.until(lambda r: not r.faults)
        assert reading.values == {f"r{i}_1": 3.0 * i for i in range(5)}
        assert rtu.driver.status.connected


async def test_late_replies_never_yield_another_registers_value():
    async with rtu_device(list(range(15))) as line, running(settings(line, 5).open("rtu")) as rtu:
        await replies_that_come_late(line, rtu)
        assert any("timeout" in r.faults.values() for r in rtu.readings)
        await rtu.until(lambda _: sum(not r.faults for r in rtu.readings) > 5)
        assert wrong_values(rtu.readings) == []
