"""Drivers: from registers, frames and recordings to readings with a time and a fault for every channel.

A driver is one file, with its table of the configuration in it, and one name in `DriverSettings`. None
imports its bus library before it is opened.
"""

from __future__ import annotations

from typing import Annotated, get_args

from pydantic import Field

from drivers.can import CanSettings
from drivers.canopen import CanopenSettings
from drivers.modbus import ModbusRtuSettings, ModbusTcpSettings
from drivers.mtconnect import MtConnectSettings
from drivers.opcua import OpcUaSettings
from drivers.player import PlayerSettings

DriverSettings = Annotated[
    ModbusTcpSettings
    | ModbusRtuSettings
    | CanSettings
    | CanopenSettings
    | OpcUaSettings
    | MtConnectSettings
    | PlayerSettings,
    Field(discriminator="kind"),
]

DRIVER_KINDS: tuple[str, ...] = tuple(
    get_args(table.model_fields["kind"].annotation)[0] for table in get_args(get_args(DriverSettings)[0])
)
