"""The data sent to viewers of this axis: the service's messages, and the last hour."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from observer.bus.codec import decode_estimate
from observer.bus.exchange import KEYS, Key
from observer.frames import FORCE
from observer.outlets.messages import Latest
from observer.outlets.page_viewers import Viewers, event
from observer.outlets.start import Start
from observer.report import appearance

_BEAT_S = 1.0
_RETRY = b"retry: 1000\n\n"
"""A browser that has lost the connection retries each second; its default is three."""
_SHOWN_COLUMNS = (
    "time_s", "sequence", "instance", "quality", "sensors_used", "sources", "law_W", "sensors",
    "sensor_quality",
)  # fmt: skip
_DIGITS = 6


class Stream(Viewers):
    """Events for any number of viewers; `run` feeds it."""

    def __init__(
        self,
        latest: Latest,
        start: Start,
        login: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self._latest = latest
        self._clock = clock
        hello = start.model_dump(include={"machine", "axis", "period_s", "laws", "forecast_s"})
        hello["login"] = login
        self.send("hello", event("hello", json.dumps(hello).encode()) + _RETRY)
        self._sent_s: dict[str, float] = {}
        self._innovations = Innovations()
        self.recent = Recent()

    async def run(self) -> None:
        """Pass on the service's messages as they arrive, for ever, and a heartbeat each second."""
        beating = asyncio.create_task(self._beat())
        try:
            async for key, payload in self._latest.messages():
                self.take(key, payload)
        finally:
            beating.cancel()

    def take(self, key: str, payload: bytes) -> None:
        """Pass a message on, unless one of its kind was sent just now; an empty one drops the last."""
        if not payload:
            self._sent_s.pop(key, None)
            self.recent.forget(key)
            self.forget(key)
            return
        now_s = self._clock()
        try:
            estimate = decode_estimate(payload) if key == "estimate" else None
            if estimate is not None:
                self._innovations.take(estimate)
            if now_s - self._sent_s.get(key, -math.inf) < KEYS[key].page_every_s:
                return
            if estimate is not None:
                payload = shown(estimate, self._innovations)
            self.recent.take(key, payload)
            data = payload if KEYS[key].panel else figures_of(KEYS[key], json.loads(payload))
        except ValueError:
            return  # of another version; what the page shows goes stale
        self._sent_s[key] = now_s
        self.send(key, event(key, data))

    async def _beat(self) -> None:
        while True:
            self.send("beat", event("beat", json.dumps({"stale": self._latest.is_stale}).encode()))
            await asyncio.sleep(_BEAT_S)


def shown(estimate: Mapping[str, Any], innovations: Innovations) -> bytes:
    """The part of an estimate that the page shows, with the last residual of each sensor, as JSON."""
    columns = {key: _plain(estimate[key]) for key in _SHOWN_COLUMNS if key in estimate}
    return json.dumps({**columns, "innovations": innovations.document(estimate["time_s"])}).encode()


def figures_of(key: Key, document: Mapping[str, Any]) -> bytes:
    """The figures of a document that has no panel of its own, `[words, name, value]` each, as JSON."""
    rows = [(figure.words, name, value) for figure in key.figures for name, value in figure.rows(document)]
    return json.dumps({"rows": rows, "quality": document.get("quality")}).encode()


def _plain(value: Any) -> Any:
    if not hasattr(value, "tolist"):
        return value
    return [round(x, _DIGITS) if math.isfinite(x) else None for x in value.tolist()]


_EVERY_S = 4.0
_HOUR_S = 3600.0
_ROUND = 3


class Recent:
    """Keeps a row each time a field comes and the last row is old enough."""

    def __init__(self) -> None:
        self._rows: deque[bytes] = deque(maxlen=math.ceil(_HOUR_S / _EVERY_S))
        self._last_s = -math.inf
        self._newest: dict[str, dict[str, Any]] = {}

    def take(self, key: str, data: bytes) -> None:
        """Take a document; raises `ValueError` where it is not JSON."""
        if key not in {"estimate", "heat", "error", "readings", "field"}:
            return
        self._newest[key] = document = json.loads(data)
        if key == "field" and self._is_due(document):
            self._last_s = document["time_s"]
            self._rows.append(json.dumps(self._row(document)).encode())

    def forget(self, key: str) -> None:
        """Drop the last document of a key; the rows stay."""
        self._newest.pop(key, None)

    def document(self) -> bytes:
        """JSON: the rows, the oldest first, the keys of which the page hears, and how it is to look."""
        head = {"every_s": _EVERY_S, "keys": list(KEYS), "appearance": appearance.document()}
        return json.dumps(head).encode()[:-1] + b', "rows": [' + b",".join(self._rows) + b"]}"

    def _is_due(self, field: dict[str, Any]) -> bool:
        if not self._rows:
            return True
        since_s = field["time_s"] - self._last_s
        if since_s < 0:  # the clock went back; what is older cannot be drawn beside it
            self._rows.clear()
        return not 0 <= since_s < _EVERY_S

    def _row(self, field: dict[str, Any]) -> dict[str, Any]:
        heat, estimate = self._newest.get("heat", {}), self._newest.get("estimate", {})
        error, readings = self._newest.get("error", {}), self._newest.get("readings", {})
        return {
            "time_s": field["time_s"],
            "quality": field["quality"],
            **{key: field[key] for key in ("sensors_used", "sensors") if key in field},
            **{key: _rounded(field.get(key) or []) for key in ("temperature_degC", "sigma_K", "bound_K")},
            **{key: _rounded(error.get(key) or []) for key in ("error_um", "sigma_um", "bound_um")},
            **{key: error[key] for key in FORCE if key in error},
            **{
                key: {name: entry.get(key) for name, entry in heat.get("sources", {}).items()}
                for key in ("heat_W", "sigma_W", "bound_W")
            },
            "law_W": dict(zip(estimate.get("sources", []), estimate.get("law_W", []), strict=False)),
            "channels": {name: entry["value"] for name, entry in readings.get("channels", {}).items()},
            "crossed": {
                name: quality
                for name, quality in zip(
                    estimate.get("sensors", []), estimate.get("sensor_quality", []), strict=False
                )
                if quality in CROSSED
            },
            "lost": [n for n, entry in readings.get("channels", {}).items() if entry["quality"] != "good"],
        }


CROSSED = ("missing", "stale", "rejected", "excluded")
"""Qualities of a sensor whose reading is not used now."""


def _rounded(values: list[float | None]) -> list[float | None]:
    return [None if value is None else round(value, _ROUND) for value in values]


_LATE = 1.5
"""A reading is late when the last one is older than this many times the last interval."""


@dataclass(frozen=True, slots=True)
class Innovation:
    """The last residual of a sensor, at which step, and how long after the one before."""

    value_K: float
    sigma_K: float
    time_s: float
    sequence: int
    after_s: float


class Innovations:
    """Takes every estimate, decoded."""

    def __init__(self) -> None:
        self._last: dict[str, Innovation] = {}
        self._instance: str | None = None

    def take(self, estimate: Mapping[str, Any]) -> None:
        """Keep the newest; another instance of the service, or a clock that went back, starts again."""
        time_s, instance = estimate["time_s"], estimate.get("instance")
        if instance != self._instance or any(time_s < last.time_s for last in self._last.values()):
            self._last, self._instance = {}, instance
        columns = (estimate.get(key, ()) for key in ("sensors", "innovation_K", "innovation_sigma_K"))
        for name, value_K, sigma_K in zip(*columns, strict=False):
            if not math.isfinite(value_K):
                continue
            before = self._last.get(name)
            after_s = 0.0 if before is None else time_s - before.time_s
            self._last[name] = Innovation(
                float(value_K), float(sigma_K), time_s, estimate["sequence"], after_s
            )

    def document(self, time_s: float) -> dict[str, dict[str, Any]]:
        """By sensor `{"value", "sigma", "sequence", "age_s", "late"}`, at a time."""
        return {
            name: {
                "value": round(last.value_K, 6),
                "sigma": round(last.sigma_K, 6) if math.isfinite(last.sigma_K) else None,
                "sequence": last.sequence,
                "age_s": round(time_s - last.time_s, 3),
                "late": time_s - last.time_s > _LATE * last.after_s,
            }
            for name, last in self._last.items()
        }
