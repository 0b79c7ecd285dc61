"""Metrics for Prometheus, in its base units: metres, seconds, watts, degrees Celsius.

Each value carries its `quality` as a label, so one that is not good is never shown as good.
The values are absent while the service is silent, or its estimate stale or invalid. That ends the series.
`up`, `state`, `alarms` and the counters describe the service itself and are always present.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from typing import Any, get_args

from prometheus_client import CollectorRegistry, make_asgi_app
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from observer.bus.exchange import KEYS, SEVERITIES, AlarmState, KeyFigure
from observer.config.outlets import ReportState
from observer.frames import EstimateQuality
from observer.outlets.messages import Latest
from observer.outlets.server import served
from observer.outlets.start import Start

_SHOWN = ("good", "starting", "degraded")
Rows = list[tuple[dict[str, str], float]]


async def serve(start: Start, latest: Latest, report_state: ReportState) -> None:
    """Answer scrapes until cancelled; raises `OSError` with one sentence where it cannot listen."""
    assert start.metrics is not None
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Figures(start, latest))
    async with served(make_asgi_app(registry), "metrics", start.metrics.listen) as serving:
        report_state({"reason": None, "address": f"http://{start.metrics.listen}/metrics"})
        await serving


class _Figures(Collector):
    """Collects the newest figures at each scrape."""

    def __init__(self, start: Start, latest: Latest) -> None:
        self._names = {"machine": start.machine, "axis": start.axis}
        self._latest = latest

    def collect(self) -> Iterable[Metric]:
        """Give every figure that there is now."""
        is_stale = self._latest.is_stale
        gives = not is_stale and self._latest.payload("estimate") is not None
        yield self._family("up", "Whether the service gives estimates.", [({}, float(gives))])
        state = "stale" if is_stale else self._latest.document("health").get("state", "starting")
        states: Rows = [({"state": q.label}, float(q.label == state)) for q in EstimateQuality]
        yield self._family("state", "The state of the service.", states)
        yield self._family("alarms", "How many alarms there are.", self._alarms())
        raised = self._latest.document("alarms").get("alarms", ())
        since = [({n: a[n] for n in ("id", "severity", "state")}, a["since_s"]) for a in raised]
        yield self._family("alarm_since_timestamp_seconds", "Since when each alarm is raised.", since)
        for name, key in KEYS.items():
            document = self._latest.document(name) if key.figures else {}
            for figure in key.figures:
                quality = figure.quality(document) if key.rated else None
                is_shown = not is_stale and (not key.rated or quality in _SHOWN)
                if figure.metric is not None and document and (figure.counter or is_shown):
                    rows = list(_rows(figure, document, quality))
                    yield self._family(figure.metric, figure.words, rows, counter=figure.counter)

    def _alarms(self) -> Rows:
        alarms = self._latest.document("alarms").get("alarms", ())
        raised = [(alarm["severity"], alarm["state"]) for alarm in alarms]
        shown = [state for state in get_args(AlarmState) if state != "pending"]
        return [
            ({"severity": severity, "state": state}, float(raised.count((severity, state))))
            for severity, state in product(SEVERITIES, shown)
        ]

    def _family(self, name: str, words: str, rows: Rows, *, counter: bool = False) -> Metric:
        """A metric with its rows; what is not finite is left out."""
        labels = [*self._names, *(rows[0][0] if rows else ())]
        kind = CounterMetricFamily if counter else GaugeMetricFamily
        family = kind(f"ballscrew_{name}", words, labels=labels)
        for labels_of_row, value in rows:
            if math.isfinite(value):
                family.add_metric([*self._names.values(), *labels_of_row.values()], value)
        return family


def _rows(
    figure: KeyFigure, document: Mapping[str, Any], quality: str | None
) -> Iterator[tuple[dict[str, str], float]]:
    """Yield the labels and values of a figure, without unknown values."""
    of_quality = {"quality": quality} if figure.labelled and quality is not None else {}
    for name, value in figure.rows(document):
        if value is not None:
            number = float(value == "good") if isinstance(value, str) else figure.factor * float(value)
            yield ({figure.label: name} if name else {}) | of_quality, number
