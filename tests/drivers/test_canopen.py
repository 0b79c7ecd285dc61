"""The nut's position from a DS-402 drive, whose part is played by the `canopen` library."""

import asyncio
import math
import struct

import can
import canopen
import pytest
from canopen.objectdictionary import INTEGER32, ODVariable

from drivers.canopen import CanopenSettings
from tests.drivers.harness import running

NODE = 5


def settings(**more):
    return CanopenSettings(
        kind="canopen",
        interface="virtual",
        channel="drive",
        node_id=NODE,
        counts_per_m=1e6,
        offset_m=0.1,
        period_s=0.05,
        timeout_s=0.15,
        **more,
    )


@pytest.mark.parametrize(
    ("where", "identifier", "data"),
    [
        ({}, 0x185, struct.pack("<i", -50_000)),
        ({"cob_id": 0x285, "position_byte": 2}, 0x285, struct.pack("<Hi", 0x1237, -50_000)),
    ],
)
async def test_process_data_is_listened_to(where, identifier, data):
    with can.Bus(interface="virtual", channel="drive") as bus:
        async with running(settings(**where).open("drive")) as drive:
            await drive.until(lambda _: drive.driver.status.connected)
            bus.send(can.Message(arbitration_id=identifier + 1, data=data, is_extended_id=False))
            bus.send(can.Message(arbitration_id=identifier, data=data[:-1], is_extended_id=False))
            reading = await drive.until(lambda r: r.faults.get("nut_position_m") == "short_frame")
            assert math.isnan(reading.values["nut_position_m"])
            bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
            assert await drive.good("nut_position_m") == pytest.approx(0.05)
            assert bus.recv(timeout=0.0) is None  # listening sends nothing


class Drive:
    """A CANopen node with the object 0x6064."""

    def __init__(self, has_position=True):
        dictionary = canopen.ObjectDictionary()
        variable = ODVariable("Position actual value", 0x6064 if has_position else 0x6063)
        variable.data_type = INTEGER32
        variable.default = 250_000
        dictionary.add_object(variable)
        self.network = canopen.Network()
        self.network.NOTIFIER_CYCLE = 0.05
        self.network.connect(interface="virtual", channel="drive")
        self.node = self.network.create_node(NODE, dictionary)

    def close(self):
        self.network.disconnect()


async def test_the_position_is_uploaded_each_period():
    drive = Drive()
    spy = can.Bus(interface="virtual", channel="drive")
    try:
        async with running(settings(mode="sdo").open("drive")) as reader:
            assert await reader.good("nut_position_m") == pytest.approx(0.35)
            drive.node.sdo[0x6064].raw = -100_000
            await reader.until(lambda r: r.values["nut_position_m"] == pytest.approx(0.0, abs=1e-9))
        sent = set()
        while (message := spy.recv(timeout=0.0)) is not None:
            if message.arbitration_id != 0x580 + NODE:
                sent.add((message.arbitration_id, bytes(message.data)))
        # nothing but the request to upload 0x6064
        assert sent == {(0x600 + NODE, bytes.fromhex("4064600000000000"))}
    finally:
        spy.shutdown()
        await asyncio.to_thread(drive.close)


async def test_a_drive_without_the_object_is_a_fault_with_its_abort_code():
    drive = Drive(has_position=False)
    try:
        async with running(settings(mode="sdo").open("drive")) as reader:
            assert await reader.fault("nut_position_m") == "sdo_abort_06020000"
    finally:
        await asyncio.to_thread(drive.close)


async def test_a_drive_that_does_not_answer_is_silent():
    async with running(settings(mode="sdo").open("drive")) as reader:
        while (fault := await reader.fault("nut_position_m")) == "disconnected":  # the bus opens first
            pass
        assert fault == "silent"
