"""Every figure of every key is at every outlet with its value and its quality: one process, real clients."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC
from typing import Any, NamedTuple

import numpy as np
import pytest
from asyncua import Client, ua

from observer.bus.exchange import KEYS
from observer.config.outlets import Metrics, Mqtt, Opcua
from tests.bus.router import free_port
from tests.outlets.feeding import ALARM, ENCODER, HEALTH, QUALITIES, OutletsFeed, block, fed_outlets
from tests.outlets.nodes import read_node
from tests.outlets.test_metrics import labelled, scraped
from tests.outlets.test_mqtt import Listener, broker, pytestmark  # noqa: F401  (the marks hold here, too)
from tests.patience import eventually, until

STATUS = {
    None: ua.StatusCodes.Good,
    "good": ua.StatusCodes.Good,
    "starting": ua.StatusCodes.UncertainInitialValue,
    "degraded": ua.StatusCodes.UncertainSubNormal,
    "stale": ua.StatusCodes.UncertainLastUsableValue,
    "invalid": ua.StatusCodes.BadNoData,
}


class ShownFigure(NamedTuple):
    """One value: the part of the documents whose quality it has, empty for none, and where it is."""

    part: str
    metric: str | None
    labels: dict[str, str]
    value: float
    node: str | None
    node_value: Any

    @property
    def has_label(self) -> bool:
        """Whether the metric has its quality as a label."""
        return self.part != "" and self.metric not in UNLABELLED


UNLABELLED = {"sensor_good", "sensors_used", "sensors", "learned", "learned_sigma", "compensation_armed"}
NUT, LEFT, MIDDLE, END = {"source": "nut"}, {"source": "left"}, {"position_m": "0.5"}, {"position_m": "1"}
FILM, AXIS, NONE = {"parameter": "surface.convection_W_m2K"}, {"driver": "axis"}, {}
FIGURES = [
    ShownFigure("heat", "heat_watts", NUT, 26.5, "Heat/nut/Heat_W", 26.5),
    ShownFigure("heat", "heat_sigma_watts", LEFT, 0.25, "Heat/nut/Sigma_W", 0.5),
    ShownFigure("heat", "heat_bound_watts", LEFT, 1.25, "Heat/nut/Bound_W", 2.5),
    ShownFigure("heat", "heat_law_watts", LEFT, 3.0, "Heat/nut/Law_W", 25.0),
    ShownFigure("heat", "sensors_used", NONE, 1.0, "SensorsUsed", 1.0),
    ShownFigure("heat", "sensors", NONE, 2.0, "SensorsConfigured", 2.0),
    ShownFigure("estimate", None, NONE, 0.0, "Field/Position_m", [0.0, 0.5, 1.0]),
    ShownFigure("field", "temperature_celsius", MIDDLE, 25.5, "Field/Temperature_degC", [21.0, 25.5, 22.0]),
    ShownFigure("field", "temperature_sigma_celsius", MIDDLE, 0.2, "Field/Sigma_K", [0.1, 0.2, 0.3]),
    ShownFigure("field", "temperature_bound_celsius", END, 1.5, "Field/Bound_K", [0.5, 0.75, 1.5]),
    ShownFigure("error", "error_meters", END, 12e-6, "Error/Error_um", [0.0, 8.0, 12.0]),
    ShownFigure("error", "error_sigma_meters", MIDDLE, 1e-6, "Error/Sigma_um", [0.0, 1.0, 2.0]),
    ShownFigure("error", "error_bound_meters", MIDDLE, 4e-6, "Error/Bound_um", [0.0, 4.0, 9.0]),
    ShownFigure("estimate", "innovation_celsius", {"sensor": "t1"}, 0.125, "Sensors/t1/Innovation_K", 0.125),
    ShownFigure("estimate", "sensor_good", {"sensor": "t1"}, 1.0, "Sensors/t1/Quality", "good"),
    ShownFigure("estimate", "sensor_good", {"sensor": "t2"}, 0.0, None, None),
    ShownFigure("other", "learned", FILM, 14.5, "Learned/surface.convection_W_m2K/Value", 14.5),
    ShownFigure("other", "learned_sigma", FILM, 0.5, "Learned/surface.convection_W_m2K/Sigma", 0.5),
    ShownFigure("other", "forecast_settled_timestamp_seconds", NONE, 1234.5, "Forecast/SettledAt_s", 1234.5),
    ShownFigure("other", None, NONE, 0.0, "Probing/ProbeNow", 1.0),
    ShownFigure("other", "error_within_meters", NONE, 7e-6, "Probing/Within_um", 7.0),
    ShownFigure("other", "error_after_probing_meters", NONE, 3e-6, "Probing/After_um", 3.0),
    ShownFigure("other", "compensation_armed", NONE, 1.0, "Compensation/Armed", 1.0),
    ShownFigure("other", None, NONE, 0.0, "Compensation/Phase", "following"),
    ShownFigure("", None, NONE, 0.0, "Health/State", "degraded"),
    ShownFigure("", None, NONE, 0.0, "Health/Reasons", ["channel t2_degC is missing"]),
    ShownFigure("", None, NONE, 0.0, "Health/DegradedSensors", ["t2"]),
    ShownFigure("", "cycles_total", NONE, 70.0, None, None),
    ShownFigure("", "overruns_total", NONE, 2.0, None, None),
    ShownFigure("", "published_total", NONE, 400.0, None, None),
    ShownFigure("", "publish_drops_total", NONE, 3.0, None, None),
    ShownFigure("", "unsent_steps", {"outlet": "mqtt"}, 12.0, None, None),
    ShownFigure("", "recorded_total", NONE, 80.0, None, None),
    ShownFigure("", "record_drops_total", NONE, 6.0, None, None),
    ShownFigure("", "driver_errors_total", AXIS, 4.0, None, None),
    ShownFigure("", "driver_reconnects_total", AXIS, 1.0, None, None),
    ShownFigure("", "driver_error_frames_total", AXIS, 9.0, None, None),
    ShownFigure("", "driver_bus_off_total", AXIS, 8.0, None, None),
    ShownFigure("", "channel_age_seconds", {"channel": "t1_degC"}, 0.25, None, None),
    ShownFigure("", "up", NONE, 1.0, None, None),
    ShownFigure("", "state", {"state": "degraded"}, 1.0, None, None),
    ShownFigure("", "state", {"state": "good"}, 0.0, None, None),
    ShownFigure("", "alarms", {"severity": "major", "state": "unacknowledged"}, 1.0, "Alarms/Count", 1.0),
    ShownFigure("", "alarm_since_timestamp_seconds",
           {"id": ALARM["id"], "severity": "major", "state": "unacknowledged"}, 5.0, "Alarms/Raised",
           ["major sensor_fault.t2.open_circuit (unacknowledged): open; look"]),
]  # fmt: skip


def _documents(quality: str, heat_quality: str) -> dict[str, bytes]:
    """A message on every key; the heats have a quality of their own."""
    rated = {"time_s": 1.8e9, "quality": quality}
    codes = [QUALITIES.index(name) for name in (heat_quality, quality, quality)]
    unused_K = np.nan if quality == heat_quality else 0.5
    estimate = replace(
        block(1.8e9, quality),
        part_quality=np.array([codes], np.int8),
        innovation_K=np.array([[0.125, unused_K]]),
    )
    documents = {
        "health": HEALTH | {"time_s": 1.8e9},
        "alarms": {"time_s": 1.8e9, "alarms": [ALARM], "bands": {}},
        "learned": rated | {"parameters": {"surface.convection_W_m2K": {"value": 14.5, "sigma": 0.5}}},
        "forecast": rated | {"settled_at_s": 1234.5},
        "probing": rated | {"probe_now": True, "within_um": 7.0, "after_um": 3.0},
        "compensation": rated | {"armed": True, "phase": "following"},
    }
    payloads = {key: json.dumps(document).encode() for key, document in documents.items()}
    return {"estimate": ENCODER.cbor(estimate, 0, 7), "heat": ENCODER.heat(estimate, 0, 7), **payloads}


class ListenedOutlets(NamedTuple):
    """The outlets and those who listen to them."""

    feed: OutletsFeed
    listen: str
    url: str
    mqtt: Listener


@contextmanager
def _served(folder, period_s: float) -> Iterator[ListenedOutlets]:
    listen, url, port = f"127.0.0.1:{free_port()}", f"opc.tcp://127.0.0.1:{free_port()}", free_port()
    tables = {"metrics": Metrics(listen=listen), "opcua": Opcua(listen=url)}
    tables["mqtt"] = Mqtt(broker=f"127.0.0.1:{port}")
    with broker(folder, port), Listener(port) as mqtt, fed_outlets(period_s=period_s, **tables) as feed:
        waits_for = {url, f"http://{listen}/metrics"}
        until(lambda: waits_for.discard(feed.said().get("address")) or not waits_for)
        until(lambda: mqtt.newest.get("alive") == b"true")
        yield ListenedOutlets(feed, listen, url, mqtt)


@pytest.fixture(scope="module")
def outlets(tmp_path_factory):
    with _served(tmp_path_factory.mktemp("broker"), 60.0) as served:
        yield served


def test_the_table_of_figures_has_every_figure_of_every_key():
    figures = [figure for key in KEYS.values() for figure in key.figures]
    metrics = {f"{f.metric}_total" if f.counter else f.metric for f in figures if f.metric}
    nodes = {f.node.partition("/{}")[0] for f in figures if f.node}
    assert metrics <= {figure.metric for figure in FIGURES}
    assert all(any(f.node and f.node.startswith(node) for f in FIGURES) for node in nodes)


async def _wrong(client: Client, found: dict, qualities: dict[str, str]) -> list[ShownFigure]:
    """The figures that Prometheus or OPC UA have otherwise."""
    wrong = []
    for figure in FIGURES:
        quality = qualities.get(figure.part)
        if figure.metric is not None:
            labels = figure.labels | ({"quality": quality} if figure.has_label else {})
            value = found.get(f"ballscrew_{figure.metric}", {}).get(labelled(**labels))
            is_shown = quality in (None, "good", "starting", "degraded")
            if value != (pytest.approx(figure.value) if is_shown else None):
                wrong.append(figure)
        if figure.node is not None:
            node = await read_node(client, *figure.node.split("/"))
            is_right = (
                node is not None
                and node.StatusCode.value == STATUS[quality]
                and node.SourceTimestamp.replace(tzinfo=UTC).timestamp() == 1.8e9
                and (quality == "invalid" or node.Value.Value == _approximately(figure.node_value))
            )
            if not is_right:
                wrong.append(figure)
    return wrong


def _approximately(value: Any) -> Any:
    is_number = isinstance(value, float) or (isinstance(value, list) and isinstance(value[0], float))
    return pytest.approx(value) if is_number else value


@pytest.mark.parametrize(
    ("quality", "heat_quality"), [*zip(QUALITIES, QUALITIES, strict=True), ("good", "starting")]
)
async def test_every_figure_has_its_value_and_quality_at_every_outlet(outlets, quality, heat_quality):
    documents = _documents(quality, heat_quality)
    for key, payload in documents.items():
        outlets.feed.send(key, payload)
    qualities = dict.fromkeys(("estimate", "field", "error", "other"), quality) | {"heat": heat_quality}
    wrong: list[ShownFigure] = FIGURES
    async with Client(outlets.url) as client:

        async def is_right() -> bool:
            nonlocal wrong
            wrong = await _wrong(client, scraped(outlets.listen), qualities)
            return not wrong

        try:
            await eventually(is_right)
        except AssertionError:
            assert wrong == []
        unused = await read_node(client, "Sensors", "t2", "Innovation_K")
        assert unused.StatusCode.value == STATUS["invalid"]
    assert len(scraped(outlets.listen).get("ballscrew_innovation_celsius", ())) <= 1 + (
        quality != heat_quality
    )
    until(lambda: {key: outlets.mqtt.newest.get(key) for key in documents} == documents)
    until(lambda: outlets.mqtt.newest.get("quality") == quality.encode())


async def test_a_silent_service_is_stale_at_every_outlet(tmp_path):
    with _served(tmp_path, 0.5) as outlets:
        for key, payload in _documents("good", "good").items():
            outlets.feed.send(key, payload)
        until(lambda: "heat" in outlets.mqtt.newest)  # the estimate has come, too
        until(lambda: scraped(outlets.listen)["ballscrew_state"][labelled(state="stale")] == 1.0)
        until(lambda: outlets.mqtt.newest.get("quality") == b"stale")
        found = scraped(outlets.listen)
        assert found["ballscrew_up"] == {labelled(): 0.0}
        assert "ballscrew_heat_watts" not in found
        async with Client(outlets.url) as client:
            for node in ("Heat/nut/Heat_W", "Health/State", "Alarms/Count"):

                async def is_stale(node=node) -> bool:
                    value = await read_node(client, *node.split("/"))
                    return value is not None and value.StatusCode.value == STATUS["stale"]

                await eventually(is_stale)
