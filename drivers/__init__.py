"""Drivers: from registers, frames and recordings to readings with a time and a fault for every channel.

Each driver is one file. It holds the driver's table of the configuration, and `DriverSettings` lists its
class. An external driver is selected by `kind = "module:Class"` or by a name of the entry-point group
`ballscrew_observer.drivers`. A bus library is imported only when its driver is opened.
"""

from __future__ import annotations

from typing import Annotated, Any, get_args

from pydantic import Field, SerializeAsAny, ValidatorFunctionWrapHandler, WrapValidator

from drivers.can import CanSettings
from drivers.canopen import CanopenSettings
from drivers.modbus import ModbusRtuSettings, ModbusTcpSettings
from drivers.mtconnect import MtConnectSettings
from drivers.opcua import OpcUaSettings
from drivers.player import PlayerSettings
from drivers.protocol import DriverTable
from observer.config.outside import is_outside, outside


def _from_outside(value: Any, validate_builtin: ValidatorFunctionWrapHandler) -> DriverTable:
    """Validate a driver's table by the external class that its `kind` names, or by one of the built-in
    classes.

    Raises `ValueError` if the external class is not a `DriverTable`.
    """
    kind = value.get("kind") if isinstance(value, dict) else None
    if kind == "modbus_rtu" and value.get("transport", "serial") != "serial":
        value = value | {"kind": "modbus_tcp"}  # RTU frames over TCP have a host and a port
    if kind in DRIVER_KINDS or not is_outside(kind, "drivers"):
        settings: DriverTable = validate_builtin(value)
        return settings
    table = outside(kind, "drivers")
    if not (isinstance(table, type) and issubclass(table, DriverTable)):
        raise ValueError(f"{kind} is not a driver's table; name a subclass of drivers.protocol.DriverTable")
    return table.model_validate(value)


DriverSettings = Annotated[
    ModbusTcpSettings
    | ModbusRtuSettings
    | CanSettings
    | CanopenSettings
    | OpcUaSettings
    | MtConnectSettings
    | PlayerSettings,
    Field(discriminator="kind"),
    WrapValidator(_from_outside),
    SerializeAsAny(),
]

DRIVER_KINDS: tuple[str, ...] = tuple(
    get_args(table.model_fields["kind"].annotation)[0] for table in get_args(get_args(DriverSettings)[0])
)
