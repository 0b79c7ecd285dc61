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

from drivers.can import CanSettings
from drivers.modbus import ModbusTcpSettings
from drivers.places import CanChannel
from drivers.simulated.machine import LEAD_M, NUT_LENGTH_M, SENSORS, STROKE_M
from tests.drivers.harness import running
from tests.patience import PATIENCE_S

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


async def test_a_module_of_another_make():
    async with machine("--map", "icpdas_m7018") as plant, running(plant.thermocouples("icpdas_m7018")) as tc:
        assert 20.0 < await tc.good("t5_degC") < 60.0
        await plant.fault(open="t5_degC")
        assert await tc.fault("t5_degC") == "open_circuit"
