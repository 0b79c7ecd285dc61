"""`observer check --wires` names a wrong map, register, scale and byte order by the values that come."""

from __future__ import annotations

import asyncio
import re
import struct
from typing import Any

import pytest

from observer.installation import parse
from observer.service.wire_doubts import wires_of
from tests.drivers.harness import device
from tests.system.bad_inputs import TABLE

REGISTERS = 64
NAMES = ("t1_degC", "t2_degC", "air_degC")


def words(*values: float, scale: float = 0.1) -> list[int]:
    """Registers of 16 bits that hold temperatures."""
    return [round(v / scale) & 0xFFFF for v in values] + [0] * (REGISTERS - len(values))


def floats(*values: float, order: str = "ABCD") -> list[int]:
    """Pairs of registers that hold temperatures, the low word first where the order is CDAB."""
    pairs = [struct.unpack(">2H", struct.pack(">f", v)) for v in values]
    return [word for pair in pairs for word in (pair if order == "ABCD" else pair[::-1])] + [0] * 16


def look(
    registers: list[int], module: dict[str, Any], position: dict[str, Any] | None = None
) -> dict[str, Any]:
    """What `check --wires` finds at a real module with these input registers: the channels by name."""

    async def ask() -> dict[str, Any]:
        async with device(inputs=registers) as peer:
            driver = {"kind": "modbus_tcp", "host": "127.0.0.1", "port": peer.port, "period_s": 0.05} | module
            source = TABLE["source"][0] | {"stroke_m": [0.2, 0.8]}
            table = TABLE | {
                "ambient": {"channel": "air_degC"},
                "source": [{k: v for k, v in source.items() if k not in ("speed_channel", "torque_Nm")}],
                "drivers": {"module": driver},
            }
            return await asyncio.to_thread(wires_of, parse(table))

    found = asyncio.run(ask())
    channels: dict[str, Any] = found["drivers"]["module"]["channels"]
    assert found["good"] == all(one["usable"] for one in channels.values())
    return channels


def by_register(kind: str = "int16", scale: float = 0.1, **more: Any) -> dict[str, Any]:
    """A module by its registers, one after the other."""
    step = 1 if kind.endswith("16") else 2
    return {
        "channels": {
            n: {"register": step * k, "type": kind, "scale": scale} | more for k, n in enumerate(NAMES)
        }
    }


PRESET = {"device": "icpdas_m7018", "channels": {n: k for k, n in enumerate(NAMES)}}


@pytest.mark.parametrize(
    ("registers", "module"),
    [
        (words(31.2, 24.8, 22.1), by_register()),
        (words(21.3, 21.3, 21.3), by_register()),
        (words(21.3, 21.2, 21.3), PRESET),
        (floats(41.02, 24.8, 18.3), by_register("float32", 1.0)),
        (words(8.1, 7.9, 7.2), by_register()),
    ],
    ids=["warm", "cold and equal in whole tenths", "by a ready map", "floats", "a cold hall"],
)
def test_the_temperatures_of_a_machine_are_not_doubted(registers, module):
    assert [one["usable"] for one in look(registers, module).values()] == [True] * 3


@pytest.mark.parametrize(
    ("registers", "module", "doubtful", "said"),
    [
        (words(31.2, 0.0, 22.1), PRESET, {"t2_degC"}, 'connect a thermo.* "icpdas_m7018"'),
        (words(31.2, 24.8, 22.1), PRESET | {"device": "wago_750_458"}, set(NAMES), ""),
        (words(312.0, 248.0, 221.0), by_register(), set(NAMES), "give the channel a tenth of the scale"),
        (words(312.0, 248.0, 221.0), PRESET, set(NAMES), 'than device = "icpdas_m7018" expects'),
        (words(3.12, 2.48, 2.21, scale=0.01), by_register(scale=0.01), set(NAMES), "ten times the scale"),
        (words(295.2, 300.1, 294.0), by_register(), set(NAMES), "or offset = -273.15"),
        (words(88.2, 76.6, 70.5), by_register(), set(NAMES), "scale = 0.5556 and offset = -17.78"),
        (words(31.2, 121.0, 22.1), by_register(), {"t2_degC"}, "correct register, function, type and scale"),
        (words(31.2, 3276.7, 22.1), by_register(), {"t2_degC"}, "connect a thermocouple to this input"),
        (floats(25.0, 25.0, 25.0), by_register("float32", 1.0), set(NAMES), "registers, which must differ"),
        (floats(31.2, 24.8, 22.1, order="CDAB"), by_register("float32", 1.0), set(NAMES), "CDAB"),
        (floats(31.2, 24.8, 22.1), by_register("int16", 1.0), set(NAMES), "register, function"),
    ],
    ids=[
        "an input without a sensor", "another module's map", "ten times", "ten times, by a map", "a tenth",
        "kelvin", "fahrenheit", "far from the air", "open and not named", "equal floats", "words exchanged",
        "floats read as whole numbers",
    ],
)  # fmt: skip
def test_a_wrong_setting_is_named_with_what_to_change(registers, module, doubtful, said):
    channels = look(registers, module)
    assert {name for name, one in channels.items() if not one["usable"]} >= doubtful
    remedies = [one["remedy"] for name, one in channels.items() if name in doubtful]
    assert all(remedies)
    assert any(re.search(said, remedy) for remedy in remedies), remedies


@pytest.mark.parametrize(
    ("raw", "keys", "said"),
    [
        (struct.unpack(">2H", struct.pack(">i", 500_000))[::-1], {"scale": 1e-6}, '"CDAB", which gives 0.5'),
        (struct.unpack(">2H", struct.pack(">i", 100_000)), {"scale": 1e-6}, "must read 0.2 m"),
        (struct.unpack(">2H", struct.pack(">i", 500_000)), {"scale": 1e-6}, None),
    ],
    ids=["words exchanged", "offset wrong", "right"],
)
def test_a_position_outside_the_stroke_is_named_with_what_to_change(raw, keys, said):
    module = by_register()
    module["channels"]["nut_position_m"] = {"register": 10, "type": "int32"} | keys
    registers = words(31.2, 24.8, 22.1)
    registers[10:12] = raw
    found = look(registers, module)["nut_position_m"]
    assert found["usable"] == (said is None)
    assert said is None or said in found["remedy"]


def test_faults_of_most_inputs_make_the_ready_map_itself_doubtful():
    registers = words(*([31.2, 24.8] * 8))
    channels = look(registers, PRESET | {"device": "wago_750_458"})
    assert all(one["fault"] is not None for one in channels.values())
    assert all('or this module is not device = "wago_750_458"' in one["remedy"] for one in channels.values())


def test_one_open_input_does_not_make_the_ready_map_doubtful():
    channels = look([*words(31.2)[:1], 0x7FFF, 221, *([0] * 61)], PRESET)
    assert channels["t2_degC"]["fault"] == "open_circuit"
    assert "this module is not" not in channels["t2_degC"]["remedy"]
