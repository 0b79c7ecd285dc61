"""The simulated machine as a process, read over its own wires with the real drivers."""

import asyncio
import itertools
import json
import os
import signal
import sys
import time
from contextlib import asynccontextmanager

import pytest
import zenoh

from drivers.can import CanSettings
from drivers.modbus import ModbusTcpSettings
from drivers.places import CanChannel
from drivers.simulated.machine import LEAD_M, NUT_LENGTH_M, SENSORS, STROKE_M
from tests.drivers.harness import running
from tests.patience import HERE, PATIENCE_S, Stopwatch, eventually

pytestmark = pytest.mark.system

SPEED_M_S = LEAD_M * 1500 / 60  # the programme's first four minutes


class Machine:
    """The running process and where its wires are."""

    def __init__(self, process, places):
        self.process = process
        self.places = places

    async def fault(self, **faults):
        self.process.stdin.write(json.dumps({"fault": faults}).encode() + b"\n")
        async with asyncio.timeout(PATIENCE_S):
            return json.loads(await self.process.stdout.readline())

    def thermocouples(self, device="wago_750_458"):
        settings = ModbusTcpSettings(
            kind="modbus_tcp",
            host="127.0.0.1",
            port=self.places["modbus_port"],
            device=device,
            channels={name: number for number, name in enumerate(SENSORS)},
            period_s=0.05,
            timeout_s=0.5,
        )
        return settings.open("thermocouples")

    def axis(self):
        channels = {
            "nut_position_m": CanChannel(message="AxisStatus", signal="NutPosition"),
            "screw_speed_rpm": CanChannel(message="AxisStatus", signal="ScrewSpeed"),
        }
        settings = CanSettings(
            kind="can",
            interface="slcan",
            channel=self.places["can_device"],
            dbc="drivers/simulated/axis.dbc",
            channels=channels,
            period_s=0.02,
            timeout_s=0.3,
        )
        return settings.open("axis")


@asynccontextmanager
async def machine(*options):
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "drivers.simulated",
        "--warm-minutes",
        "1",
        *options,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
    )
    try:
        async with asyncio.timeout(PATIENCE_S):
            places = json.loads(await process.stdout.readline())
        yield Machine(process, places)
    finally:
        process.stdin.close()
        async with asyncio.timeout(PATIENCE_S):
            assert await process.wait() == 0


async def test_its_wires_carry_temperatures_position_and_speed():
    async with machine() as plant, running(plant.thermocouples()) as tc, running(plant.axis()) as axis:
        reading = await tc.until(lambda r: not r.faults)
        # warm, and nowhere hotter than 35 W into this screw can make it within a minute
        assert all(20.0 < value < 60.0 for value in reading.values.values())
        first = await axis.until(lambda r: not r.faults)
        assert first.values["screw_speed_rpm"] == pytest.approx(1500.0)
        watch = Stopwatch(HERE, plant.process.pid)
        good = [r for r in await axis.more(50) if not r.faults]
        assert watch.took_s() < 2.0  # 50 frames a second
        assert len(good) > 45
        assert len({r.values["nut_position_m"] for r in good}) > 45


def nut_position_m(first, second, time_s):
    """Where the nut is at a time, from two readings while the screw turns at 1500 rpm."""
    low_m, reach_m = STROKE_M[0] + NUT_LENGTH_M / 2, STROKE_M[1] - STROKE_M[0] - NUT_LENGTH_M
    phase_m = first.values["nut_position_m"] - low_m
    if second.values["nut_position_m"] < first.values["nut_position_m"]:
        phase_m = 2 * reach_m - phase_m
    phase_m = (phase_m + SPEED_M_S * (time_s - first.time_s)) % (2 * reach_m)
    return low_m + (phase_m if phase_m <= reach_m else 2 * reach_m - phase_m)


async def test_it_is_where_it_would_have_been_after_a_hold_up():
    async with machine("--can-stamps") as plant, running(plant.axis()) as axis:
        await axis.good("nut_position_m")
        await asyncio.sleep(1.0)
        os.kill(plant.process.pid, signal.SIGSTOP)
        stopped_s = time.time()
        await asyncio.sleep(1.0)
        resumed_s = time.time()
        os.kill(plant.process.pid, signal.SIGCONT)
        await axis.until(lambda r: not r.faults and r.time_s > resumed_s + 0.5)
        good = [r for r in axis.readings if not r.faults]
    assert not [r for r in good if stopped_s + 0.1 < r.time_s < resumed_s - 0.1]
    first, second = [r for r in good if r.time_s < stopped_s][-2:]
    for reading in (r for r in good if r.time_s > resumed_s):  # frames sent late would be 0.25 m off
        expected_m = nut_position_m(first, second, reading.time_s)
        assert reading.values["nut_position_m"] == pytest.approx(expected_m, abs=0.02)


@pytest.mark.parametrize("stamps", [True, False])
async def test_frames_that_are_held_up_come_at_once_and_have_their_own_times_where_they_are_stamped(stamps):
    async with machine(*["--can-stamps"] * stamps) as plant, running(plant.axis()) as axis:
        await axis.good("nut_position_m")
        await axis.until(lambda _: len(axis.readings) > 20)
        seen = len(axis.readings)
        await plant.fault(hold_can_s=0.5)
        await axis.until(lambda _: len(axis.readings) > seen + 40)
    times = [r.time_s for r in axis.readings[seen:] if not r.faults]
    together = sum(b - a < 0.002 for a, b in itertools.pairwise(times))
    assert together <= 2 if stamps else together > 10


async def test_its_faults_reach_the_drivers_as_faults():
    async with machine() as plant, running(plant.thermocouples()) as tc, running(plant.axis()) as axis:
        await tc.good("t3_degC")
        await axis.good("nut_position_m")
        plant.process.stdin.write(b'{"fault": {"burn": true}}\nnonsense\n')  # is rejected without harm
        assert await plant.fault(open="t3_degC", over_range="t4_degC") == {
            "faults": {"open": ["t3_degC"], "over_range": ["t4_degC"]}
        }
        reading = await tc.until(lambda r: "t3_degC" in r.faults)
        assert reading.faults == {"t3_degC": "open_circuit", "t4_degC": "over_range"}
        await plant.fault(exception=4)
        assert await tc.fault("t1_degC") == "exception_4"
        await plant.fault(silence_can=True)
        assert await axis.fault("nut_position_m") == "silent"
        await plant.fault(drop_modbus=True)
        await tc.until(lambda r: r.faults.get("t1_degC") == "disconnected")
        await plant.fault()
        watch = Stopwatch(HERE, plant.process.pid)
        await tc.good("t1_degC")
        await axis.good("nut_position_m")
        assert watch.took_s() < 1.0
        await plant.fault(stuck="t2_degC")
        await tc.good("t2_degC")
        last = [r.values for r in (await tc.more(8))[2:] if not r.faults]
        assert len({values["t2_degC"] for values in last}) == 1


async def test_wrong_values_reach_the_drivers_as_any_others():
    warm = machine("--warm-minutes", "20")
    async with warm as plant, running(plant.thermocouples()) as tc, running(plant.axis()) as axis:
        before = {name: await tc.good(name) for name in ("t1_degC", "t2_degC", "t3_degC")}
        assert before["t1_degC"] > before["t2_degC"] + 2.0
        wanted = {"offset_K": {"t3_degC": 3.0}, "exchanged": ["t1_degC", "t2_degC"]}
        assert await plant.fault(**wanted) == {"faults": wanted}
        values = (await tc.more(4))[-1].values
        assert values["t1_degC"] == pytest.approx(before["t2_degC"], abs=0.5)
        assert values["t2_degC"] == pytest.approx(before["t1_degC"], abs=0.5)
        assert values["t3_degC"] == pytest.approx(before["t3_degC"] + 3.0, abs=0.5)
        await plant.fault(exchanged=["t1_degC", "t2_degC"], offset_K={"t1_degC": 3.0})
        values = (await tc.more(4))[-1].values  # the offset is that of what is read, not of the plug
        assert values["t1_degC"] == pytest.approx(before["t2_degC"] + 3.0, abs=0.5)
        await axis.good("nut_position_m")
        await plant.fault(homed_off_m=0.2)
        await axis.more(20)
        pairs = itertools.pairwise([r.values["nut_position_m"] for r in axis.readings if not r.faults])
        assert max(abs(b - a) for a, b in pairs) == pytest.approx(0.2, abs=0.05)


async def test_a_module_of_another_make():
    async with machine("--map", "icpdas_m7018") as plant, running(plant.thermocouples("icpdas_m7018")) as tc:
        assert 20.0 < await tc.good("t5_degC") < 60.0
        await plant.fault(open="t5_degC")
        assert await tc.fault("t5_degC") == "open_circuit"


async def test_the_position_that_a_late_listener_hears_is_of_now():
    async with machine() as plant:
        async with running(plant.thermocouples()) as tc:
            await tc.more(20)  # a second: fifty frames that nobody hears
        async with running(plant.axis()) as axis:
            await axis.good("nut_position_m")
            await axis.more(20)
        positions_m = [r.values["nut_position_m"] for r in axis.readings if not r.faults]
        times_s = [r.time_s for r in axis.readings if not r.faults]
        # 0.25 m/s for what was heard; the fifty frames would have added 0.25 m at once; a first frame that
        # a busy computer hands on 0.4 s late adds 0.1 m
        travelled_m = sum(abs(b - a) for a, b in itertools.pairwise(positions_m))
        assert travelled_m <= 0.25 * (times_s[-1] - times_s[0]) + 0.1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
async def test_it_ends_on_signals(number):
    async with machine() as plant:
        watch = Stopwatch(HERE, plant.process.pid)
        os.kill(plant.process.pid, number)
        await eventually(lambda: watch.held_up_s() and plant.process.returncode is not None)
        assert watch.took_s() < 3.0
        assert plant.process.returncode == 0


async def test_the_truth_is_published_once_there_is_a_router(unused_tcp_port):
    endpoint = f"tcp/127.0.0.1:{unused_tcp_port}"
    key = "ballscrew/test/x/truth/heat"
    async with machine("--zenoh", endpoint, "--key", key) as plant:
        async with running(plant.thermocouples()) as tc:
            await tc.more(10)  # it does not mind that there is no router yet
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps([endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        with zenoh.open(config) as router:
            ring = zenoh.handlers.RingChannel(1)
            with router.declare_subscriber(key, ring) as subscriber:
                sample = await eventually(subscriber.try_recv)
        truth = json.loads(sample.payload.to_string())
        assert set(truth) == {"time_s", "sequence", "sources", "quality"}
        assert set(truth["sources"]) == {"nut", "left_bearing", "right_bearing"}
        assert truth["sources"]["nut"]["heat_W"] > 20.0
        assert truth["sources"]["nut"]["sigma_W"] == 0.0
        assert truth["quality"] == "good"
        assert plant.process.returncode is None
