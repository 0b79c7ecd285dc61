"""The live table shows what there is, and shows what is old or bad as such."""

import io
import json
from functools import partial

import cbor2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from observer.bus import watch
from observer.bus.codec import EstimateEncoder, decode_estimate
from observer.bus.watch import SHOWN, Subscription, health_table, live_line, live_table, message_of
from tests.bus.blocks import LAYOUT, block


def _latest(**changes):
    one, encoder = block(**changes), EstimateEncoder(LAYOUT, "ab12cd34")
    return {
        "estimate": decode_estimate(encoder.cbor(one, 0, 1)),
        "heat": json.loads(encoder.heat(one, 0, 1)),
        "field": json.loads(encoder.field(one, 0, 1)),
        "error": json.loads(encoder.error(one, 0, 1)),
        "learned": json.loads(encoder.learned(one, 0, 1)),
    }


def _shown(latest, table=live_table) -> str:
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(table(latest))
    return console.export_text()


def test_the_live_table_shows_heats_field_error_sensors_and_reasons():
    latest = _latest(quality=2)
    latest["heat"]["sources"]["nut"] = {"heat_W": 61.234, "sigma_W": 2.0}
    latest["truth/heat"] = {"sources": {"nut": {"heat_W": 59.234, "sigma_W": 0}}}
    latest["learned"]["parameters"] = {"sensor.t1.offset_K": {"value": 0.314, "sigma": 0.1}}
    latest["health"] = {"state": "degraded", "reasons": ["channel t2_degC is stale"]}
    text = _shown(latest)
    for words in ("estimates: degraded", "61.23", "2.00", "59.23", "1.0", "left_bearing", "field", "°C",
                  "error", "µm", "t2", "learnt: sensor.t1.offset_K 0.314 ± 0.1",
                  "channel t2_degC is stale", "service: degraded"):  # fmt: skip
        assert words in text


def test_the_live_table_names_the_heats_whose_usual_value_is_not_known_yet():
    bands = {"nut": {"known": False, "learning": "2.5 of 30 h of running"}, "bearing": {"learning": None}}
    text = _shown(_latest() | {"alarms": {"alarms": [], "bands": bands}})
    assert "usual heats, still being learnt: nut 2.5 of 30 h of running\n" in text.replace(" \n", "\n")
    assert "still being learnt" not in _shown(_latest() | {"alarms": {"bands": {"nut": {"learning": None}}}})


def test_a_health_report_is_shown_with_state_reasons_channels_and_drivers():
    channels = {"t1_degC": {"quality": "good", "age_s": 0.25, "fault": None},
                "[t2]": {"quality": "missing", "age_s": None, "fault": "open_circuit"}}  # fmt: skip
    drivers = {"amp": {"connected": False, "samples": 40, "drops": 1, "errors": 7, "reconnects": 2}}
    alarms = {"alarms": [{"severity": "major", "reason": "it wears", "remedy": "grease it"}]}
    text = _shown(
        {"time_s": 1000.0, "state": "starting", "quality": "invalid",
         "reasons": ["driver amp is not connected: refused"],
         "channels": channels, "drivers": drivers, "recording": "/var/lib/r.csv"},
        partial(health_table, alarms=alarms, axis="lathe-7/z", now_s=1012.0),
    )  # fmt: skip
    for words in ("lathe-7/z", "▲ major", "it wears", "to do: grease it", "12 s ago", "service: starting",
                  "estimates: invalid", "• driver amp is not connected: refused", "0.2",
                  "t1_degC", "[t2]", "missing", "open_circuit", "no", "40", "/var/lib/r.csv"):  # fmt: skip
        assert words in text


@pytest.mark.parametrize("value", [None, 7, "x", [1], {"a": 1}, {"a": {"quality": 5, "age_s": "old"}}, 1e400])
def test_whatever_a_health_report_holds_it_is_shown(value):
    keys = ("state", "quality", "reasons", "channels", "drivers", "recording")
    shown = _shown(
        dict.fromkeys(keys, value), partial(health_table, alarms={"alarms": value}, axis="a/b", now_s=0.0)
    )
    assert "service" in shown


def test_without_truth_the_live_table_has_no_such_column():
    assert "truth" not in _shown(_latest())


def test_the_live_table_shows_an_empty_document_and_unknown_values():
    assert "starting" in _shown({})
    latest = _latest()
    latest["field"]["temperature_degC"] = [None, None, None]
    latest["estimate"]["innovation_K"] = np.array([np.nan, 0.5], np.float32)
    latest["heat"]["sources"]["nut"] = {"heat_W": None, "sigma_W": None}
    latest["truth/heat"] = {"sources": {"nut": {"heat_W": 1.0}}}
    assert "–" in _shown(latest)


class _Sample:
    def __init__(self, data: bytes) -> None:
        self.payload = self
        self.data = data

    def to_bytes(self) -> bytes:
        return self.data


class _Channel:
    def __init__(self) -> None:
        self.waiting: list[bytes] = []

    def try_recv(self):
        return _Sample(self.waiting.pop()) if self.waiting else None


def test_a_message_that_is_not_renewed_is_stale(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr(watch.time, "monotonic", lambda: now_s[0])
    subscription, channel = Subscription((), "m", "x"), _Channel()
    subscription._channels = {"heat": channel}
    channel.waiting = [b'{"quality":"good"}']
    assert subscription.latest()["heat"]["quality"] == "good"
    now_s[0] += 2.9
    assert subscription.latest()["heat"]["quality"] == "good"
    now_s[0] += 0.2
    assert subscription.latest()["heat"]["quality"] == "stale"
    channel.waiting = [b'{"quality":"good"}']
    assert subscription.latest()["heat"]["quality"] == "good"
    now_s[0] += 9.0  # three times the gap before
    assert subscription.latest()["heat"]["quality"] == "good"
    channel.waiting = [b"{"]
    assert subscription.latest() == {}


_leaf = st.none() | st.booleans() | st.integers() | st.just(10**400) | st.floats() | st.text(max_size=20)
_words = st.sampled_from(
    ["heat_W", "sigma_W", "sources", "nut", "quality", "state", "reasons", "temperature_degC", "sigma_K",
     "error_um", "sigma_um", "sensors", "sensor_quality", "innovation_K", "parameters",
     "value", "sigma", "[/red]", "\x1b[2J"]
)  # fmt: skip
_anything = st.recursive(
    _leaf,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(_words, inner, max_size=6),
    max_leaves=12,
)
_documents = st.dictionaries(
    st.sampled_from(SHOWN), st.dictionaries(_words, _anything, max_size=8), max_size=4
)


@given(_documents)
def test_any_document_can_be_shown_and_does_nothing_to_the_terminal(latest):
    text = _shown(latest) + live_line(latest)
    assert all(c.isprintable() or c == "\n" for c in text)


@given(st.sampled_from(SHOWN), st.binary(max_size=300) | _anything.map(lambda v: json.dumps(v).encode()))
def test_any_bytes_are_a_message_or_none(key, data):
    message = message_of(key, data)
    assert message is None or isinstance(message, dict)
    assert _shown({key: message} if message else {})


@pytest.mark.parametrize(
    "data",
    [
        b"[" * 200_000,
        b"9" * 5000,
        b'{"sources":' * 5000,
        b"\x9b" + b"\xff" * 8,
        b"\x81" * 100_000,
        b"null",
        b"[]",
    ],
    ids=lambda data: repr(data[:12]),
)
def test_bytes_that_are_meant_to_hurt_are_no_message(data):
    assert message_of("heat", data) is None
    assert message_of("estimate", data) is None


def test_a_name_does_nothing_to_the_terminal():
    name = "\x1b[2Jgood[/red]\x07"
    heat = {"quality": name, "sources": {name: {"heat_W": 1.0, "sigma_W": 1.0}}}
    latest = {"heat": heat, "health": {"state": name, "reasons": [name]}}
    for text in (_shown(latest), live_line(latest)):
        assert "[2Jgood[/red]" in text
        assert "\x1b" not in text
        assert "\x07" not in text


def test_a_hostile_estimate_is_shown_as_unknown():
    data = cbor2.dumps(
        {"time_s": 1, "sequence": 2, "sensors": [5, None, "a" * 10_000], "sensor_quality": [[], {}, 1],
         "innovation_K": cbor2.CBORTag(85, b"")}
    )  # fmt: skip
    assert _shown({"estimate": message_of("estimate", data)})


@pytest.mark.parametrize(("kind", "is_off"), [("released", True), ("not_zeroed", True), ("excluded", False)])
def test_a_compensation_that_is_off_stands_beside_estimates_that_are_good(kind, is_off):
    health = {"state": "good", "quality": "good", "time_s": 1.0, "conditions": [{"kind": kind}]}
    for shown in (
        _shown(_latest() | {"health": health}),
        _shown(health, partial(health_table, alarms={}, axis="a/z", now_s=2.0)),
    ):
        assert "estimates: good" in shown
        assert ("compensation: off" in shown) == is_off


def test_the_table_of_sensors_says_residual_as_the_page_does():
    assert "residual, K" in _shown(_latest())
