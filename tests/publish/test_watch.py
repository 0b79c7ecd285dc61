"""The live table shows what there is, and shows what is old or bad as such."""

import io
import json

import numpy as np
from rich.console import Console

from observer.publish import watch
from observer.publish.codec import EstimateEncoder, decode_estimate
from observer.publish.watch import Subscription, live_table
from tests.publish.blocks import LAYOUT, block


def _latest(**changes):
    one, encoder = block(**changes), EstimateEncoder(LAYOUT)
    return {
        "estimate": decode_estimate(encoder.cbor(one, 0, 1)),
        "heat": json.loads(encoder.heat(one, 0, 1)),
        "field": json.loads(encoder.field(one, 0, 1)),
        "error": json.loads(encoder.error(one, 0, 1)),
    }


def _shown(latest) -> str:
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(live_table(latest))
    return console.export_text()


def test_shows_heats_field_error_sensors_and_reasons():
    latest = _latest(quality=1)
    latest["heat"]["sources"]["nut"] = {"heat_W": 61.234, "sigma_W": 2.0}
    latest["truth/heat"] = {"sources": {"nut": {"heat_W": 59.234, "sigma_W": 0}}}
    latest["health"] = {"state": "degraded", "reasons": ["channel t2_degC is stale"]}
    text = _shown(latest)
    for words in ("quality degraded", "61.23", "2.00", "59.23", "1.0", "left_bearing", "field", "°C", "error",
                  "µm", "t2", "channel t2_degC is stale", "service degraded"):  # fmt: skip
        assert words in text


def test_without_truth_there_is_no_such_column():
    assert "truth" not in _shown(_latest())


def test_shows_nothing_and_unknown_values():
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


def test_what_is_not_renewed_is_stale(monkeypatch):
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
