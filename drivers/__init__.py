"""Drivers: from registers, frames and recordings to readings with a time and a fault for every channel."""

from __future__ import annotations

from drivers.protocol import Clock, Deliver, Driver, DriverStatus
from drivers.settings import (
    CanopenSettings,
    CanSettings,
    DriverSettings,
    ModbusRtuSettings,
    ModbusTcpSettings,
    PlayerSettings,
)

__all__ = ["Clock", "Deliver", "Driver", "DriverStatus", "open_driver"]


def open_driver(name: str, settings: DriverSettings) -> Driver:
    """Make the driver that the settings describe; only its own bus library is imported.

    Nothing is connected yet: that is for `run`. Raises `UserError` where a file that the settings name (a
    DBC file, a log) cannot be used.
    """
    match settings:
        case ModbusTcpSettings() | ModbusRtuSettings():
            from drivers.modbus import ModbusDriver  # noqa: PLC0415 (each bus library only when it is used)

            return ModbusDriver(name, settings)
        case CanSettings():
            from drivers.can import open_can  # noqa: PLC0415

            return open_can(name, settings)
        case CanopenSettings():
            from drivers.canopen import open_canopen  # noqa: PLC0415

            return open_canopen(name, settings)
        case PlayerSettings():
            from drivers.player import Player  # noqa: PLC0415

            return Player(name, settings)
