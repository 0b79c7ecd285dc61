"""The Modbus driver against real servers on loopback, in good days and bad."""

import asyncio
import math
import time

import pytest
from pymodbus.constants import ExcCodes

from drivers.modbus import ModbusTcpSettings
from drivers.modbus_line import _Wire
from tests.drivers.harness import device, running
from tests.patience import Stopwatch, eventually

READ_HOLDING, READ_INPUT = 3, 4


def settings(port, channels, **more):
    return ModbusTcpSettings(
        kind="modbus_tcp",
        host="127.0.0.1",
        port=port,
        **({"period_s": 0.05, "timeout_s": 0.2, "channels": channels} | more),
    )


async def test_values_of_both_functions_arrive_with_the_clock_of_the_service():
    channels = {
        "t1_degC": {"register": 0, "scale": 0.1},
        "x_m": {
            "register": 1,
            "type": "int32",
            "word_order": "little",
            "scale": 1e-6,
            "function": "holding",
        },
    }
    async with (
        device(holding=[0, 0xE240, 0x0001], inputs=[215]) as peer,
        running(settings(peer.port, channels).open("tc"), now=lambda: 42.5) as tc,
    ):
        reading = await tc.until(lambda r: not r.faults)
    assert reading.time_s == 42.5
    assert reading.values == {"t1_degC": pytest.approx(21.5), "x_m": pytest.approx(0.123456)}


async def test_a_reading_has_the_time_at_which_the_reply_came_not_that_of_a_busy_event_loop(monkeypatch):
    came_s = []

    def data_received(protocol, data, received=_Wire.data_received):
        came_s.append(time.monotonic())
        asyncio.get_running_loop().call_soon(time.sleep, 0.2)  # something else comes first
        received(protocol, data)

    monkeypatch.setattr(_Wire, "data_received", data_received)
    async with device(inputs=[215]) as peer:
        driver = settings(peer.port, {"t1_degC": {"register": 0}}, period_s=9.0, timeout_s=5.0).open("tc")
        async with running(driver, time.monotonic) as tc:
            reading = await tc.until(lambda r: not r.faults)
    assert any(abs(reading.time_s - time_s) < 0.1 for time_s in came_s)


async def test_only_read_functions_are_ever_sent_and_neighbours_go_together():
    channels = {f"t{i}_degC": {"register": i} for i in range(4)} | {
        "n_rpm": {"register": 0, "function": "holding"}
    }
    async with (
        device(holding=[1] * 4, inputs=[1] * 4) as peer,
        running(settings(peer.port, channels).open("tc")) as tc,
    ):
        await tc.good("t0_degC")
        peer.refuse = ExcCodes.DEVICE_BUSY
        await tc.fault("t0_degC")
        peer.refuse = None
        await peer.stop()
        await tc.until(lambda r: r.faults.get("t0_degC") == "disconnected")
        await peer.start()
        await tc.good("t0_degC")
    assert {function for function, _, _ in peer.requests} == {READ_HOLDING, READ_INPUT}
    assert {(f, a, c) for f, a, c in peer.requests} == {(READ_HOLDING, 0, 1), (READ_INPUT, 0, 4)}


@pytest.mark.parametrize("away_s", [0.1, 1.3])
async def test_unplugged_and_back_within_a_second_and_flagged_in_between(away_s):
    async with (
        device(inputs=[5]) as peer,
        running(settings(peer.port, {"t_degC": {"register": 0}}).open("tc")) as tc,
    ):
        await tc.good("t_degC")
        await peer.stop()
        gone = len(tc.readings)
        await tc.fault("t_degC")
        watch = Stopwatch()
        await tc.more(round(away_s / 0.05))
        assert watch.took_s() < 2 * away_s + 0.1  # one reading each period (0.05 s), never silent
        away = tc.readings[gone:]
        await peer.start()
        await tc.good("t_degC", timeout_s=1.0)
        assert tc.driver.status.reconnects == 1
        assert tc.driver.status.connected
    assert all("t_degC" in r.faults and math.isnan(r.values["t_degC"]) for r in away[1:])


async def test_a_peer_that_was_never_there_is_waited_for():
    async with device(inputs=[5]) as peer:
        await peer.stop()
        async with running(settings(peer.port, {"t_degC": {"register": 0}}).open("tc")) as tc:
            assert await tc.fault("t_degC") == "disconnected"
            await peer.start()
            await tc.good("t_degC", timeout_s=1.0)
            assert tc.driver.status.reconnects == 0


async def test_a_hung_device_is_a_fault_every_period_although_its_timeout_is_longer():
    async with device(inputs=[5]) as peer:
        driver = settings(peer.port, {"t_degC": {"register": 0}}, timeout_s=0.5).open("tc")
        async with running(driver) as tc:
            await tc.good("t_degC")
            peer.delay_s = 30.0
            assert await tc.fault("t_degC") == "timeout"
            watch = Stopwatch()
            hung = await tc.more(3)
            assert watch.took_s() < 0.4  # less than the timeout: faults come from the period, not from it
            assert all(r.faults == {"t_degC": "timeout"} for r in hung)
            peer.delay_s = 0.0
            await tc.good("t_degC", timeout_s=1.0)


async def test_late_replies_never_become_another_registers_value():
    """Each register holds its own address; a reply taken for another request would show."""
    channels = {f"r{i}_1": {"register": 3 * i} for i in range(5)}
    async with device(inputs=list(range(15))) as peer:
        driver = settings(peer.port, channels, timeout_s=0.05).open("tc")
        async with running(driver) as tc:
            for delay_s in (0.0, 0.06, 0.0, 0.12, 0.02, 0.08, 0.0):
                peer.delay_s = delay_s
                await tc.more(5)
            await tc.good("r4_1")
            good = [(n, v) for r in tc.readings for n, v in r.values.items() if n not in r.faults]
    assert good
    assert [(n, v) for n, v in good if v != 3 * int(n[1])] == []


async def test_a_server_that_talks_nonsense_is_flagged_and_survived():
    async def nonsense(reader, writer):
        while await reader.read(64):
            writer.write(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        writer.close()

    server = await asyncio.start_server(nonsense, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    try:
        async with running(settings(port, {"t_degC": {"register": 0}}).open("tc")) as tc:
            await tc.until(lambda _: tc.driver.status.errors > 1)
            assert all(r.faults for r in tc.readings)
            assert not tc.driver.status.connected
    finally:
        server.close()


async def test_a_server_that_disconnects_at_once_is_not_hammered():
    connections = 0

    async def hang_up(_reader, writer):
        nonlocal connections
        connections += 1
        writer.close()

    server = await asyncio.start_server(hang_up, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    try:
        async with running(settings(port, {"t_degC": {"register": 0}}).open("tc")) as tc:
            await eventually(lambda: connections)
            first_s = time.monotonic()
            await eventually(lambda: connections >= 4)
            assert time.monotonic() - first_s > 0.7  # every quarter of a second
            assert all(r.faults for r in tc.readings)
    finally:
        server.close()


async def test_ending_is_asked_for_again_where_an_opening_connection_swallows_it(monkeypatch):
    """As `asyncio.wait_for` before Python 3.12 does where the connection is there at that very moment."""
    opening, swallowed = [], []

    async def open_or_swallow(link):
        opening.append(link)
        try:
            await asyncio.Event().wait()
        except asyncio.CancelledError:
            swallowed.append(link)

    monkeypatch.setattr("drivers.modbus_session.ModbusSession.open", open_or_swallow)
    async with running(settings(1, {"t_degC": {"register": 0}}).open("tc")):
        await eventually(lambda: opening)
    assert len(swallowed) == 1


async def test_cancelling_ends_at_once_even_while_the_device_hangs():
    async with device(inputs=[5]) as peer:
        peer.delay_s = 30.0
        driver = settings(peer.port, {"t_degC": {"register": 0}}, timeout_s=10.0).open("tc")
        async with running(driver) as tc:
            await tc.fault("t_degC")
            watch = Stopwatch()
        assert watch.took_s() < 1.0
