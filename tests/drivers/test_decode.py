import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.decode import (
    MAX_REGISTERS,
    RegisterBlock,
    bytes_of,
    decode,
    order_hint,
    raw_of,
    read_plan,
    spans,
)
from drivers.places import WORDS, ModbusChannel, modbus_input

LIMITS = {
    "int16": (-(2**15), 2**15 - 1),
    "uint16": (0, 2**16 - 1),
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
    "int64": (-(2**63), 2**63 - 1),
    "uint64": (0, 2**64 - 1),
}
ORDERS = st.sampled_from(["ABCD", "CDAB", "BADC", "DCBA"])
BYTES = {
    "int16": ">h", "uint16": ">H", "int32": ">i", "uint32": ">I", "float32": ">f",
    "int64": ">q", "uint64": ">Q", "float64": ">d",
}  # fmt: skip


def words_of(number, kind, order):
    """The registers in which a device shows a number."""
    data = struct.pack(BYTES[kind], number)
    pairs = [data[i : i + 2] for i in range(0, len(data), 2)]
    pairs = pairs[::-1] if order in ("CDAB", "DCBA") else pairs
    return [int.from_bytes(p[::-1] if order in ("BADC", "DCBA") else p, "big") for p in pairs]


NUMBERS = {kind: st.integers(*limits) for kind, limits in LIMITS.items()} | {
    "float32": st.floats(width=32, allow_nan=False),
    "float64": st.floats(allow_nan=False),
}


@given(st.sampled_from(sorted(NUMBERS)), ORDERS, st.data())
def test_a_number_of_any_type_survives_the_registers_in_any_order(kind, order, data):
    number = data.draw(NUMBERS[kind])
    words = words_of(number, kind, order)
    assert len(words) == WORDS[kind]
    assert raw_of(bytes_of(words, order), kind) == number


@pytest.mark.parametrize("order", ["CDAB", "BADC", "DCBA"])
@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_a_temperature_read_in_a_wrong_byte_order_is_a_fault_or_implausible_and_the_right_order_is_named(
    order, kind
):
    for number in (21.5, 21.4, 0.1, -3.25, 85.0):
        registers = dict(enumerate(words_of(number, kind, order)))
        value, fault = decode(registers, ModbusChannel(register=0, type=kind), True)
        assert fault == "tiny_number" or not -100.0 < value < 150.0, (number, value)
        hint = order_hint(registers, ModbusChannel(register=0, type=kind), True)
        assert hint is not None
        assert f"{order} would give {number:g}" in hint
        right = ModbusChannel(register=0, type=kind, byte_order=order)
        assert decode(registers, right, True) == (pytest.approx(number, rel=1e-6), None)
        assert order_hint(registers, right, True) is None


def test_zero_is_a_value_and_a_denormal_number_is_none():
    channel = ModbusChannel(register=0, type="float32")
    assert decode({0: 0, 1: 0}, channel, True) == (0.0, None)
    assert decode({0: 0, 1: 0x41AC}, channel)[1] == "tiny_number"
    assert decode({0: 0xAC41, 1: 0}, channel)[1] is None, "a position may be as small as rounding"


def test_word_order_is_another_name_of_a_byte_order():
    orders = [ModbusChannel(register=0, type="int32", word_order=word).order for word in ("little", "big")]
    assert orders == ["CDAB", "ABCD"]


def test_the_byte_order_is_that_of_the_wire():
    assert raw_of(bytes_of([0x0001, 0x0002]), "uint32") == 0x00010002
    assert raw_of(bytes_of([0xFFFF]), "int16") == -1
    assert raw_of(bytes_of([0x3F80, 0x0000]), "float32") == 1.0


@given(st.floats(-200, 1300), st.sampled_from([0.1, 0.01, 0.0625, -0.5]), st.floats(-300, 300), ORDERS)
def test_a_value_comes_back_to_half_a_step(value, scale, offset, order):
    channel = ModbusChannel(register=7, type="int32", byte_order=order, scale=scale, offset=offset)
    words = words_of(round((value - offset) / scale), "int32", order)
    decoded, fault = decode({7: words[0], 8: words[1]}, channel)
    assert fault is None
    # rounding to the register's step, and the float arithmetic of the scaling itself
    assert abs(decoded - value) <= abs(scale) / 2 + 1e-9


# What each module shows for a reading and for its faults, as its manual writes it (field by field in hex).
SHOWN = [
    ("icpdas_m7018", {0: 0x00FA}, 25.0, None),
    ("icpdas_m7018", {0: 0xFF9C}, -10.0, None),
    ("icpdas_m7018", {0: 0x7FFF}, None, "open_circuit"),
    ("wago_750_458", {0: 0x00, 1: 0x03E8}, 100.0, None),
    ("wago_750_458", {0: 0x00, 1: 0xF830}, -200.0, None),
    ("wago_750_458", {0: 0x41, 1: 0xF830}, None, "under_range"),
    ("wago_750_458", {0: 0x42, 1: 0x32C8}, None, "over_range"),
    ("wago_750_458", {0: 0x60, 1: 0x7FFF}, None, "open_circuit"),
    ("wago_750_458", {0: 0x00, 1: 0x7FFF}, None, "open_circuit"),
    ("wago_750_458", {0: 0x00, 1: 0x8000}, None, "cold_junction"),
    ("wago_750_458", {0: 0x80, 1: 0x03E8}, None, "register_communication"),
    ("micro800_tc2", {0: 8000, 2: 0x0008}, 530.0, None),
    ("micro800_tc2", {0: 1234, 2: 0x0000}, -146.6, None),
    ("micro800_tc2", {0: 8000, 2: 0x0020}, None, "open_circuit"),
    ("micro800_tc2", {0: 600, 2: 0x0040}, None, "under_range"),
    ("micro800_tc2", {0: 16400, 2: 0x0080}, None, "over_range"),
]


@pytest.mark.parametrize(("device", "registers", "value", "fault"), SHOWN)
def test_modules_are_read_as_their_manuals_say(device, registers, value, fault):
    decoded = decode(registers, modbus_input(device, 0))
    if fault is None:
        assert decoded == (pytest.approx(value, abs=1e-9), None)
    else:
        assert math.isnan(decoded[0])
        assert decoded[1] == fault


def test_a_ready_map_can_begin_anywhere():
    moved = modbus_input("wago_750_458", 1, first_register=100)
    assert (moved.status_register, moved.register_) == (102, 103)


@pytest.mark.parametrize(
    ("channel", "registers", "fault"),
    [
        (ModbusChannel(register=0, type="float32"), {0: 0x7FC0, 1: 0}, "not_a_number"),
        (ModbusChannel(register=0, type="float32"), {0: 0x7F80, 1: 0}, "not_a_number"),
        (ModbusChannel(register=0, low=0, high=100), {0: 101}, "out_of_range"),
        (ModbusChannel(register=0, low=0, high=100), {0: 0xFFFF}, "out_of_range"),
        (ModbusChannel(register=0, low=0, high=100), {0: 100}, None),
        (ModbusChannel(register=0, type="uint32", word_order="little", fault_codes={0xFFFF0001: "gone"}),
         {0: 1, 1: 0xFFFF}, "gone"),
    ],
)  # fmt: skip
def test_values_that_cannot_be_used_have_a_reason(channel, registers, fault):
    value, found = decode(registers, channel)
    assert found == fault
    assert math.isnan(value) == (fault is not None)


CHANNELS = st.builds(
    lambda register, function, kind, status: ModbusChannel(
        register=register,
        function=function,
        type=kind,
        status_register=status,
        status_faults={1: "bad"} if status is not None else {},
    ),
    st.integers(0, 400),
    st.sampled_from(["holding", "input"]),
    st.sampled_from(sorted(WORDS)),
    st.none() | st.integers(0, 400),
)


@given(st.lists(CHANNELS, min_size=1, max_size=40))
def test_a_plan_reads_only_the_needed_registers(channels):
    plan = read_plan(channels)
    needed = {(s.function, s.first + i) for c in channels for s in spans(c) for i in range(s.count)}
    read = [(b.function, b.first + i) for b in plan for i in range(b.count)]
    assert set(read) == needed
    assert all(block.count <= MAX_REGISTERS for block in plan)
    for channel in channels:  # no value is torn apart
        for span in spans(channel):
            assert any(
                b.function == span.function
                and b.first <= span.first
                and span.first + span.count <= b.first + b.count
                for b in plan
            )


def test_neighbours_are_read_together():
    module = [modbus_input("wago_750_458", number) for number in range(8)]
    assert read_plan(module) == (RegisterBlock("input", 0, 16),)
