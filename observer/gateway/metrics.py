"""Metrics for Prometheus, in its base units: metres, seconds, watts, degrees Celsius.

Each value carries the `quality` of its estimate as a label, so one that is not good is never shown as good.
Once the service is silent, or its estimate stale or invalid, the values are absent, which ends the series.
The server is not prometheus_client's own, which has no limit of threads and no time-out for idle clients.
"""

from __future__ import annotations

import asyncio
import math
import socket
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from socketserver import ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

from prometheus_client import CollectorRegistry, make_wsgi_app
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from observer.gateway.messages import Latest
from observer.gateway.start import Say, Start
from observer.tables.gateway import host_and_port

STATES = ("good", "starting", "degraded", "stale", "invalid")
_SHOWN = ("good", "starting", "degraded")
_COUNTS = {
    "cycles": "Steps of the estimator.",
    "overruns": "Steps that were left out because the computer was late.",
    "published": "Messages that went to Zenoh.",
    "publish_drops": "Messages that could not go to Zenoh.",
    "recorded": "Rows that were recorded.",
    "record_drops": "Rows that could not be recorded.",
}


async def serve(start: Start, latest: Latest, say: Say) -> None:
    """Answer scrapes until cancelled; raises `OSError` with one sentence where it cannot listen."""
    assert start.metrics is not None
    host, port = host_and_port(start.metrics.listen)
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Figures(start, latest))
    try:
        server = serving(host, port, make_wsgi_app(registry))
    except OSError as error:
        raise OSError(
            f"cannot listen on {start.metrics.listen} ({error.strerror}); change metrics.listen"
        ) from None
    thread = threading.Thread(target=server.serve_forever, name="metrics", daemon=True)
    thread.start()
    say({"reason": None, "address": f"http://{start.metrics.listen}/metrics"})
    try:
        await asyncio.Event().wait()
    finally:
        server.shutdown()
        server.server_close()
        thread.join(1.0)


class _Figures(Collector):
    """Collects the newest figures at each scrape."""

    def __init__(self, start: Start, latest: Latest) -> None:
        self._names = {"machine": start.machine, "axis": start.axis}
        self._latest = latest

    def collect(self) -> Iterable[Metric]:
        """Give every figure that there is now."""
        latest, is_stale = self._latest, self._latest.is_stale
        gives = not is_stale and latest.payload("estimate") is not None
        yield self._gauge("up", "Whether the service gives estimates.", [({}, float(gives))])
        health = latest.document("health")
        state = "stale" if is_stale else health.get("state", "starting")
        states = [({"state": name}, float(name == state)) for name in STATES]
        yield self._gauge("state", "The state of the service.", states)
        yield from self._counts(health)
        yield from self._alarms(latest.document("alarms"))
        if not is_stale:
            yield from self._estimates()
            yield from self._of_health(health)

    def _estimates(self) -> Iterator[Metric]:
        estimate, learned = self._latest.document("estimate"), self._latest.document("learned")
        forecast = self._latest.document("forecast")
        if (quality := estimate.get("quality")) not in _SHOWN:
            return
        for name, words, label, of, key, factor in (
            ("heat_watts", "Heat that enters the screw.", "source", "sources", "heat_W", 1.0),
            ("heat_sigma_watts", "Its standard deviation.", "source", "sources", "heat_sigma_W", 1.0),
            ("heat_bound_watts", "Its bound.", "source", "sources", "heat_bound_W", 1.0),
            ("heat_law_watts", "The heat by its law.", "source", "sources", "law_W", 1.0),
            ("temperature_celsius", "Temperature.", "position_m", "position_m", "field_degC", 1.0),
            ("temperature_sigma_celsius", "Its sigma.", "position_m", "position_m", "field_sigma_K", 1.0),
            ("temperature_bound_celsius", "Its bound.", "position_m", "position_m", "field_bound_K", 1.0),
            ("error_meters", "Thermal error.", "position_m", "position_m", "error_um", 1e-6),
            ("error_sigma_meters", "Its sigma.", "position_m", "position_m", "error_sigma_um", 1e-6),
            ("error_bound_meters", "Its bound.", "position_m", "position_m", "error_bound_um", 1e-6),
            ("innovation_celsius", "Reading less expected.", "sensor", "sensors", "innovation_K", 1.0),
        ):
            pairs = zip(estimate.get(of, ()), estimate.get(key, ()), strict=False)
            rows = [({label: _label(a), "quality": quality}, factor * float(b)) for a, b in pairs]
            yield self._gauge(name, words, rows)
        good = zip(estimate.get("sensors", ()), estimate.get("sensor_quality", ()), strict=False)
        rows = [({"sensor": a}, float(b == "good")) for a, b in good]
        yield self._gauge("sensor_good", "Whether the reading was used.", rows)
        for name, key in (("learned", "value"), ("learned_sigma", "sigma")):
            learnt = learned.get("parameters", {}).items()
            rows = [({"parameter": p}, float(v[key])) for p, v in learnt if v.get(key) is not None]
            yield self._gauge(name, "What has been learnt, in the unit of its name.", rows)
        if forecast.get("quality") in _SHOWN and forecast.get("settled_at_s") is not None:
            rows = [({"quality": forecast["quality"]}, float(forecast["settled_at_s"]))]
            yield self._gauge("forecast_settled_timestamp_seconds", "When it will have settled.", rows)

    def _of_health(self, health: Mapping[str, Any]) -> Iterator[Metric]:
        ages = health.get("channels", {}).items()
        rows = [({"channel": n}, float(c["age_s"])) for n, c in ages if c.get("age_s") is not None]
        yield self._gauge("channel_age_seconds", "Age of the last usable value.", rows)

    def _counts(self, health: Mapping[str, Any]) -> Iterator[Metric]:
        for key, words in _COUNTS.items():
            if key in health:
                yield self._counter(key, words, [({}, float(health[key]))])
        drivers = health.get("drivers", {}).items()
        for key, words in (("errors", "Polls that failed."), ("reconnects", "Connections after the first.")):
            yield self._counter(f"driver_{key}", words, [({"driver": n}, float(d[key])) for n, d in drivers])

    def _alarms(self, document: Mapping[str, Any]) -> Iterator[Metric]:
        raised = [(alarm["severity"], alarm["state"]) for alarm in document.get("alarms", ())]
        rows = [
            ({"severity": severity, "state": state}, float(raised.count((severity, state))))
            for severity in ("minor", "major", "invalid")
            for state in ("unacknowledged", "acknowledged", "returned")
        ]
        yield self._gauge("alarms", "How many alarms there are.", rows)

    def _gauge(self, name: str, words: str, rows: list[tuple[dict[str, str], float]]) -> Metric:
        labels = [*self._names, *(rows[0][0] if rows else ())]
        return _filled(GaugeMetricFamily(f"ballscrew_{name}", words, labels=labels), self._names, rows)

    def _counter(self, name: str, words: str, rows: list[tuple[dict[str, str], float]]) -> Metric:
        labels = [*self._names, *(rows[0][0] if rows else ())]
        return _filled(CounterMetricFamily(f"ballscrew_{name}", words, labels=labels), self._names, rows)


def _filled(
    family: GaugeMetricFamily | CounterMetricFamily,
    names: Mapping[str, str],
    rows: list[tuple[dict[str, str], float]],
) -> Metric:
    """The family with its rows; what is not known is left out."""
    for labels, value in rows:
        if math.isfinite(value):
            family.add_metric([*names.values(), *labels.values()], value)
    return family


def _label(value: Any) -> str:
    return value if isinstance(value, str) else f"{float(value):.4g}"


_MOST = 16
_WITHIN_S = 5.0


class _ScrapeHandler(WSGIRequestHandler):
    """Answers one question without a word on standard error."""

    timeout = _WITHIN_S  # for each part of it

    def log_message(self, *_: Any) -> None:
        """Say nothing."""


class _ScrapeServer(ThreadingMixIn, WSGIServer):
    """A thread for each of a few connections; where there are more, the oldest makes room."""

    daemon_threads = True

    def __init__(self, address: tuple[str, int], family: socket.AddressFamily) -> None:
        self.address_family = family
        self._held: list[socket.socket] = []
        self._free = threading.Semaphore(_MOST)
        super().__init__(address, _ScrapeHandler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Begin to answer."""
        if not self._free.acquire(blocking=False):
            for oldest in self._held[:1]:
                with suppress(OSError):  # it has ended meanwhile
                    oldest.shutdown(socket.SHUT_RDWR)
            if not self._free.acquire(timeout=_WITHIN_S):
                self.shutdown_request(request)
                return
        self._held.append(request)
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, in a thread of its own."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._held.remove(request)
            self._free.release()

    def handle_error(self, *_: Any) -> None:
        """Say nothing of a client that went away or did not ask in time."""


def serving(host: str, port: int, app: Any) -> WSGIServer:
    """A server of a WSGI application that is bound to a place; raises `OSError` where it cannot be."""
    family, _, _, _, (address, *_) = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    server = _ScrapeServer((str(address), port), family)
    server.set_app(app)
    return server
