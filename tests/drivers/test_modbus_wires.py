"""Modbus as users have it: slow slaves, boxes that repeat, dead units, illegal registers, shared wires."""

from __future__ import annotations

import asyncio
import contextlib
import re
import struct

import pytest

from drivers.modbus import ModbusRtuSettings, ModbusTcpSettings
from drivers.protocol import DriverTable
from observer.config.machine import ConfigError
from observer.installation import parse
from observer.service.one_look import look
from tests.drivers.harness import Recorder, running
from tests.drivers.slave import Slave, crc, on_pty, on_tcp
from tests.reference import live

TIMES = {"period_s": 0.05, "timeout_s": 0.1, "quiet_s": 0.05}
APART = (0, 10, 20)  # registers that no request reads together
EVERYTHING = frozenset(range(3000))


def channels(registers, **place):
    return {f"r{r}_1": {"register": r, "type": "uint16"} | place for r in registers}


def rtu(port: str, registers=APART, **keys) -> DriverTable:
    return ModbusRtuSettings(
        kind="modbus_rtu", port=port, **(TIMES | {"channels": channels(registers)} | keys)
    )


def tcp(port: int, registers=APART, **keys) -> DriverTable:
    given = TIMES | {"channels": channels(registers)} | keys
    return ModbusTcpSettings(kind="modbus_tcp", host="127.0.0.1", port=port, **given)


def values(recorder: Recorder) -> list[tuple[str, float]]:
    """Every value that was delivered as good."""
    return [(n, v) for r in recorder.readings for n, v in r.values.items() if n not in r.faults]


def wrong(recorder: Recorder, unit: int = 1) -> list[tuple[str, float]]:
    return [(n, v) for n, v in values(recorder) if v != 1000 * unit + int(n[1:-2])]


def good_share(recorder: Recorder) -> float:
    return sum(not r.faults for r in recorder.readings) / len(recorder.readings)


async def read_rtu(slave: Slave, registers=APART, readings: int = 60) -> Recorder:
    async with on_pty(slave) as port, running(rtu(port, registers).open("rtu")) as recorder:
        await recorder.more(readings)
    return recorder


# --- an answer is what it is, not whose turn it is ---


@pytest.mark.parametrize("registers", [APART, (0,)])
@pytest.mark.parametrize("others", ["readable", "illegal"])
async def test_no_late_reply_of_a_serial_slave_is_taken_for_another_registers_value(registers, others):
    illegal = EVERYTHING - set(registers) if others == "illegal" else frozenset()
    slaves = [
        Slave(every=every, late_s=late_s, illegal=illegal)
        for every in (2, 3, 8)
        for late_s in (0.03, 0.12, 0.16, 0.26, 0.5)
    ]
    for recorder in await asyncio.gather(*(read_rtu(slave, registers) for slave in slaves)):
        assert wrong(recorder) == []
        assert values(recorder)


@pytest.mark.parametrize("others", ["readable", "illegal"])
async def test_no_reply_that_comes_twice_or_cut_in_half_is_taken_for_another_registers_value(others):
    illegal = EVERYTHING - set(APART) if others == "illegal" else frozenset()
    slaves = [
        *(Slave(twice_s=s, reply_s=r, illegal=illegal) for s in (0.0, 0.02, 0.1, 0.3) for r in (0.0, 0.01)),
        Slave(twice_s=0.02, every=4, late_s=0.15, illegal=illegal),
        *(Slave(cut=True, every=every, illegal=illegal) for every in (2, 5)),
    ]
    for recorder in await asyncio.gather(*(read_rtu(slave) for slave in slaves)):
        assert wrong(recorder) == []


@pytest.mark.parametrize("unit", [1, 2])
async def test_replies_to_another_master_are_never_taken(unit):
    frames = [bytes((unit, function, 2, 0, 99)) for function in (3, 4)]
    slave = Slave(foreign=b"".join(frame + crc(frame) for frame in frames))
    recorder = await read_rtu(slave)
    assert wrong(recorder) == []
    assert values(recorder)
    assert "unrequested" in recorder.driver.status.last_error


async def test_two_drivers_behind_a_box_that_sends_each_reply_to_all_clients_read_their_own_values():
    slave = Slave(reply_s=0.003)
    async with (
        on_tcp(slave, rtu=True, to_all=True) as port,
        running(tcp(port, transport="rtu-over-tcp").open("a")) as first,
        running(tcp(port, (1, 11, 21), transport="rtu-over-tcp").open("b")) as second,
    ):
        await first.more(30)
    assert wrong(first) == wrong(second) == []
    assert min(good_share(first), good_share(second)) > 0.5


@pytest.mark.parametrize("other", [lambda _: 0, lambda number: number + 1, lambda number: number ^ 0x100])
async def test_a_tcp_reply_with_another_transaction_is_refused(other):
    async with on_tcp(Slave(transaction=other)) as port, running(tcp(port).open("x")) as recorder:
        assert await recorder.fault("r0_1") in ("bad_reply", "timeout")
        await recorder.until(lambda r: r.faults.get("r0_1") == "bad_reply")
    assert values(recorder) == []
    assert "transaction" in recorder.driver.status.last_error


# --- bytes in another order ---


def float_words(value: float, order: str) -> dict[int, int]:
    """Registers 0 and 1 with a float in this byte order."""
    letters = dict(zip("ABCD", struct.pack(">f", value), strict=True))
    data = bytes(letters[letter] for letter in order)
    return {i: int.from_bytes(data[2 * i : 2 * i + 2], "big") for i in range(2)}


@pytest.mark.parametrize("order", ["CDAB", "BADC", "DCBA"])
async def test_a_float_in_another_byte_order_is_a_fault_and_the_look_at_the_wires_names_the_order(order):
    places = {"t1_degC": {"register": 0, "type": "float32"}}
    right = {"t1_degC": places["t1_degC"] | {"byte_order": order}}
    async with on_tcp(Slave(words=float_words(21.5, order))) as port:
        driver = tcp(port, channels=places).open("x")
        found = await asyncio.to_thread(look, [driver], lambda *_: None, 0.5)
        assert found["drivers"]["x"]["channels"]["t1_degC"]["fault"] == "tiny_number"
        assert "byte_order" in found["drivers"]["x"]["channels"]["t1_degC"]["remedy"]
        assert f"{order} would give 21.5" in found["drivers"]["x"]["last_error"]
        async with running(tcp(port, channels=right).open("x")) as recorder:
            assert await recorder.good("t1_degC") == 21.5


# --- one bad part does not take the rest ---


@pytest.mark.parametrize("dead_after_s", [0.15, None])
async def test_a_dead_unit_behind_a_gateway_costs_the_others_few_readings(dead_after_s):
    slave = Slave(units=(1, 2, 3), dead=(2,), dead_after_s=dead_after_s)
    async with contextlib.AsyncExitStack() as stack:
        port = await stack.enter_async_context(on_tcp(slave))
        first, dead, third = [
            await stack.enter_async_context(running(tcp(port, unit_id=unit).open(f"u{unit}")))
            for unit in (1, 2, 3)
        ]
        await third.more(60)
    assert wrong(first, 1) == wrong(third, 3) == values(dead) == []
    assert min(good_share(first), good_share(third)) > 0.5
    assert len(dead.readings) > 50  # a fault each period, whether asked or not


async def test_a_dead_unit_on_a_serial_line_is_asked_rarely_and_heard_when_it_is_back():
    slave = Slave(units=(1, 2), dead=(2,))
    async with (
        on_pty(slave) as port,
        running(rtu(port).open("u1")) as first,
        running(rtu(port, unit_id=2).open("u2")) as dead,
    ):
        await first.more(60)
        assert good_share(first) > 0.5
        slave.dead = ()
        await dead.good("r0_1")
    assert wrong(first, 1) == wrong(dead, 2) == []


@pytest.mark.parametrize("kind", ["illegal", "silent"])
async def test_a_register_that_is_refused_or_never_answered_costs_its_own_channel_only(kind):
    slave = Slave(**{kind: frozenset((7,))})
    registers = tuple(range(16))
    async with on_tcp(slave) as port, running(tcp(port, registers).open("x")) as recorder:
        await recorder.until(lambda r: set(r.faults) == {"r7_1"})
        before = len(recorder.readings)
        await recorder.more(20)
    assert recorder.driver.status.connected
    assert sum(set(r.faults) == {"r7_1"} for r in recorder.readings[before:]) > 10
    assert wrong(recorder) == []


async def test_a_silent_block_does_not_keep_later_blocks_from_being_read():
    async with on_pty(Slave(silent=frozenset((0,)))) as port, running(rtu(port).open("x")) as recorder:
        await recorder.until(lambda r: set(r.faults) == {"r0_1"})
    assert wrong(recorder) == []


@pytest.mark.parametrize(("most", "code"), [(16, 3), (16, 2), (1, 3), (7, 4)])
async def test_a_device_that_takes_few_registers_in_a_request_is_asked_for_few(most, code):
    slave = Slave(most=most, most_code=code)
    async with on_tcp(slave) as port, running(tcp(port, tuple(range(40))).open("x")) as recorder:
        await recorder.until(lambda r: not r.faults)
        before = len(slave.requests)
        await recorder.until(lambda r: not r.faults)
    assert max(count for *_, count in slave.requests[before:]) <= most
    assert wrong(recorder) == []


async def test_no_request_is_longer_than_max_registers():
    slave = Slave(most=5)
    driver = tcp(1, tuple(range(12)), max_registers=5)
    async with (
        on_tcp(slave) as port,
        running(driver.model_copy(update={"port": port}).open("x")) as recorder,
    ):
        await recorder.until(lambda r: not r.faults)
    assert {count for *_, count in slave.requests} <= {5, 2}


async def test_a_serial_line_that_is_cut_is_flagged_each_period_and_comes_back():
    slave = Slave()
    async with on_pty(slave) as port, running(rtu(port).open("x")) as recorder:
        await recorder.good("r20_1")
        slave.dead = (1,)
        await recorder.until(lambda r: r.faults.get("r20_1") == "timeout")
        cut = await recorder.more(5)
        # on a busy computer a poll may begin late, and then has not ended within its period
        assert all(len(r.faults) == 3 and set(r.faults.values()) <= {"timeout", "slow_poll"} for r in cut)
        assert not recorder.driver.status.connected
        slave.dead = ()
        await recorder.good("r20_1", timeout_s=1.0)
        assert recorder.driver.status.reconnects == 1


async def test_an_adapter_that_is_unplugged_is_looked_for_until_it_is_back(tmp_path):
    """The device file goes and comes, as that of a USB adapter does."""
    path = tmp_path / "ttyUSB0"
    async with contextlib.AsyncExitStack() as plugged:
        path.symlink_to(await plugged.enter_async_context(on_pty(Slave())))
        async with running(rtu(str(path)).open("x")) as recorder:
            await recorder.good("r0_1")
            path.unlink()
            await plugged.aclose()
            await recorder.until(lambda r: set(r.faults.values()) == {"disconnected"})
            async with on_pty(Slave()) as port:
                path.symlink_to(port)
                await recorder.good("r0_1", timeout_s=1.0)
                assert recorder.driver.status.reconnects == 1
    assert wrong(recorder) == []


# --- one connection for each wire ---


async def test_two_drivers_share_a_serial_port():
    slave = Slave(units=(1, 2))
    async with (
        on_pty(slave) as port,
        running(rtu(port).open("a")) as first,
        running(rtu(port, unit_id=2).open("b")) as second,
    ):
        await first.until(lambda r: not r.faults)
        await second.until(lambda r: not r.faults)
    assert wrong(first, 1) == wrong(second, 2) == []


@pytest.mark.parametrize("kind", ["modbus_tcp", "modbus_rtu"])
async def test_rtu_frames_over_tcp_are_read(kind):
    async with on_tcp(Slave(), rtu=True) as port:
        table = live.demo().model_dump(mode="json", exclude_unset=True, by_alias=True)
        table["drivers"] = {
            "x": {"kind": kind, "transport": "rtu-over-tcp", "host": "127.0.0.1", "port": port}
            | TIMES
            | {"channels": channels(APART) | {name: {"register": 1 + i} for i, name in enumerate(_NAMES)}}
        }
        driver = parse(table).drivers["x"]
        async with running(driver.open("x")) as recorder:
            await recorder.until(lambda r: not r.faults)
    assert {v for n, v in values(recorder) if n == "r20_1"} == {1020.0}


_NAMES = live.demo().channels


async def test_a_device_that_answers_in_rtu_frames_is_recognised_on_modbus_tcp():
    async with on_tcp(Slave(), rtu=True) as port, running(tcp(port).open("x")) as recorder:
        await recorder.until(lambda _: recorder.driver.status.last_error is not None)
        await recorder.until(lambda r: r.faults.get("r0_1") == "rtu_frames")
    assert 'answers in RTU frames: set transport = "rtu-over-tcp"' in recorder.driver.status.last_error


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [
        ({"baudrate": 9600}, {"baudrate": 19200}, "baudrate = 19200"),
        ({"parity": "E"}, {"parity": "N"}, "parity = 'N'"),
    ],
)
def test_two_drivers_on_one_serial_port_with_different_settings_are_refused(first, second, words):
    table = live.demo().model_dump(mode="json", exclude_unset=True, by_alias=True)
    common = {"kind": "modbus_rtu", "port": "/dev/ttyUSB7"}
    table["drivers"] = {
        "a": common | first | {"channels": {name: {"register": i} for i, name in enumerate(_NAMES)}},
        "b": common | second | {"channels": channels(APART), "unit_id": 2},
    }
    with pytest.raises(ConfigError, match=re.escape(words)) as refused:
        parse(table)
    assert "drivers.b: it shares /dev/ttyUSB7 with drivers.a" in str(refused.value)
    table["drivers"]["b"] |= first
    assert set(parse(table).drivers) == {"a", "b"}


# --- what is wrong is named ---


async def test_a_poll_longer_than_its_period_is_reported_with_its_duration():
    async with on_tcp(Slave(reply_s=0.03)) as port, running(tcp(port).open("x")) as recorder:
        await recorder.fault("r0_1")
        await recorder.until(lambda r: r.faults.get("r0_1") == "slow_poll")
        assert re.match(
            r"a poll takes 0\.\d+ s, longer than period_s = 0.05", recorder.driver.status.last_error
        )
        assert recorder.driver.status.connected
