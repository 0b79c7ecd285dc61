"""Prometheus' figures over HTTP, of a real process."""

from __future__ import annotations

import urllib.request

import pytest
from prometheus_client.parser import text_string_to_metric_families

from observer.config.outlets import Metrics
from tests.bus.router import free_port
from tests.outlets.feeding import fed_outlets

pytestmark = pytest.mark.system
WHO = {"machine": "lathe", "axis": "z"}


def scraped(listen: str) -> dict[str, dict[tuple, float]]:
    with urllib.request.urlopen(f"http://{listen}/metrics", timeout=10.0) as reply:
        text = reply.read().decode()
    found: dict[str, dict[tuple, float]] = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            found.setdefault(sample.name, {})[tuple(sorted(sample.labels.items()))] = sample.value
    return found


def labelled(**labels: str) -> tuple:
    return tuple(sorted((WHO | labels).items()))


def test_before_the_first_estimate_a_service_is_not_up():
    listen = f"127.0.0.1:{free_port()}"
    with fed_outlets(metrics=Metrics(listen=listen)) as feed:
        assert feed.said()["reason"] is None
        assert scraped(listen)["ballscrew_up"] == {labelled(): 0.0}


def test_a_port_in_use_is_reported_by_the_outlet_of_metrics():
    listen = f"127.0.0.1:{free_port()}"
    metrics = Metrics(listen=listen)
    with fed_outlets(metrics=metrics) as first, fed_outlets(metrics=metrics) as second:
        assert {first.said()["reason"], second.said()["reason"]} > {None}
