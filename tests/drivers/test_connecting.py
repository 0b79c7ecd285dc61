"""A device that cannot be reached is reported in words that name the place and what to check."""

from __future__ import annotations

import socket
from typing import Any

import pytest

from drivers.modbus import ModbusRtuSettings, ModbusTcpSettings
from drivers.mtconnect import MtConnectSettings
from drivers.opcua import OpcUaSettings
from drivers.protocol import DriverTable
from tests.drivers.harness import running


def closed_port() -> int:
    """A port on which nothing listens."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def modbus(**keys: Any) -> ModbusTcpSettings:
    """The table of a module with one channel."""
    return ModbusTcpSettings(kind="modbus_tcp", period_s=0.05, channels={"t1_degC": {"register": 0}}, **keys)


def refused_modbus() -> DriverTable:
    return modbus(host="127.0.0.1", port=closed_port())


def refused_opcua() -> DriverTable:
    url = f"opc.tcp://127.0.0.1:{closed_port()}"
    return OpcUaSettings(kind="opcua", url=url, channels={"x_m": {"node": "ns=2;s=X"}})


def refused_mtconnect() -> DriverTable:
    url = f"http://127.0.0.1:{closed_port()}"
    return MtConnectSettings(kind="mtconnect", url=url, channels={"x_m": {"item": "x"}})


def no_such_port() -> DriverTable:
    return ModbusRtuSettings(kind="modbus_rtu", port="/dev/ttyABSENT7", channels={"t1_degC": {"register": 0}})


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (refused_modbus, ("nothing listens at 127.0.0.1:", "check address and port")),
        (refused_opcua, ("nothing listens at opc.tcp://127.0.0.1:", "check address and port")),
        (refused_mtconnect, ("nothing listens at http://127.0.0.1:", "check address and port")),
        (no_such_port, ("there is no /dev/ttyABSENT7", "plug the adapter in")),
        (
            lambda: modbus(host="no-such-module.invalid"),
            ("no computer has the name", "no-such-module.invalid"),
        ),
    ],
)
async def test_a_device_that_is_not_there_is_named_with_what_to_check(made, words):
    driver = made().open("module")
    async with running(driver) as recorder:
        await recorder.until(lambda _: driver.status.last_error)
        said = driver.status.last_error
    for word in words:
        assert word in said
    assert "Errno" not in said
    assert "Connect call" not in said
