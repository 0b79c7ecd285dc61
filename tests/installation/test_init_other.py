"""`observer init` writes a configuration for a module, a screw and a mounting that are not in its lists."""

from __future__ import annotations

import asyncio
import struct
import tomllib
from typing import Any

import pytest

from observer.errors import UserError
from observer.installation import Installation, parse
from observer.installation.catalogue import SCREWS, screw_of
from observer.installation.first_configuration import answers
from observer.installation.first_template import filled
from observer.service.wire_doubts import wires_of
from tests.drivers.harness import device

GIVEN = {"length_m": "1100 mm", "stroke_m": "150 850 mm", "sensors_m": "300 700 mm", "module_at": "127.0.0.1"}
OTHER = GIVEN | {"module": "other"}
CONTROL = {"control": "modbus", "control_at": "192.168.0.21", "counts_per_m": "1e6"}


def written(**given: str) -> Installation:
    """The configuration that init writes by these options."""
    return parse(tomllib.loads(filled(answers(GIVEN | given, None))))


def refused(**given: str) -> str:
    """Why init refuses these options."""
    with pytest.raises(UserError) as said:
        filled(answers(GIVEN | given, None))
    return str(said.value)


def floats(*values: float) -> list[int]:
    """Pairs of registers, the low word first."""
    return [word for v in values for word in struct.unpack(">2H", struct.pack(">f", v))[::-1]]


def test_a_module_that_is_not_in_the_list_delivers_its_temperatures_and_its_open_input():
    async def ask() -> dict[str, Any]:
        async with device(inputs=[0] * 100 + floats(31.25, -9999.0, 22.5) + [0] * 8) as peer:
            at = f"127.0.0.1:{peer.port}"
            described = {"first_register": "30101", "type": "float32", "word_order": "little"}
            config = written(module="other", **described | {"module_at": at, "fault_code": "-9999"})
            return await asyncio.to_thread(wires_of, config)

    channels = asyncio.run(ask())["drivers"]["thermocouples"]["channels"]
    assert {name: (one["value"], one["fault"]) for name, one in channels.items()} == {
        "t1_degC": (31.25, None),
        "t2_degC": (None, "open_circuit"),
        "ambient_degC": (22.5, None),
    }


@pytest.mark.parametrize(
    ("kind", "code", "raw"),
    [
        ("int16", "32767", 0x7FFF),
        ("int16", "-32768", 0x8000),
        ("int16", "0x8000", 0x8000),
        ("uint16", "65535", 0xFFFF),
        ("int32", "-1", 0xFFFFFFFF),
        ("float32", "0x7FC00000", 0x7FC00000),
        ("float32", "-999,9", 0xC479F99A),
    ],
)
def test_a_code_for_an_open_input_is_written_as_it_comes_on_the_wire(kind, code, raw):
    place = written(module="other", type=kind, fault_code=code).drivers["thermocouples"].channels["t1_degC"]
    assert place.fault_codes == {raw: "open_circuit"}


def test_without_a_code_values_beyond_a_thermocouples_use_are_faults():
    place = written(module="other").drivers["thermocouples"].channels["t1_degC"]
    assert (place.low, place.high) == (-40.0, 200.0)


@pytest.mark.parametrize(
    ("given", "registers"),
    [
        ({}, [0, 1, 2]),
        ({"type": "int32"}, [0, 2, 4]),
        ({"first_register": "7", "step": "2"}, [7, 9, 11]),
        ({"function": "holding", "first_register": "40008"}, [7, 8, 9]),
        ({"function": "3", "first_register": "40001"}, [0, 1, 2]),
    ],
)
def test_the_registers_of_the_inputs_follow_the_first(given, registers):
    channels = written(module="other", **given).drivers["thermocouples"].channels
    assert [place.register_ for place in channels.values()] == registers


def test_a_manuals_number_of_the_other_kind_of_register_is_refused():
    assert "40001 is the manual's number of a register of holding, not of input" in refused(
        module="other", first_register="40001"
    )


def test_a_module_with_too_few_inputs_is_refused():
    assert "3 inputs are needed" in refused(module="other", inputs="2")


def test_a_serial_server_is_asked_for_and_written():
    driver = written(module_at="192.168.0.30:4001", transport="rtu-over-tcp", module_unit="3").drivers
    assert (driver["thermocouples"].transport, driver["thermocouples"].unit_id) == ("rtu-over-tcp", 3)
    assert "--transport: belongs to a module on ethernet" in refused(
        module_at="/dev/ttyUSB0", transport="rtu-over-tcp"
    )


@pytest.mark.parametrize(("typed", "kind"), [("float", "float32"), ("REAL", "float32"), ("Word", "uint16")])
def test_a_type_has_the_name_of_the_manual_or_of_the_controller(typed, kind):
    assert written(module="other", type=typed).drivers["thermocouples"].channels["t1_degC"].type == kind


def test_a_question_offers_its_default_also_where_that_is_zero():
    offered = {}

    def ask(name: str, usual: str | None, trouble: str) -> str:
        offered[name] = usual
        return {"module": "other"}.get(name, str(usual))

    answers(GIVEN, ask)
    assert (offered["first_register"], offered["fault_code"]) == ("0", "")


def test_a_bus_that_no_driver_speaks_leaves_a_configuration_for_logs_that_says_so():
    given = {name: text for name, text in GIVEN.items() if name != "module_at"}
    text = filled(answers(given | {"module": "other", "module_bus": "other", "control": "other"}, None))
    assert "No driver speaks the bus of the module and the control" in text
    assert parse(tomllib.loads(text)).drivers == {}


@pytest.mark.parametrize("name", SCREWS)
def test_a_screw_of_the_list_is_that_of_the_list(name):
    assert screw_of(name) is SCREWS[name]


@pytest.mark.parametrize(
    ("typed", "lead_m", "root_mm"),
    [("40 x 12", 0.012, (34.0, 36.0)), ("16x2,5", 0.0025, (12.5, 15.0)), ("45x15", 0.015, (38.0, 42.0)),
     ("100x20", 0.02, (93.0, 97.0)), ("Ø12 x 4 mm", 0.004, (9.0, 11.0))],
)  # fmt: skip
def test_a_screw_of_any_size_has_its_lead_and_a_root_below_its_diameter(typed, lead_m, root_mm):
    config = written(screw=typed, housings="all", **CONTROL)
    assert config.source[0].lead_m == pytest.approx(lead_m)
    assert root_mm[0] < 1000 * config.screw.diameter_m < root_mm[1]
    assert "scaled from the nearest size" in filled(answers(GIVEN | {"screw": typed}, None))


@pytest.mark.parametrize("name", SCREWS)
def test_a_size_scaled_from_its_neighbours_is_near_what_the_list_has(name, monkeypatch):
    listed = SCREWS[name]
    monkeypatch.delitem(SCREWS, name)
    scaled = screw_of(name)
    assert 0.85 < scaled.root_mm / listed.root_mm < 1.15
    assert 0.4 < scaled.torque_Nm / listed.torque_Nm < 2.5
    assert 0.4 < scaled.nut_kg / listed.nut_kg < 2.5
    assert 0.4 < scaled.housing_kg / listed.housing_kg < 2.5


def test_the_mounting_is_written_with_its_fixed_end():
    supports = written(mounting="fixed-supported", fixed_end="lower").supports
    assert (supports.mounting, supports.first) == ("L-II", "right")
    assert written(mounting="fixed-fixed").supports.mounting == "L-III"
    assert written().supports is None


def test_upper_and_lower_count_as_left_and_right():
    assert [node.name for node in written(housings="upper, lower").node] == ["left_housing", "right_housing"]


@pytest.mark.parametrize(
    ("shown", "counts", "offset_m"),
    [
        ("0 700 mm", "1e6", 0.15),
        ("0 -700 mm", "-1e6", 0.15),
        ("-350 350 mm", "1e6", 0.5),
        ("700 0 mm", "-1e6", 0.85),
    ],
)
def test_what_the_control_shows_at_the_ends_makes_the_nuts_middle_right(shown, counts, offset_m):
    config = written(**CONTROL | {"counts_per_m": counts, "shown_at_ends_m": shown})
    place = config.drivers["axis"].channels["nut_position_m"]
    assert place.offset == pytest.approx(offset_m)
    left_m, right_m = (float(part) / 1000.0 for part in shown.removesuffix(" mm").split())
    numbers = [metres * abs(float(counts)) for metres in (left_m, right_m)]
    assert [place.value(number) for number in numbers] == pytest.approx([0.15, 0.85])


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        ("0 500 mm", "shows 500 mm from end to end, and the stroke is 700 mm"),
        ("0 -700 mm", "counts towards the left bearing, and counts_per_m = 1e+06 says otherwise"),
        ("0 700", "give both readings with their unit"),
        ("7 7 mm", "both readings are the same"),
    ],
)
def test_readings_that_cannot_be_those_of_the_ends_are_refused(shown, words):
    assert words in refused(**CONTROL | {"shown_at_ends_m": shown})


def test_a_server_that_counts_the_other_way_has_a_negative_scale():
    given = {"control": "opcua", "control_at": "opc.tcp://h:4840", "position_signal": "ns=2;s=X"}
    place = written(**given, shown_at_ends_m="0 -700 mm").drivers["axis"].channels["nut_position_m"]
    assert [place.value(mm) for mm in (0.0, -700.0)] == pytest.approx([0.15, 0.85])
