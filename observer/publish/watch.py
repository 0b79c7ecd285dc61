"""The subscriber's side: the newest of every message of one axis, and the live table made of it."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any

import zenoh
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from observer.publish.codec import decode_estimate
from observer.publish.zenoh import close_within, session_config

KEYS = ("estimate", "heat", "field", "error", "health", "truth/heat")
_STYLE = {"good": "green", "degraded": "yellow", "stale": "yellow", "starting": "cyan"}
_BLOCKS = "▁▂▃▄▅▆▇█"
_UNKNOWN = "–"
_SILENT_S = 3.0


class Subscription:
    """Subscribes to one axis and keeps, per key, only the newest message: a slow reader is never behind.

    What has not been renewed for 3 s, nor for three times its usual gap, is shown as `stale`. `machine` and
    `axis` may be `*`. Entering raises `zenoh.ZError` where no router or peer answers.
    """

    def __init__(self, connect: tuple[str, ...], machine: str, axis: str) -> None:
        self._prefix = f"ballscrew/{machine}/{axis}"
        self._connect = connect
        self._latest: dict[str, dict[str, Any]] = {}
        self._arrived_s: dict[str, float] = {}
        self._gap_s: dict[str, float] = {}

    def __enter__(self) -> Subscription:
        self._session = zenoh.open(session_config("client", self._connect, ()))
        self._channels = {
            key: self._session.declare_subscriber(f"{self._prefix}/{key}", zenoh.handlers.RingChannel(1))
            for key in KEYS
        }
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        close_within(self._session, 1.0)

    def latest(self) -> dict[str, dict[str, Any]]:
        """The newest message per key, decoded; a message that cannot be decoded is left out."""
        now_s = time.monotonic()
        for key, channel in self._channels.items():
            sample = channel.try_recv()
            if sample is None:
                continue
            self._gap_s[key] = now_s - self._arrived_s.get(key, now_s)
            self._arrived_s[key] = now_s
            data = sample.payload.to_bytes()
            try:
                self._latest[key] = decode_estimate(data) if key == "estimate" else json.loads(data)
            except ValueError:
                self._latest.pop(key, None)
        return {key: self._marked(key, message, now_s) for key, message in self._latest.items()}

    def _marked(self, key: str, message: dict[str, Any], now_s: float) -> dict[str, Any]:
        """The message, as stale where it should have been renewed by now."""
        if now_s - self._arrived_s[key] <= max(_SILENT_S, 3 * self._gap_s[key]):
            return message
        return message | {"quality": "stale", "state": "stale", "reasons": ["nothing heard from the service"]}


def live_table(latest: Mapping[str, Mapping[str, Any]]) -> RenderableType:
    """Heats beside their truth where it is published, field, thermal error, sensors, quality and reasons."""
    heat, health = latest.get("heat", {}), latest.get("health", {})
    quality = str(heat.get("quality", "starting"))
    title = Text(f"quality {quality}", style=_style(quality))
    if health:
        title.append(f"   service {health.get('state')}", style=_style(str(health.get("state"))))
    parts: list[RenderableType] = [title, _heats(heat, latest.get("truth/heat", {}))]
    parts += [_profile(latest.get("field", {}), "field", "temperature_degC", "sigma_K", "°C")]
    if "error" in latest:
        parts += [_profile(latest["error"], "error", "error_um", "sigma_um", "µm")]
    parts += [_sensors(latest.get("estimate", {}))]
    parts += [Text(f"• {reason}", style="yellow") for reason in health.get("reasons", ())]
    return Group(*parts)


def _style(quality: str) -> str:
    return _STYLE.get(quality, "red")


def _heats(heat: Mapping[str, Any], truth: Mapping[str, Any]) -> Table:
    """One row per source; the truth, and how many σ the estimate is from it, where a simulator tells it."""
    true_W = {name: entry.get("heat_W") for name, entry in truth.get("sources", {}).items()}
    table = Table("source", *(["heat, W", "± σ, W"] + (["truth, W", "off, σ"] if true_W else [])))
    for name, entry in heat.get("sources", {}).items():
        value, sigma = entry.get("heat_W"), entry.get("sigma_W")
        cells = [name, _number(value, 2), _number(sigma, 2)]
        if true_W:
            true = true_W.get(name)
            known = None not in (value, sigma, true) and sigma
            cells += [_number(true, 2), _number((value - true) / sigma if known else None, 1)]
        table.add_row(*cells)
    return table


def _profile(document: Mapping[str, Any], name: str, key: str, sigma: str, unit: str) -> Text:
    """A curve over the screw as a row of bars, coloured from cold to hot, with its range."""
    values = [v for v in document.get(key, ()) if v is not None]
    if not values:
        return Text(f"{name}: {_UNKNOWN}")
    low, high = min(values), max(values)
    span = max(high - low, 1e-9)
    text = Text(f"{name:6}")
    for value in document[key]:
        share = 0.0 if value is None else (value - low) / span
        red = round(255 * share)
        bar = " " if value is None else _BLOCKS[round(share * (len(_BLOCKS) - 1))]
        text.append(bar, style=f"rgb({red},90,{255 - red})")
    sigmas = [s for s in document.get(sigma, ()) if s is not None]
    text.append(f"  {low:.2f} … {high:.2f} {unit}")
    if sigmas:
        text.append(f"  σ ≤ {max(sigmas):.2f}")
    return text


def _sensors(estimate: Mapping[str, Any]) -> Table:
    """One row per thermocouple: its quality and how far it was from what the model expected."""
    table = Table("sensor", "quality", "innovation, K")
    rows = zip(
        estimate.get("sensors", ()),
        estimate.get("sensor_quality", ()),
        estimate.get("innovation_K", ()),
        strict=False,
    )
    for name, quality, innovation_K in rows:
        table.add_row(name, Text(quality, style=_style(quality)), _number(float(innovation_K), 3))
    return table


def _number(value: float | None, digits: int) -> str:
    return _UNKNOWN if value is None or math.isnan(value) else f"{value:.{digits}f}"


def live_line(latest: Mapping[str, Mapping[str, Any]]) -> str:
    """The heats in one line, beside their truth where it is published; empty before the first estimate."""
    heat, truth = latest.get("heat", {}), latest.get("truth/heat", {}).get("sources", {})
    if not heat:
        return ""
    parts = []
    for name, entry in heat.get("sources", {}).items():
        text = f"{name} {_number(entry.get('heat_W'), 2)} ± {_number(entry.get('sigma_W'), 2)} W"
        if name in truth:
            text += f" (truth {_number(truth[name].get('heat_W'), 2)})"
        parts.append(text)
    hottest = max(
        (t for t in latest.get("field", {}).get("temperature_degC", ()) if t is not None), default=None
    )
    return f"{heat.get('quality')}: {', '.join(parts)}; hottest {_number(hottest, 1)} °C"


def ask_health(connect: str, machine: str, axis: str, timeout_s: float) -> dict[str, Any] | None:
    """Ask a running service for its health; None where none answers in time."""
    return _ask(connect, f"ballscrew/{machine}/{axis}/health", timeout_s)


def arm_compensation(connect: str, machine: str, axis: str, timeout_s: float) -> dict[str, Any] | None:
    """Arm the compensation of a running service; returns what it says then, None where none answers in time.

    Whether it is armed stands in the document: an estimate that is not good refuses.
    """
    key = f"ballscrew/{machine}/{axis}/compensation"
    until_s = time.monotonic() + timeout_s
    asked = _ask(connect, f"{key}?arm=yes", timeout_s)
    document = asked
    while asked and document and not document["armed"] and document["sequence"] <= asked["sequence"] + 1:
        if time.monotonic() >= until_s:
            break
        time.sleep(0.1)
        document = _ask(connect, key, until_s - time.monotonic())
    return document


def _ask(connect: str, selector: str, timeout_s: float) -> dict[str, Any] | None:
    """Ask a service; None where none answers in time."""
    until_s = time.monotonic() + timeout_s
    while time.monotonic() < until_s:
        try:
            session = zenoh.open(session_config("client", (connect,), ()))
        except zenoh.ZError:
            time.sleep(0.2)
            continue
        try:
            replies = session.get(selector, timeout=max(0.1, until_s - time.monotonic()))
            for reply in replies:
                if reply.ok is not None:
                    document: dict[str, Any] = json.loads(reply.ok.payload.to_bytes())
                    return document
        finally:
            close_within(session, 1.0)
        time.sleep(0.2)
    return None
