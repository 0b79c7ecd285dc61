"""Discovery for Home Assistant: one retained document that describes the machine, and its state.

The document is that of device-based discovery (Home Assistant 2024.11 or later). All entities read one flat
JSON object. A value that is not `good`, or not known, is null there, which Home Assistant shows as unknown;
while the service is away (`alive`) all are unavailable. Home Assistant's class `distance` has no micrometres,
so thermal errors have a unit and no class.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np

from observer.frames import EstimateQuality
from observer.gateway.messages import Latest
from observer.gateway.start import Start

DEFAULT_PREFIX = "homeassistant"
_STRANGE = re.compile(r"[^A-Za-z0-9_-]")
_MICROMETRE = "\N{GREEK SMALL LETTER MU}m"
_MEASURED = {"state_class": "measurement"}
_POWER = {"device_class": "power", "unit_of_measurement": "W", "suggested_display_precision": 1, **_MEASURED}
_ERROR = {"unit_of_measurement": _MICROMETRE, "suggested_display_precision": 1, **_MEASURED}
_TEMPERATURE = {"device_class": "temperature", "unit_of_measurement": "°C", **_MEASURED}
_QUALITIES = [quality.label for quality in EstimateQuality]
_LONGEST = 255  # of a state
_EVERY_S = 1.0


def topic_of(prefix: str | bool, start: Start) -> str:
    """Return the topic of the document; `prefix` is that of discovery, True for Home Assistant's own."""
    own = DEFAULT_PREFIX if isinstance(prefix, bool) else prefix
    return f"{own}/device/{_identity(start)}/config"


def state_topic_of(topic: str) -> str:
    """Return the topic of the state, for a machine whose topics begin with `topic`."""
    return f"{topic}/home_assistant"


def description(start: Start, topic: str, state: dict[str, Any]) -> dict[str, Any]:
    """Return the document that describes what a state holds; the machine's topics begin with `topic`."""
    identity, program = (
        _identity(start),
        {"name": "Ballscrew Observer", "sw_version": version("ballscrew-observer")},
    )
    availability = {
        "availability_topic": f"{topic}/alive",
        "payload_available": "true",
        "payload_not_available": "false",
        "state_topic": state_topic_of(topic),
    }
    components = {
        key: {"unique_id": f"{identity}_{key}", "value_template": f"{{{{ value_json.{key} }}}}"}
        | availability
        | component
        for key, component in _components(state)
    }
    return {
        "device": {
            "identifiers": [identity],
            "name": f"{start.machine} {start.axis}",
            "model": "ball screw",
            "sw_version": program["sw_version"],
        },
        "origin": program,
        "components": components,
    }


def _components(state: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The entities of what a state holds, by its keys."""
    for key in state:
        if key.startswith("heat_"):
            words = key.removeprefix("heat_").removesuffix("_W").replace("_", " ")
            yield key, {"platform": "sensor", "name": f"Heat of {words}", **_POWER}
    known: dict[str, dict[str, Any]] = {
        "error_nut_um": {"name": "Thermal error at the nut", **_ERROR},
        "error_largest_um": {"name": "Largest thermal error", **_ERROR},
        "temperature_highest_degC": {"name": "Highest temperature of the screw", **_TEMPERATURE},
        "settled_at": {"name": "Thermally settled at", "device_class": "timestamp"},
        "quality": {"name": "Quality", "device_class": "enum", "options": _QUALITIES},
        "health": {"name": "Health", "device_class": "enum", "options": _QUALITIES},
        "alarms": {"name": "Alarms", **_MEASURED},
        "alarm": {"name": "Worst alarm"},
    }
    for key, component in known.items():
        if key in state:
            yield key, {"platform": "sensor", **component}
    template = "{{ 'OFF' if value_json.health == 'good' else 'ON' }}"
    yield "problem", {
        "platform": "binary_sensor", "name": "Problem", "device_class": "problem", "value_template": template,
    }  # fmt: skip


def state_of(latest: Latest) -> dict[str, Any] | None:
    """Return what the machine's entities show now, None before the first estimate."""
    estimate = latest.document("estimate")
    if not estimate:
        return None
    quality = "stale" if latest.is_stale else estimate["quality"]
    is_good = quality == "good"

    def shown(value: Any, part: str, digits: int = 2) -> float | None:
        own = "stale" if latest.is_stale else estimate[f"{part}_quality"]
        known = own == "good" and value is not None and np.isfinite(value)
        return round(float(value), digits) if known else None

    state: dict[str, Any] = {
        f"heat_{_plain(name)}_W": shown(heat_W, "heat")
        for name, heat_W in zip(estimate["sources"], estimate["heat_W"], strict=True)
    }
    error_um = np.asarray(estimate["error_um"], float)
    if error_um.size:
        nut_m = _nut_m(latest)
        if nut_m is not None:
            state["error_nut_um"] = shown(np.interp(nut_m, estimate["position_m"], error_um), "error")
        state["error_largest_um"] = shown(error_um[np.argmax(np.abs(error_um))], "error")
    state["temperature_highest_degC"] = shown(np.max(estimate["field_degC"]), "field")
    settled_at_s = latest.document("forecast").get("settled_at_s") if is_good else None
    state["settled_at"] = (
        None if settled_at_s is None else datetime.fromtimestamp(settled_at_s, UTC).isoformat()
    )
    state["quality"] = quality
    state["health"] = "stale" if latest.is_stale else latest.document("health").get("state")
    if alarms := latest.document("alarms"):
        words = [f"{alarm['severity']} {alarm['id']}: {alarm['reason']}" for alarm in alarms["alarms"]]
        state["alarms"], state["alarm"] = len(words), (words or ["none"])[0][:_LONGEST]
    return state


def _nut_m(latest: Latest) -> float | None:
    """The position of the first nut: NaN while unknown, None where there is none."""
    sources = latest.document("config").get("config", {}).get("source", ())
    channel = next((s["position_channel"] for s in sources if s.get("position_channel")), None)
    if channel is None:
        return None
    value = latest.document("readings").get("channels", {}).get(channel, {})
    usable = value.get("quality") == "good" and value.get("value") is not None
    return float(value["value"]) if usable else float("nan")


def encoded(document: dict[str, Any]) -> bytes:
    """Return a document as it is published."""
    return json.dumps(document, ensure_ascii=False).encode()


def _identity(start: Start) -> str:
    return f"ballscrew_{_plain(start.machine)}_{_plain(start.axis)}"


def _plain(name: str) -> str:
    """A name as Home Assistant accepts it in topics, ids and templates."""
    return _STRANGE.sub("_", name).replace("-", "_")


class HomeAssistantEntry:
    """What is to be published for Home Assistant: description and state where they changed, once a second."""

    def __init__(self, wanted: bool | str | None, start: Start, latest: Latest, topic: str) -> None:
        """Take the discovery prefix, None if it is not wanted, and the machine's own topic."""
        self._wanted, self._start, self._latest, self._topic = wanted, start, latest, topic
        self._sent: dict[str, bytes] = {}
        self._looked_s = -math.inf

    def begin(self) -> None:
        """Publish everything again: the broker may have lost it."""
        self._sent, self._looked_s = {}, -math.inf

    def news(self, now_s: float) -> Iterator[tuple[str, bytes]]:
        """Yield topics with the messages to retain there; an empty one removes the old one."""
        if self._wanted is None or now_s - self._looked_s < _EVERY_S:
            return
        self._looked_s = now_s
        for topic, payload in self._messages():
            if self._sent.get(topic) != payload:
                self._sent[topic] = payload
                yield topic, payload

    def _messages(self) -> Iterator[tuple[str, bytes]]:
        described, state_topic = topic_of(self._wanted or True, self._start), state_topic_of(self._topic)
        if self._wanted is False:
            yield described, b""
            yield state_topic, b""
        elif (state := state_of(self._latest)) is not None:
            yield described, encoded(description(self._start, self._topic, state))
            yield state_topic, encoded(state)
