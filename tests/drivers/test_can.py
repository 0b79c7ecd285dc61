"""CAN: decoding by DBC, a live bus that falls silent or dies, and an adapter that must only listen."""

import asyncio
import itertools
import math
import os
import select
import time
import tty
from contextlib import contextmanager
from pathlib import Path

import can
import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can import CanSettings
from drivers.dbc import load_decoder
from drivers.places import CanChannel
from drivers.simulated.wires import AxisBus
from tests.drivers.harness import running
from tests.patience import PATIENCE_S, Stopwatch, eventually

AXIS_DBC = Path("drivers/simulated/axis.dbc")
AXIS = cantools.database.load_file(AXIS_DBC).get_message_by_name("AxisStatus")
CHANNELS = {
    "nut_position_m": CanChannel(message="AxisStatus", signal="NutPosition"),
    "screw_speed_rpm": CanChannel(message="AxisStatus", signal="ScrewSpeed"),
}


def settings(**more):
    return CanSettings(
        **(
            {
                "kind": "can",
                "interface": "virtual",
                "channel": "test",
                "dbc": AXIS_DBC,
                "channels": CHANNELS,
                "period_s": 0.05,
                "timeout_s": 0.15,
            }
            | more
        )
    )


def frame(position_m=0.5, speed_rpm=1500.0, state=2, **more):
    signals = {"NutPosition": position_m, "ScrewSpeed": speed_rpm, "AxisState": state, "AliveCounter": 7}
    data = AXIS.encode(signals, strict=False)
    return can.Message(**({"arbitration_id": AXIS.frame_id, "data": data, "is_extended_id": False} | more))


@contextmanager
def virtual_bus(channel="test"):
    with can.Bus(interface="virtual", channel=channel) as bus:
        yield bus


@given(st.integers(0, 1_000_000), st.integers(0, 60_000))
def test_what_a_dbc_file_encodes_is_decoded(position_um, speed_tenths):
    decoded = load_decoder(settings().signals("axis"))(frame(position_um * 1e-6, speed_tenths * 0.1))
    # a step of each signal: 1 µm and 0.1 rpm; the arithmetic may lose the last bits
    assert decoded[0]["nut_position_m"] == pytest.approx(position_um * 1e-6, abs=1e-12)
    assert decoded[0]["screw_speed_rpm"] == pytest.approx(speed_tenths * 0.1, abs=1e-9)
    assert decoded[1] == {}


@pytest.mark.parametrize(
    ("position_m", "fault"),
    [(0.0, None), (1.0, None), (1.000001, "out_of_range"), (-0.000001, "out_of_range")],
)
def test_the_files_own_limits_hold(position_m, fault):
    values, faults = load_decoder(settings().signals("axis"))(frame(position_m))
    assert faults.get("nut_position_m") == fault
    assert math.isnan(values["nut_position_m"]) == (fault is not None)
    assert "screw_speed_rpm" not in faults


def test_named_values_decode_to_their_numbers():
    state = {"state_1": CanChannel(message="AxisStatus", signal="AxisState", scale=10.0, offset=1.0)}
    assert load_decoder(settings(channels=state).signals("axis"))(frame(state=3)) == ({"state_1": 31.0}, {})


@pytest.mark.parametrize(
    ("fault_values", "state", "fault"),
    [
        ({3: "drive_fault"}, 3, "drive_fault"),
        ({3: "drive_fault"}, 2, None),
        ({}, 2, "status_2"),
        ({}, 0, None),
    ],
)
def test_a_status_signal_makes_a_plausible_value_a_fault(fault_values, state, fault):
    channel = CHANNELS["nut_position_m"].model_copy(
        update={"fault_signal": "AxisState", "fault_values": fault_values}
    )
    values, faults = load_decoder(settings(channels={"x_m": channel}).signals("axis"))(frame(state=state))
    assert faults.get("x_m") == fault
    assert math.isnan(values["x_m"]) == (fault is not None)


@pytest.mark.parametrize(
    "stranger",
    [
        frame(arbitration_id=0x202),
        frame(is_extended_id=True),
        frame(is_fd=True),
        can.Message(arbitration_id=AXIS.frame_id, is_extended_id=False, is_remote_frame=True, dlc=8),
        can.Message(arbitration_id=AXIS.frame_id, is_extended_id=False, is_error_frame=True),
    ],
    ids=["other identifier", "extended", "fd", "remote", "error"],
)
def test_frames_of_others_are_nothing(stranger):
    assert load_decoder(settings().signals("axis"))(stranger) is None


def test_a_frame_that_is_too_short_is_a_fault_of_all_it_should_hold():
    values, faults = load_decoder(settings().signals("axis"))(frame(data=b"\x00" * 7))
    assert faults == dict.fromkeys(CHANNELS, "short_frame")
    assert all(math.isnan(value) for value in values.values())


def test_canmod_temp_as_in_its_manual():
    """The payload and its meaning are the decoding example of CSS Electronics' manual."""
    channels = {"tl_degC": 0, "tr_degC": 1, "bl_degC": 2, "br_degC": 3}
    decode = load_decoder(settings(dbc=None, device="css_canmod_temp", channels=channels).signals("tc"))
    message = can.Message(arbitration_id=1, is_extended_id=False, data=bytes.fromhex("9904600A28198EBE"))
    values, faults = decode(message)
    assert values["tl_degC"] == 1.0
    assert faults == {"tr_degC": "cold_junction", "bl_degC": "open_circuit", "br_degC": "out_of_range"}


def test_mu_thermocouple1_is_little_endian_sixteenths():
    channels = {"a_degC": 0, "b_degC": 3, "c_degC": 4}
    decode = load_decoder(settings(dbc=None, device="peak_mu_thermocouple1", channels=channels).signals("tc"))
    first = can.Message(arbitration_id=0x100, is_extended_id=False, data=bytes.fromhex("9001 0000 0000 F0FF"))
    second = can.Message(arbitration_id=0x101, is_extended_id=False, data=bytes.fromhex("0100000000000000"))
    assert decode(first) == ({"a_degC": 25.0, "b_degC": -1.0}, {})
    assert decode(second) == ({"c_degC": 0.0625}, {})


async def test_frames_become_readings_stamped_by_the_services_clock():
    with virtual_bus() as bus:
        async with running(settings().open("axis"), now=lambda: 42.5) as axis:
            await axis.until(lambda _: axis.driver.status.connected)
            bus.send(frame(0.25, 800.0))
            reading = await axis.until(lambda r: not r.faults)
    assert 41.0 < reading.time_s <= 42.5  # the moment it waited for a busy computer is taken off
    assert reading.values == {"nut_position_m": pytest.approx(0.25), "screw_speed_rpm": pytest.approx(800.0)}


async def test_frames_that_wait_for_a_busy_program_have_the_times_of_their_sending():
    def now():
        time.sleep(0.03)  # the thread that receives is held up at every frame
        return time.time()

    with virtual_bus() as bus:
        async with running(settings().open("axis"), now) as axis:
            await axis.until(lambda _: axis.driver.status.connected)
            sent = []
            for k in range(10):
                before_s = time.time()
                bus.send(frame(0.01 * k))
                sent.append((before_s, time.time()))
                await asyncio.sleep(0.005)
            await axis.until(lambda r: r.values["nut_position_m"] == pytest.approx(0.09))
            times = [r.time_s for r in axis.readings if not r.faults]
    assert all(a - 0.01 <= t <= b + 0.01 for t, (a, b) in zip(times, sent, strict=True))


async def test_a_silent_bus_is_a_fault_each_period_until_it_speaks_again():
    with virtual_bus() as bus:
        async with running(settings().open("axis")) as axis:
            await axis.until(lambda _: axis.driver.status.connected)
            bus.send(frame())
            await axis.good("nut_position_m")
            assert await axis.fault("nut_position_m") == "silent"
            watch = Stopwatch()
            silent = await axis.more(4)
            assert watch.took_s() < 0.4  # eight periods of 0.05 s
            assert all(r.faults == dict.fromkeys(CHANNELS, "silent") for r in silent)
            bus.send(frame())
            await axis.good("nut_position_m", timeout_s=1.0)


async def test_one_message_that_is_missing_does_not_hide_behind_another():
    channels = {"a_degC": 0, "b_degC": 4}
    tc_settings = settings(dbc=None, device="peak_mu_thermocouple1", channels=channels, timeout_s=0.5)
    with virtual_bus() as bus:
        async with running(tc_settings.open("tc")) as tc:
            await tc.until(lambda _: tc.driver.status.connected)
            half = can.Message(arbitration_id=0x100, is_extended_id=False, data=bytes(8))
            bus.send(half)
            await tc.good("a_degC")
            seen = len(tc.readings)
            await eventually(lambda: bus.send(half) or [r for r in tc.readings[seen:] if r.faults])
            (fault,) = {tuple(r.faults.items()) for r in tc.readings[seen:] if r.faults}
            assert fault == (("b_degC", "silent"),)


async def test_frames_that_nobody_can_take_in_time_are_counted(monkeypatch):
    monkeypatch.setattr("drivers.can_bus.MAX_PENDING", 5)
    with virtual_bus() as bus:
        async with running(settings().open("axis")) as axis:
            await axis.until(lambda _: axis.driver.status.connected)
            await eventually(lambda: _overwhelm(bus) or axis.driver.status.drops)


def _overwhelm(bus):
    """Send more frames than may wait, while the event loop is too busy to take them."""
    for _ in range(50):
        bus.send(frame())
    time.sleep(0.1)


async def test_an_interface_that_cannot_be_opened_is_tried_again_and_flagged():
    driver = settings(interface="slcan", channel="/no/such/device").open("axis")
    async with running(driver) as axis:
        assert await axis.fault("nut_position_m") == "disconnected"
        await axis.until(lambda _: driver.status.errors >= 2)
        assert "/no/such/device" in driver.status.last_error


class Adapter:
    """A serial CAN adapter on a pty: notes what it receives, and sends frames as text lines."""

    def __init__(self, path):
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        path.unlink(missing_ok=True)
        path.symlink_to(os.ttyname(self._slave))

    def send(self, message, stamp=""):
        line = f"t{message.arbitration_id:03X}8{message.data.hex().upper()}{stamp}\r"
        os.write(self.master, line.encode())

    def received(self):
        return os.read(self.master, 4096)

    def unplug(self):
        os.close(self.master)
        os.close(self._slave)


async def test_an_adapter_is_opened_to_listen_only_and_found_again(tmp_path):
    path = tmp_path / "ttyACM0"
    adapter = Adapter(path)
    driver = settings(interface="slcan", channel=str(path), bitrate=500_000).open("axis")
    async with running(driver) as axis:
        await axis.until(lambda _: driver.status.connected)
        adapter.send(frame(0.125))
        assert await axis.good("nut_position_m") == pytest.approx(0.125)
        # close, 500 kbit/s, listen: "O" would let the adapter acknowledge frames, "t" or "T" send one
        assert set(adapter.received().split(b"\r")) <= {b"C", b"S6", b"L", b""}
        adapter.unplug()
        assert await axis.fault("nut_position_m") in ("silent", "disconnected")
        await axis.until(lambda r: r.faults.get("nut_position_m") == "disconnected")
        adapter = Adapter(path)
        await axis.until(lambda _: driver.status.connected, timeout_s=1.0)
        adapter.send(frame(0.25))
        assert await axis.good("nut_position_m", timeout_s=1.0) == pytest.approx(0.25)
        assert driver.status.reconnects == 1
    adapter.unplug()


async def test_a_burst_of_an_adapter_that_stamps_is_spread_as_it_was_on_the_wire(tmp_path):
    """Ten frames 20 ms apart come at once, over the turn of the adapter's minute."""
    path = tmp_path / "ttyACM0"
    adapter = Adapter(path)
    driver = settings(interface="slcan", channel=str(path)).open("axis")
    begin_s = time.monotonic()

    def stamp(time_s):
        return f"{(59_500 + round(1e3 * (time_s - begin_s))) % 60_000:04X}"

    async with running(driver) as axis:
        await axis.until(lambda _: driver.status.connected)
        for k in range(20):
            adapter.send(frame(0.001 * k), stamp(time.monotonic()))
            await axis.until(lambda r, k=k: r.values["nut_position_m"] == pytest.approx(0.001 * k))
        await asyncio.sleep(0.5)  # frames come, and nobody hands them on
        now_s = time.monotonic()
        for k in range(10):
            adapter.send(frame(0.5 + 0.01 * k), stamp(now_s - 0.02 * (9 - k)))
        await axis.until(lambda r: r.values["nut_position_m"] == pytest.approx(0.59))
        burst = [r.time_s for r in axis.readings if r.values["nut_position_m"] > 0.3]
    assert [b - a for a, b in itertools.pairwise(burst)] == pytest.approx([0.02] * 9, abs=2e-3)
    adapter.unplug()


async def test_garbage_between_frames_does_not_become_a_value(tmp_path):
    path = tmp_path / "ttyACM0"
    adapter = Adapter(path)
    driver = settings(interface="slcan", channel=str(path)).open("axis")
    async with running(driver) as axis:
        await axis.until(lambda _: driver.status.connected)
        for garbage in (b"t20", b"tXYZ8", b"\xff\xfe", b"T0000", b"t2018zz"):
            seen = driver.status.errors
            os.write(adapter.master, garbage + b"\r")
            await _counted(driver, seen + 1)
        assert all(r.faults for r in axis.readings)
        adapter.send(frame(0.75))
        assert await axis.good("nut_position_m") == pytest.approx(0.75)
        assert driver.status.connected
    adapter.unplug()


async def _counted(driver, errors):
    # bytes that are no text make python-can give the bus up, and the driver open it again
    await eventually(lambda: driver.status.errors >= errors and driver.status.connected)


async def test_a_client_that_opens_the_simulated_adapter_late_gets_no_old_frames():
    bus = AxisBus(stamps=False, seed=1)
    try:
        bus.send(0.2, 100.0, 0.02)
        late = os.open(bus.device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        bus.send(0.9, 100.0, 0.02)
        assert select.select([late], [], [], PATIENCE_S)[0]
        assert os.read(late, 100).count(b"\r") == 1
        os.close(late)
    finally:
        bus.close()
