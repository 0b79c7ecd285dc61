"""Messages hold what a step returns: decode after encode is the identity, and NaN never reaches JSON."""

import json
import math
import tomllib
from dataclasses import replace
from pathlib import Path

import cbor2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from observer import installation
from observer.bus.codec import (
    EstimateEncoder,
    array_of,
    config_json,
    decode,
    decode_estimate,
    to_json,
)
from observer.frames import FORCE, PARTS, EstimateBlock, EstimateQuality, Layout, Quality
from tests.bus.blocks import LAYOUT, block

DEMO = Path(__file__).parents[2] / "config" / "demo.toml"
_names = st.lists(st.text("abcxyz_1", min_size=1, max_size=8), max_size=4, unique=True)


@st.composite
def _estimates(draw):
    """A layout and a block of one to three estimates; every float32 there is, infinities and NaN included."""
    sources, sensors = draw(_names), draw(_names)
    k, g, has_error = draw(st.integers(1, 3)), draw(st.integers(0, 5)), draw(st.booleans())

    def numbers(*shape):
        return draw(hnp.arrays(np.float64, shape, elements=st.floats(width=32)))

    e, f = g if has_error else 0, int(has_error and draw(st.booleans()))
    layout = Layout(tuple(sources), numbers(g), tuple(sensors), has_error, has_force=bool(f))
    return layout, EstimateBlock(
        draw(hnp.arrays(np.float64, k, elements=st.floats(-1e12, 1e12))),
        numbers(k, len(sources)), numbers(k, len(sources)), numbers(k, g), numbers(k, g), numbers(k, e),
        numbers(k, e), numbers(k, len(sensors)),
        draw(hnp.arrays(np.int8, (k, len(sensors)), elements=st.integers(0, 3))),
        draw(hnp.arrays(np.int8, k, elements=st.integers(0, 4))),
        numbers(k, len(sensors)), numbers(k, len(sources)), heat_bound_W=numbers(k, len(sources)),
        field_bound_K=numbers(k, g), error_bound_um=numbers(k, e),
        part_quality=draw(hnp.arrays(np.int8, (k, len(PARTS)), elements=st.integers(0, 4))),
        force_N=numbers(k, f), force_sigma_N=numbers(k, f), force_bound_N=numbers(k, f),
    )  # fmt: skip


HEATS = ("heat_W", "heat_sigma_W", "heat_bound_W", "law_W")
ALONG = ("field_degC", "field_sigma_K", "field_bound_K", "error_um", "error_sigma_um", "error_bound_um")


def _as_a_map(layout: Layout, block: EstimateBlock, k: int, sequence: int) -> dict:
    """What a message holds, in the order that subscribers have always seen."""
    parts = zip(PARTS, block.part_quality[k], strict=True)
    after = ("innovation_K", "innovation_sigma_K", *(FORCE if layout.has_force else ()))
    return {
        "time_s": float(block.time_s[k]),
        "sequence": sequence,
        "sensors_used": int(block.sensors_used[k]),
        "instance": "ab12cd34",
        "quality": EstimateQuality(block.quality[k]).label,
        **{f"{part}_quality": EstimateQuality(quality).label for part, quality in parts},
        "sources": list(layout.sources),
        **{name: getattr(block, name)[k] for name in HEATS},
        "position_m": layout.position_m,
        **{name: getattr(block, name)[k] for name in ALONG},
        "sensors": list(layout.sensors),
        **{name: getattr(block, name)[k] for name in after},
        "sensor_quality": [Quality(q).label for q in block.sensor_quality[k]],
    }


def _typed(value):
    """An array as RFC 8746 has it: float32, little-endian."""
    return cbor2.CBORTag(85, value.astype("<f4").tobytes()) if isinstance(value, np.ndarray) else value


@given(_estimates(), st.integers(0, 2**53))
def test_an_estimate_is_to_the_byte_the_map_that_a_library_writes_and_decodes_to_it(drawn, sequence):
    layout, estimates = drawn
    encoder = EstimateEncoder(layout, "ab12cd34")
    for k in range(len(estimates)):
        meant, data = _as_a_map(layout, estimates, k, sequence), encoder.cbor(estimates, k, sequence)
        assert data == cbor2.dumps({name: _typed(value) for name, value in meant.items()})
        decoded = decode_estimate(data)
        assert list(decoded) == list(meant)
        for name, value in meant.items():
            np.testing.assert_array_equal(decoded[name], value, err_msg=name)


@given(_estimates())
def test_json_is_strict_and_null_where_unknown(made):
    layout, estimates = made
    encoder = EstimateEncoder(layout, "ab12cd34")

    def refuse(constant):
        raise AssertionError(constant)

    for encode in (encoder.heat, encoder.field, encoder.error):
        json.loads(encode(estimates, 0, 0), parse_constant=refuse)
    heat = json.loads(encoder.heat(estimates, 0, 0))
    for name, value in zip(layout.sources, estimates.heat_W[0], strict=True):
        assert (heat["sources"][name]["heat_W"] is None) == (not math.isfinite(value))


def test_heat_field_and_error_carry_each_its_own_quality():
    encoder = EstimateEncoder(LAYOUT, "ab12cd34")
    one = replace(block(), part_quality=np.array([[1, 2, 0]], np.int8))
    documents = (encoder.heat, encoder.field, encoder.error)
    assert [json.loads(of(one, 0, 3))["quality"] for of in documents] == ["starting", "degraded", "good"]
    estimate = decode_estimate(encoder.cbor(one, 0, 3))
    assert [estimate[f"{part}_quality"] for part in PARTS] == ["starting", "degraded", "good"]


def test_heat_field_and_error_are_the_documents_of_the_contract():
    encoder, one = EstimateEncoder(LAYOUT, "ab12cd34"), block(quality=2)
    heat, field, error = (json.loads(e(one, 0, 3)) for e in (encoder.heat, encoder.field, encoder.error))
    assert list(heat) == ["time_s", "sequence", "instance", "sensors_used", "sensors", "sources", "quality"]
    assert list(heat["sources"]) == ["nut", "left_bearing"]
    assert list(heat["sources"]["nut"]) == ["heat_W", "sigma_W", "bound_W"]
    head = ["time_s", "sequence", "instance", "sensors_used", "sensors", "position_m"]
    assert list(field) == [*head, "temperature_degC", "sigma_K", "bound_K", "quality"]
    assert list(error) == [*head, "error_um", "sigma_um", "bound_um", "quality"]
    assert (heat["time_s"], heat["sequence"], heat["quality"]) == (1.8e9, 3, "degraded")
    # six decimals are kept, of every quantity its own
    for shown, meant in (
        ([source["heat_W"] for source in heat["sources"].values()], one.heat_W),
        ([source["sigma_W"] for source in heat["sources"].values()], one.heat_sigma_W),
        ([source["bound_W"] for source in heat["sources"].values()], one.heat_bound_W),
        (field["position_m"], LAYOUT.position_m),
        (field["temperature_degC"], one.field_degC),
        (field["sigma_K"], one.field_sigma_K),
        (field["bound_K"], one.field_bound_K),
        (error["position_m"], LAYOUT.position_m),
        (error["error_um"], one.error_um),
        (error["sigma_um"], one.error_sigma_um),
        (error["bound_um"], one.error_bound_um),
    ):
        np.testing.assert_array_equal(shown, np.round(np.ravel(meant), 6))
        assert not np.array_equal(shown, np.round(np.ravel(meant), 5))


@pytest.mark.parametrize("count", [0, 1, 23, 24, 300])
def test_several_estimates_are_one_array(count):
    messages = [EstimateEncoder(LAYOUT, "ab12cd34").cbor(block(float(i)), 0, i) for i in range(count)]
    assert [m["sequence"] for m in decode(array_of(messages))] == list(range(count))


ONE = EstimateEncoder(LAYOUT, "ab12cd34").cbor(block(), 0, 0)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "cannot be decoded"),
        (ONE[:-1], "cannot be decoded"),
        (ONE + b"\0", "1 bytes follow"),
        (cbor2.dumps([1]), "not an estimate"),
        (cbor2.dumps({"time_s": 1}), "not an estimate"),
        (cbor2.dumps({"sequence": 0}), "not an estimate"),
        (cbor2.dumps("time_s sequence"), "not an estimate"),
        (cbor2.dumps({"time_s": 1, "sequence": 0, "x": cbor2.CBORTag(85, "1234")}), "float32"),
        (cbor2.dumps({"time_s": 1, "sequence": 0, "x": cbor2.CBORTag(85, b"123")}), "float32"),
        (cbor2.dumps({"time_s": 1, "sequence": 0, "x": cbor2.CBORTag(81, b"1234")}), "float32"),
    ],
)
def test_bytes_that_are_no_estimate_are_rejected(data, words):
    with pytest.raises(ValueError, match=words):
        decode_estimate(data)


def test_the_configuration_is_published_without_credentials():
    table = tomllib.loads(DEMO.read_text())
    table["publish"] = {
        "listen": ["tls/127.0.0.1:7447"],
        "login": {"users_file": "users.txt"},
        "tls": {"ca": "ca.pem", "certificate": "own.pem", "key": "own.key"},
        "access": {"viewer": ["user:ann"]},
    }
    channel = {"register": 7, "type": "int16", "scale": 0.1}
    table["drivers"]["amp"] = {"kind": "modbus_tcp", "host": "amp", "channels": {"spindle_degC": channel}}
    config = installation.parse(table, "here")
    document = json.loads(config_json(config, "ab12cd34"))
    assert (document["hash"], document["instance"]) == (config.digest, "ab12cd34")
    assert {"listen", "connect"} <= document["config"]["publish"].keys()
    assert not {"login", "tls", "access"} & document["config"]["publish"].keys()
    # with its keys as a file has them
    channel = document["config"]["drivers"]["amp"]["channels"]["spindle_degC"]
    assert channel["register"] == 7
    assert "register_" not in channel


@given(st.binary(max_size=60))
def test_any_bytes_are_an_estimate_or_are_rejected(data):
    try:
        decode_estimate(data)
    except ValueError:
        return


def test_nan_in_a_document_is_rejected():
    with pytest.raises(ValueError, match="JSON"):
        to_json({"x": math.nan})


def test_a_layout_without_expansion_has_no_error():
    layout = replace(LAYOUT, has_error=False)
    message = decode_estimate(EstimateEncoder(layout, "ab12cd34").cbor(block(layout=layout), 0, 0))
    assert len(message["error_um"]) == len(message["error_bound_um"]) == 0


def test_of_a_block_that_is_made_without_bounds_none_is_known():
    one, encoder = block(), EstimateEncoder(LAYOUT, "ab12cd34")
    columns = {name: getattr(one, name) for name in EstimateBlock.__dataclass_fields__ if "bound" not in name}
    bare = EstimateBlock(**columns)
    message = decode_estimate(encoder.cbor(bare, 0, 7))
    for name, like in (
        ("heat_bound_W", "heat_W"),
        ("field_bound_K", "field_degC"),
        ("error_bound_um", "error_um"),
    ):
        assert message[name].shape == message[like].shape
        assert np.isnan(message[name]).all()
    heat, field, error = (json.loads(e(bare, 0, 7)) for e in (encoder.heat, encoder.field, encoder.error))
    assert [source["bound_W"] for source in heat["sources"].values()] == [None] * 2
    assert field["bound_K"] == error["bound_um"] == [None] * 3
