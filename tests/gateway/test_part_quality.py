"""An uncertain heat is shown as such at every outlet, also beside a thermal error that is good."""

from __future__ import annotations

import json
import time
from dataclasses import replace

import numpy as np
import pytest

from observer.gateway.messages import Latest
from observer.gateway.opcua import values
from observer.library.messages import documents_of
from observer.publish.codec import decode_estimate
from observer.publish.watch import live_line
from observer.tables.gateway import Metrics
from tests.gateway.feeding import ENCODER, block, fed_gateway
from tests.gateway.test_metrics import _of, _scraped
from tests.patience import until
from tests.publish.router import free_port

PARTS = np.array([[1, 0, 0]], np.int8)


def payload() -> bytes:
    return ENCODER.cbor(replace(block(time.time()), part_quality=PARTS), 0, 7)


@pytest.fixture
def latest() -> Latest:
    newest = Latest(60.0)
    newest.put("estimate", payload())
    return newest


def test_opcua_marks_the_heats_alone(latest: Latest) -> None:
    found = {value.path: value.quality for value in values(latest)}
    assert found["Heat", "nut", "Heat_W"] == "starting"
    assert found["Heat", "nut", "Bound_W"] == "starting"
    assert found["Error", "Error_um"] == found["Field", "Temperature_degC"] == "good"


@pytest.mark.system
def test_a_scrape_labels_the_heats_alone() -> None:
    listen = f"127.0.0.1:{free_port()}"
    with fed_gateway(metrics=Metrics(listen=listen)) as feed:
        assert feed.said()["reason"] is None
        feed.send("estimate", payload())
        until(lambda: "ballscrew_heat_watts" in _scraped(listen))
        found = _scraped(listen)
    assert _of(source="nut", quality="starting") in found["ballscrew_heat_watts"]
    assert _of(position_m="1", quality="good") in found["ballscrew_error_meters"]


def test_documents_made_of_an_estimate_have_the_quality_of_their_part() -> None:
    documents = documents_of(decode_estimate(payload()))
    qualities = {name: document["quality"] for name, document in documents.items()}
    assert qualities == {"heat": "starting", "field": "good", "error": "good"}


def test_the_live_line_begins_with_the_quality_of_the_error() -> None:
    one = replace(block(time.time()), part_quality=PARTS)
    newest = {part: json.loads(ENCODER.documents[part](one, 0, 7)) for part in ("heat", "field", "error")}
    line = live_line(newest | {"health": {"error_known_to_um": 4.9}})
    assert line.startswith("good to ±5 µm at the nut, but without some (1 of 2 sensors): nut ")
