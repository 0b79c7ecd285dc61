"""Whatever a wire carries, every channel has a finite value or a fault, and nothing is raised."""

from __future__ import annotations

import math
from pathlib import Path

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.can import CanSettings
from drivers.canopen import CanopenSettings, sdo_decoder, tpdo_decoder
from drivers.dbc import load_decoder
from drivers.decode import decode, read_plan, spans
from drivers.places import CAN_INPUTS, DBC_OF, MODBUS_INPUTS, WORDS, ModbusChannel, modbus_input

MUX_DBC = """VERSION ""

BU_: A

BO_ 256 Mux: 8 A
 SG_ Which M : 0|8@1+ (1,0) [0|0] "" A
 SG_ One m0 : 8|16@1- (0.1,0) [-100|100] "" A
 SG_ Two m1 : 8|32@1- (1,0) [0|0] "" A

BO_ 2566834686 Wide: 64 A
 SG_ Big : 0|64@1+ (1e300,1e300) [0|0] "" A

SIG_VALTYPE_ 256 Two : 1 ;
"""
"""A message with branches, one of them a float, and a factor that no number holds."""

words = st.integers(0, 0xFFFF)
scales = st.floats(-1e9, 1e9).filter(lambda x: abs(x) > 1e-12)


@st.composite
def modbus_channels(draw):
    if draw(st.booleans()):
        device = draw(st.sampled_from(["icpdas_m7018", "wago_750_458", "micro800_tc2"]))
        number = draw(st.integers(0, MODBUS_INPUTS[device] - 1))
        return modbus_input(device, number, draw(st.integers(0, 0xFFF0)))
    status = draw(st.none() | st.integers(0, 0xFFFF))
    low, high = sorted(draw(st.tuples(st.integers(-9999, 9999), st.integers(-9999, 9999))))
    return ModbusChannel(
        register=draw(st.integers(0, 0xFFFC)),
        type=draw(st.sampled_from(sorted(WORDS))),
        byte_order=draw(st.sampled_from(["ABCD", "CDAB", "BADC", "DCBA"])),
        scale=draw(scales),
        offset=draw(st.floats(-1e12, 1e12)),
        low=low if low < high else None,
        high=high if low < high else None,
        fault_codes=draw(st.dictionaries(st.integers(0, 0xFFFF_FFFF), st.just("bad"), max_size=3)),
        status_register=status,
        status_faults={} if status is None else {draw(st.integers(1, 0xFFFF)): "bad"},
    )


@settings(max_examples=500)
@given(modbus_channels(), st.data())
def test_registers_decode_to_a_value_or_a_fault(channel, data):
    content = {
        register: data.draw(words)
        for block in spans(channel)
        for register in range(block.first, block.first + block.count)
    }
    value, fault = decode(content, channel)
    assert math.isfinite(value) != (fault is not None)
    assert sum(block.count for block in read_plan([channel])) <= 5


def frame_of(identifiers, data):
    return st.builds(
        can.Message,
        arbitration_id=identifiers,
        is_extended_id=st.booleans(),
        is_remote_frame=st.just(False),
        is_error_frame=st.booleans(),
        is_fd=st.booleans(),
        data=data,
    )


frames = frame_of(st.integers(0, 0x7FF), st.binary(max_size=64)) | frame_of(
    st.sampled_from([0x100, 0x101, 0x102, 0x18FEF27E, 0x18FEC9FE, 0x185, 0x585]),
    st.binary(max_size=64) | st.binary(min_size=8, max_size=8) | st.binary(min_size=64, max_size=64),
)


BUS = {"interface": "virtual", "channel": "x"}


@pytest.fixture(scope="module")
def decoders(tmp_path_factory):
    """Decoders of CAN files and of drives."""
    path: Path = tmp_path_factory.mktemp("dbc") / "mux.dbc"
    path.write_text(MUX_DBC)
    mux = {
        "one": {"message": "Mux", "signal": "One", "fault_signal": "Which", "fault_values": {1: "bad"}},
        "two": {"message": "Mux", "signal": "Two", "fault_signal": "Two", "scale": 1e9},
        "big": {"message": "Wide", "signal": "Big", "scale": 1e9},
    }
    tables = [{"dbc": path, "channels": mux}]
    tables += [{"device": d, "channels": {f"t{i}": i for i in range(CAN_INPUTS[d])}} for d in DBC_OF]
    of_files = [CanSettings.model_validate(BUS | {"kind": "can"} | t).signals("hostile") for t in tables]
    drives = [
        (decoder, BUS | {"kind": "canopen", "node_id": 5, "mode": mode, "position_byte": byte} | scale)
        for decoder, mode in ((tpdo_decoder, "tpdo"), (sdo_decoder, "sdo"))
        for byte in range(5)
        for scale in ({"counts_per_m": 1.0}, {"counts_per_m": -1e12})
    ]
    made = [decoder(CanopenSettings.model_validate(table)) for decoder, table in drives]
    return [load_decoder(signals) for signals in of_files] + made


@settings(max_examples=500)
@given(frame=frames)
def test_a_frame_decodes_to_finite_values_or_faults(decoders, frame):
    for decoder in decoders:
        values, faults = decoder(frame) or ({}, {})
        assert set(faults) <= set(values)
        for name, value in values.items():
            assert math.isfinite(value) != (name in faults), (name, value, faults)
