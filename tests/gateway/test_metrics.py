"""Prometheus' figures over HTTP, of a real process; and the dashboard's queries, held against a scrape."""

from __future__ import annotations

import json
import re
import urllib.request
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from observer.tables.gateway import Metrics
from tests.gateway.telling import ALARM, HEALTH, told_gateway
from tests.patience import until
from tests.publish.router import free_port

pytestmark = pytest.mark.system
DASHBOARD = Path(__file__).parents[2] / "config" / "grafana-dashboard.json"
WHO = {"machine": "lathe", "axis": "z"}


def _scraped(listen: str) -> dict[str, dict[tuple, float]]:
    with urllib.request.urlopen(f"http://{listen}/metrics", timeout=10.0) as reply:
        text = reply.read().decode()
    found: dict[str, dict[tuple, float]] = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            found.setdefault(sample.name, {})[tuple(sorted(sample.labels.items()))] = sample.value
    return found


def _of(**labels: str) -> tuple:
    return tuple(sorted((WHO | labels).items()))


def _told(teller, quality: str = "good") -> None:
    assert teller.said()["reason"] is None
    teller.document("health", HEALTH | {"time_s": 1.0})
    teller.document("alarms", {"time_s": 1.0, "alarms": [ALARM], "bands": {}})
    teller.document(
        "learned", {"time_s": 1.0, "parameters": {"surface.convection_W_m2K": {"value": 14.5, "sigma": 0.5}}}
    )
    teller.document("forecast", {"time_s": 1.0, "quality": "good", "settled_at_s": 1234.5})
    teller.estimate(quality)


def test_a_scrape_has_every_figure_with_its_quality():
    listen = f"127.0.0.1:{free_port()}"
    with told_gateway(metrics=Metrics(listen=listen)) as teller:
        _told(teller)
        until(lambda: "ballscrew_heat_watts" in _scraped(listen))
        found = _scraped(listen)
    assert found["ballscrew_heat_watts"][_of(source="nut", quality="good")] == 26.5
    assert found["ballscrew_heat_sigma_watts"][_of(source="left", quality="good")] == 0.25
    assert found["ballscrew_temperature_celsius"][_of(position_m="0.5", quality="good")] == 25.5
    assert found["ballscrew_error_meters"][_of(position_m="1", quality="good")] == pytest.approx(12e-6)
    assert list(found["ballscrew_innovation_celsius"].values()) == [0.125]  # what is not known is not there
    assert found["ballscrew_sensor_good"] == {_of(sensor="t1"): 1.0, _of(sensor="t2"): 0.0}
    assert found["ballscrew_state"][_of(state="degraded")] == 1.0
    assert sum(found["ballscrew_state"].values()) == 1.0
    assert found["ballscrew_cycles_total"] == {_of(): 70.0}
    assert found["ballscrew_driver_reconnects_total"] == {_of(driver="axis"): 1.0}
    assert found["ballscrew_alarms"][_of(severity="major", state="unacknowledged")] == 1.0
    assert found["ballscrew_learned"] == {_of(parameter="surface.convection_W_m2K"): 14.5}
    assert found["ballscrew_forecast_settled_timestamp_seconds"] == {_of(quality="good"): 1234.5}


@pytest.mark.parametrize("quality", ["stale", "invalid"])
def test_what_cannot_be_used_is_not_there(quality):
    listen = f"127.0.0.1:{free_port()}"
    with told_gateway(metrics=Metrics(listen=listen)) as teller:
        _told(teller, quality)
        until(lambda: "ballscrew_cycles_total" in _scraped(listen))
        assert "ballscrew_heat_watts" not in _scraped(listen)


def test_a_silent_service_has_no_values():
    listen = f"127.0.0.1:{free_port()}"
    with told_gateway(period_s=0.5, metrics=Metrics(listen=listen)) as teller:
        _told(teller)
        until(lambda: _scraped(listen)["ballscrew_up"][_of()] == 0.0)
        found = _scraped(listen)
    assert found["ballscrew_state"][_of(state="stale")] == 1.0
    assert "ballscrew_heat_watts" not in found


def test_a_port_that_is_taken_is_told():
    listen = f"127.0.0.1:{free_port()}"
    metrics = Metrics(listen=listen)
    with told_gateway(metrics=metrics) as first, told_gateway(metrics=metrics) as second:
        assert {first.said()["reason"], second.said()["reason"]} > {None}


def test_every_query_of_the_dashboard_finds_something():
    """Names and labels of each PromQL expression, held against what a scrape has."""
    listen = f"127.0.0.1:{free_port()}"
    with told_gateway(metrics=Metrics(listen=listen)) as teller:
        _told(teller)
        until(lambda: "ballscrew_heat_watts" in _scraped(listen))
        found = _scraped(listen)
    dashboard = json.loads(DASHBOARD.read_text(encoding="utf-8"))
    queries = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    queries += [v["query"] for v in dashboard["templating"]["list"] if v["type"] == "query"]
    assert len(queries) > 8
    for query in queries:
        names = re.findall(r"\bballscrew_\w+", query)
        assert names, query
        for name in names:
            assert name in found, query
        for name, labels in re.findall(r"\b(ballscrew_\w+)\{([^}]*)\}", query):
            wanted = set(re.findall(r"(\w+)=", labels))
            assert all(wanted <= {key for key, _ in row} for row in found[name]), query
