"""Prometheus' figures over HTTP, of a real process."""

from __future__ import annotations

import urllib.request

import pytest
from prometheus_client.parser import text_string_to_metric_families

from observer.tables.gateway import Metrics
from tests.gateway.feeding import fed_gateway, feed_machine
from tests.patience import until
from tests.publish.router import free_port

pytestmark = pytest.mark.system
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


def test_a_scrape_has_every_figure_with_its_quality():
    listen = f"127.0.0.1:{free_port()}"
    with fed_gateway(metrics=Metrics(listen=listen)) as feed:
        feed_machine(feed)
        until(lambda: "ballscrew_heat_watts" in _scraped(listen))
        found = _scraped(listen)
    assert found["ballscrew_up"] == {_of(): 1.0}
    assert found["ballscrew_heat_watts"][_of(source="nut", quality="good")] == 26.5
    assert found["ballscrew_heat_sigma_watts"][_of(source="left", quality="good")] == 0.25
    assert found["ballscrew_heat_bound_watts"][_of(source="left", quality="good")] == 1.25
    assert found["ballscrew_temperature_bound_celsius"][_of(position_m="1", quality="good")] == 1.5
    error_bound_m = found["ballscrew_error_bound_meters"][_of(position_m="0.5", quality="good")]
    assert error_bound_m == pytest.approx(4e-6)
    assert found["ballscrew_temperature_celsius"][_of(position_m="0.5", quality="good")] == 25.5
    assert found["ballscrew_error_meters"][_of(position_m="1", quality="good")] == pytest.approx(12e-6)
    assert list(found["ballscrew_innovation_celsius"].values()) == [0.125]  # what is not known is not there
    assert found["ballscrew_sensor_good"] == {_of(sensor="t1"): 1.0, _of(sensor="t2"): 0.0}
    assert found["ballscrew_state"][_of(state="degraded")] == 1.0
    assert sum(found["ballscrew_state"].values()) == 1.0
    assert found["ballscrew_cycles_total"] == {_of(): 70.0}
    assert found["ballscrew_driver_reconnects_total"] == {_of(driver="axis"): 1.0}
    (since,) = found["ballscrew_alarm_since_timestamp_seconds"]
    assert dict(since) | {"id": "sensor_fault.t2.open_circuit", "state": "unacknowledged"} == dict(since)
    assert found["ballscrew_alarms"][_of(severity="major", state="unacknowledged")] == 1.0
    assert found["ballscrew_learned"] == {_of(parameter="surface.convection_W_m2K"): 14.5}
    assert found["ballscrew_forecast_settled_timestamp_seconds"] == {_of(quality="good"): 1234.5}


def test_before_the_first_estimate_it_is_not_up():
    listen = f"127.0.0.1:{free_port()}"
    with fed_gateway(metrics=Metrics(listen=listen)) as feed:
        assert feed.said()["reason"] is None
        assert _scraped(listen)["ballscrew_up"] == {_of(): 0.0}


@pytest.mark.parametrize("quality", ["stale", "invalid"])
def test_what_cannot_be_used_is_not_there(quality):
    listen = f"127.0.0.1:{free_port()}"
    with fed_gateway(metrics=Metrics(listen=listen)) as feed:
        feed_machine(feed, quality)
        until(lambda: "ballscrew_cycles_total" in _scraped(listen))
        assert "ballscrew_heat_watts" not in _scraped(listen)


def test_a_silent_service_has_no_values():
    listen = f"127.0.0.1:{free_port()}"
    with fed_gateway(period_s=0.5, metrics=Metrics(listen=listen)) as feed:
        feed_machine(feed)
        until(lambda: _scraped(listen)["ballscrew_state"][_of(state="stale")] == 1.0)
        found = _scraped(listen)
    assert found["ballscrew_up"] == {_of(): 0.0}
    assert "ballscrew_heat_watts" not in found


def test_a_port_in_use_is_reported():
    listen = f"127.0.0.1:{free_port()}"
    metrics = Metrics(listen=listen)
    with fed_gateway(metrics=metrics) as first, fed_gateway(metrics=metrics) as second:
        assert {first.said()["reason"], second.said()["reason"]} > {None}
