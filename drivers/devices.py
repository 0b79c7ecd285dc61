"""Ready maps of thermocouple modules: input number → where its value is and what its fault codes mean.

Each map holds for the module's factory settings that its docstring names; anything else is written out in
the configuration.
"""

from __future__ import annotations

import os
from pathlib import Path

from drivers.places import CanChannel, ModbusChannel

MODBUS_INPUTS = {"icpdas_m7018": 8, "wago_750_458": 8, "micro800_tc2": 2}
"""How many inputs each ready map has."""
CAN_INPUTS = {"css_canmod_temp": 4, "peak_mu_thermocouple1": 8}

DBC_OF = {
    "css_canmod_temp": Path(__file__).parent / "maps" / "css_canmod_temp.dbc",
    "peak_mu_thermocouple1": Path(__file__).parent / "maps" / "peak_mu_thermocouple1.dbc",
}


def modbus_input(device: str, number: int, first_register: int = 0) -> ModbusChannel:
    """Where a ready map has an input; `first_register` is where the module's block begins."""
    return _MODBUS[device](number, first_register)


def dbc_file(path: Path) -> Path:
    """A DBC file as given, or, where that does not exist, one that comes with the drivers."""
    bundled = Path(__file__).parent.parent / path
    return bundled if not os.path.exists(path) and os.path.exists(bundled) else path


def can_input(device: str, number: int) -> CanChannel:
    """Which signal of the device's DBC file an input is."""
    return {"css_canmod_temp": _canmod_temp, "peak_mu_thermocouple1": _mu_thermocouple1}[device](number)


def _m7018(number: int, first: int) -> ModbusChannel:
    """ICP DAS M-7018, engineering format of 0.1 °C: input registers 30001–30008."""
    return ModbusChannel(
        register=first + number, scale=0.1, fault_codes={0x7FFF: "open_circuit", 0x8000: "under_range"}
    )


def _wago_750_458(number: int, first: int) -> ModbusChannel:
    """WAGO 750-458, 0.1 °C, word-aligned process image: status byte in the word before each data word.

    The module clamps a value beyond its range to the end of the range and says so in the status byte only:
    0x41 under, 0x42 over, 0x60 wire break; 0x80 marks register communication, whose data is no temperature.
    """
    return ModbusChannel(
        register=first + 2 * number + 1,
        scale=0.1,
        fault_codes={0x7FFF: "open_circuit", 0x8000: "cold_junction"},
        status_register=first + 2 * number,
        status_faults={
            0x80: "register_communication",
            0x20: "open_circuit",
            0x01: "under_range",
            0x02: "over_range",
            0x40: "module_error",
        },
    )


def _micro800_tc2(number: int, first: int) -> ModbusChannel:
    """Rockwell 2080-TC2, its words mapped to registers in order: two data words, two information words.

    Counts are 10 · (t + 270 °C), so 0.1 °C with an offset of −270 °C (Rockwell 2080-UM004, appendix 3).
    """
    return ModbusChannel(
        register=first + number,
        type="uint16",
        scale=0.1,
        offset=-270.0,
        status_register=first + 2 + number,
        status_faults={
            1 << 5: "open_circuit",
            1 << 6: "under_range",
            1 << 7: "over_range",
            1 << 4: "not_ready",
            1 << 14: "module_error",
            1 << 15: "module_error",
        },
    )


_MODBUS = {"icpdas_m7018": _m7018, "wago_750_458": _wago_750_458, "micro800_tc2": _micro800_tc2}


def _canmod_temp(number: int) -> CanChannel:
    """CSS CANmod.temp, standard resolution (1 °C, 5 Hz): connectors TL, TR, BL, BR with their status."""
    place = ("TL", "TR", "BL", "BR")[number]
    return CanChannel(
        message="Thermocouple",
        signal=f"{place}Temp",
        fault_signal=f"{place}Status",
        fault_values={1: "cold_junction", 2: "open_circuit", 3: "out_of_range"},
    )


def _mu_thermocouple1(number: int) -> CanChannel:
    """PEAK MU-Thermocouple1: inputs 1A, 1B, 2A … 4B in 0x100 and 0x101, 1/16 °C every 300 ms, no status."""
    return CanChannel(
        message="Thermocouples1" if number < 4 else "Thermocouples2",
        signal=f"T{number // 2 + 1}{'AB'[number % 2]}",
    )
