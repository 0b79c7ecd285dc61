"""The subscriber's side: the newest of every message of one axis, and the tables made of them.

Anybody may have sent a message, so nothing is trusted: whatever is not a number is unknown.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import zenoh
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from observer.bus.ask import absent
from observer.bus.codec import decode_estimate
from observer.bus.session import client_config, close_within
from observer.config.publishing import Client

SHOWN = ("estimate", "heat", "field", "error", "learned", "health", "alarms", "truth/heat")
_STYLE = {"good": "green", "degraded": "yellow", "stale": "yellow", "starting": "cyan"}
_COUNTED = ("samples", "drops", "errors", "reconnects")
_OFF = {"released", "not_zeroed"}
"""The kinds of conditions by which the compensation is off."""
_BLOCKS = "▁▂▃▄▅▆▇█"
_UNKNOWN = "–"
_SILENT_S = 3.0
_LONGEST_TEXT = 200
_LONGEST_LIST = 400
_LARGEST = 1e12  # no number of a screw is larger


class Subscription:
    """Subscribes to one axis and keeps, per key, only the newest message: a slow reader is never behind.

    It is a context manager. A message that has not been renewed for 3 s, nor for three times its usual
    period, is shown as `stale`. Leaving closes the session within a second.

    Args:
        connect: Endpoints, of which one has to answer.
        machine: The machine's name; may be `*`.
        axis: The axis' name; may be `*`.
        client: Certificates and login; None without.

    Raises:
        ConfigError: If a file of keys or passwords cannot be used.
        zenoh.ZError: On entering, if no router or peer answers.
    """

    def __init__(
        self, connect: tuple[str, ...], machine: str, axis: str, client: Client | None = None
    ) -> None:
        self._asked = (", ".join(connect), machine, axis)
        self._prefix = f"ballscrew/{machine}/{axis}"
        self._config = client_config(connect, client)
        self._latest: dict[str, dict[str, Any]] = {}
        self._arrived_s: dict[str, float] = {}
        self._gap_s: dict[str, float] = {}

    def __enter__(self) -> Subscription:
        self._session = zenoh.open(self._config)
        self._channels = {
            key: self._session.declare_subscriber(f"{self._prefix}/{key}", zenoh.handlers.RingChannel(1))
            for key in SHOWN
        }
        return self

    def __exit__(self, *_error: object) -> None:
        close_within(self._session, 1.0)

    def absent(self) -> str | None:
        """Return a sentence with the axes that are there where this one is not; None if it is, or if none is.

        Raises:
            zenoh.ZError: If the session is closed.
        """
        return absent(self._session, *self._asked)

    def latest(self) -> dict[str, dict[str, Any]]:
        """Return the newest message per key, decoded, without waiting.

        A key without a message is missing, and so is one whose last message cannot be decoded. Content is not
        checked: anybody may have sent it.
        """
        now_s = time.monotonic()
        for key, channel in self._channels.items():
            sample = channel.try_recv()
            if sample is None:
                continue
            self._gap_s[key] = now_s - self._arrived_s.get(key, now_s)
            self._arrived_s[key] = now_s
            message = message_of(key, sample.payload.to_bytes())
            if message is None:
                self._latest.pop(key, None)
            else:
                self._latest[key] = message
        return {key: self._marked(key, message, now_s) for key, message in self._latest.items()}

    def _marked(self, key: str, message: dict[str, Any], now_s: float) -> dict[str, Any]:
        """The message, as stale where it should have been renewed by now."""
        if now_s - self._arrived_s[key] <= max(_SILENT_S, 3 * self._gap_s[key]):
            return message
        return message | {"quality": "stale", "state": "stale", "reasons": ["nothing heard from the service"]}


def message_of(key: str, data: bytes) -> dict[str, Any] | None:
    """Return a message from its bytes.

    Args:
        key: `estimate` for CBOR, any other for JSON.
        data: The bytes, of any content.

    Returns:
        An object of unchecked content; None if the bytes are something else.
    """
    try:
        message = decode_estimate(data) if key == "estimate" else json.loads(data)
    except (ValueError, RecursionError, OverflowError, MemoryError):
        return None
    return message if isinstance(message, dict) else None


def live_table(latest: Mapping[str, Mapping[str, Any]]) -> RenderableType:
    """Return the live view: heats, field, thermal error, sensors, quality and reasons.

    Heats stand beside their truth where a simulator publishes it. Missing messages leave dashes.

    Args:
        latest: The newest message of each key, as `Subscription.latest` returns them.
    """
    heat, health = latest.get("heat", {}), latest.get("health", {})
    quality = _quality(latest)
    title = _headline(quality, health, heat)
    parts: list[RenderableType] = [title, _heats(heat, latest.get("truth/heat", {}))]
    parts += [_profile(latest.get("field", {}), "field", "temperature_degC", "sigma_K", "°C")]
    if "error" in latest:
        parts += [_profile(latest["error"], "error", "error_um", "sigma_um", "µm"), *_force(latest["error"])]
    parts += [_sensors(latest.get("estimate", {}))]
    if "learned" in latest:
        parts += [_learned(latest["learned"])]
    return Group(*parts, *_reasons(health), *_alarms(latest.get("alarms", {})))


def health_table(
    health: Mapping[str, Any], alarms: Mapping[str, Any], axis: str, now_s: float
) -> RenderableType:
    """Return a health report for people: state, reasons, remedies, channels and drivers, and its age.

    Args:
        health: The document of the key `health`.
        alarms: The document of the key `alarms`; may be empty.
        axis: Machine and axis, for the title.
        now_s: The present time in s since 1970.
    """
    quality, time_s = _word(health.get("quality")), _float(health.get("time_s"))
    title = Text(f"{_word(axis)}   ")
    title.append_text(_headline(quality, health, health))
    if time_s is not None:
        title.append(f"   {max(now_s - time_s, 0.0):.0f} s ago", style="dim")
    channels, drivers = (
        _plain(name)
        for name in (("channel", "quality", "age, s", "fault"), ("driver", "connected", *_COUNTED))
    )
    for name, channel in _tables(health.get("channels")):
        shown = Text(_word(channel.get("quality")), style=_style(_word(channel.get("quality"))))
        fault = Text(_word(channel.get("fault") or ""))
        channels.add_row(Text(name), shown, _number(_float(channel.get("age_s")), 1), fault)
    for name, driver in _tables(health.get("drivers")):
        is_connected = driver.get("connected") is True
        words = "yes" if is_connected else "silent" if driver.get("state") == "silent" else "no"
        connected = Text(words, style="green" if is_connected else "red")
        drivers.add_row(Text(name), connected, *(_number(_float(driver.get(key)), 0) for key in _COUNTED))
    recording = Text(f"recording  {_word(health.get('recording'))}", style="dim")
    return Group(title, *_reasons(health), *_alarms(alarms), channels, drivers, recording)


def _headline(quality: str, health: Mapping[str, Any], counted: Mapping[str, Any]) -> Text:
    """The quality of the estimates, the state of the service, and whether the compensation is off."""
    words = f"estimates: {quality}{accuracy(quality, health)}{without_sensors(health, counted)}"
    title = Text(words, style=_style(quality))
    if health:
        state = _word(health.get("state"))
        title.append(f"   service: {state}", style=_style(state))
    kinds = {_word(_table(condition).get("kind")) for condition in _items(health.get("conditions"))}
    if kinds & _OFF:
        title.append("   compensation: off", style="yellow")
    return title


def _quality(latest: Mapping[str, Mapping[str, Any]]) -> str:
    """The quality of the thermal error, else that of the field or the heats, from the newest messages."""
    rated = latest.get("error") or latest.get("field") or latest.get("heat", {})
    return _word(rated.get("quality", "starting"))


def accuracy(quality: str, health: Mapping[str, Any]) -> str:
    """The uncertainty of the thermal error at the nut in a good estimate; empty if it was not published.

    Args:
        quality: The quality of the estimates.
        health: The health report; half of the 95 % interval is its `error_known_to_um`.
    """
    known_to_um = _float(health.get("error_known_to_um"))
    return f" to ±{known_to_um:.0f} µm at the nut" if quality == "good" and known_to_um is not None else ""


def without_sensors(health: Mapping[str, Any], counted: Mapping[str, Any]) -> str:
    """Return the sensors that an estimate does not use, by the counts of a message.

    Args:
        health: The health report, which names them.
        counted: A message with `sensors_used` and `sensors`.

    Returns:
        The end of a sentence; empty if the estimate uses all sensors or the counts are missing.
    """
    used, sensors = _float(counted.get("sensors_used")), _float(counted.get("sensors"))
    if used is None or sensors is None or used >= sensors:
        return ""
    names = ", ".join(_word(name) for name in _items(health.get("degraded_sensors")))
    return f", but without {names or 'some'} ({used:.0f} of {sensors:.0f} sensors)"


def _plain(heads: Sequence[str]) -> Table:
    """A table without lines."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for i, head in enumerate(heads):
        table.add_column(
            head,
            overflow="fold",
            justify="right" if head in ("age, s", *_COUNTED) else "left",
            no_wrap=i == 0,
        )
    return table


def _reasons(health: Mapping[str, Any]) -> list[Text]:
    return [Text(f"• {_word(reason)}", style="yellow") for reason in _items(health.get("reasons"))]


def _alarms(document: Mapping[str, Any]) -> list[Text]:
    """A line for each alarm: severity, state and reason; below it the remedy."""
    lines = []
    for alarm in map(_table, _items(document.get("alarms"))):
        severity, state = _word(alarm.get("severity")), _word(alarm.get("state"))
        line = f"▲ {severity} {_word(alarm.get('id'))} ({state}): {_word(alarm.get('reason'))}"
        lines.append(Text(line, style="yellow" if severity == "minor" else "red"))
        if isinstance(remedy := alarm.get("remedy"), str):
            lines.append(Text(f"  to do: {_word(remedy)}"))
    bands = _table(document.get("bands")).items()
    learning = [
        f"{_word(n)} {_word(b['learning'])}" for n, b in bands if isinstance(b, dict) and b.get("learning")
    ]
    if learning:
        lines.append(Text("usual heats, still being learnt: " + ", ".join(learning), style="dim"))
    lines += [
        Text(f"heat of {_word(name)}: {_word(band['unsure'])}", style="yellow")
        for name, band in bands
        if isinstance(band, dict) and band.get("unsure") and not band.get("learning")
    ]
    return lines


def _style(quality: str) -> str:
    return _STYLE.get(quality, "red")


def _word(value: object) -> str:
    """A text of limited length without control characters."""
    if not isinstance(value, str):
        return _UNKNOWN
    return "".join(c for c in value[:_LONGEST_TEXT] if c.isprintable())


def _items(value: object) -> Sequence[Any]:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    return value[:_LONGEST_LIST] if isinstance(value, list) else ()


def _table(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _tables(value: object) -> list[tuple[str, Mapping[str, Any]]]:
    """Tables by their names."""
    return [(_word(name), _table(entry)) for name, entry in list(_table(value).items())[:_LONGEST_LIST]]


def _float(value: object) -> float | None:
    """A finite number, or None."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if abs(number) < _LARGEST else None  # not NaN either


def _sources(document: Mapping[str, Any], key: str) -> dict[str, float | None]:
    """One number of each source."""
    sources = list(_table(document.get("sources")).items())[:_LONGEST_LIST]
    return {_word(name): _float(_table(entry).get(key)) for name, entry in sources}


def _heats(heat: Mapping[str, Any], truth: Mapping[str, Any]) -> Table:
    """One row per source; the truth, and its distance from the estimate in σ, if a simulator publishes it."""
    true_W = _sources(truth, "heat_W")
    sigma_W = _sources(heat, "sigma_W")
    table = Table("source", *(["heat, W", "± σ, W"] + (["truth, W", "off, σ"] if true_W else [])))
    for name, value in _sources(heat, "heat_W").items():
        sigma, true = sigma_W.get(name), true_W.get(name)
        cells = [_number(value, 2), _number(sigma, 2)]
        if true_W:
            off = (value - true) / sigma if value is not None and true is not None and sigma else None
            cells += [_number(true, 2), _number(off, 1)]
        table.add_row(Text(name), *cells)
    return table


def _profile(document: Mapping[str, Any], name: str, key: str, sigma: str, unit: str) -> Text:
    """A curve over the screw as a row of bars, coloured from cold to hot, with its range."""
    curve = [_float(v) for v in _items(document.get(key))]
    values = [v for v in curve if v is not None]
    if not values:
        return Text(f"{name}: {_UNKNOWN}")
    low, high = min(values), max(values)
    span = max(high - low, 1e-9)
    text = Text(f"{name:6}")
    for value in curve:
        share = 0.0 if value is None else (value - low) / span
        red = round(255 * share)
        bar = " " if value is None else _BLOCKS[round(share * (len(_BLOCKS) - 1))]
        text.append(bar, style=f"rgb({red},90,{255 - red})")
    sigmas = [s for v in _items(document.get(sigma)) if (s := _float(v)) is not None]
    text.append(f"  {low:.2f} … {high:.2f} {unit}")
    if sigmas:
        text.append(f"  σ ≤ {max(sigmas):.2f}")
    return text


def _force(document: Mapping[str, Any]) -> list[Text]:
    """The axial force of a screw that is held at both ends."""
    force_N, sigma_N = _float(document.get("force_N")), _float(document.get("force_sigma_N"))
    return [] if force_N is None or sigma_N is None else [Text(f"force {force_N:.0f} N  σ {sigma_N:.0f}")]


def _sensors(estimate: Mapping[str, Any]) -> Table:
    """One row per sensor: its quality and its innovation."""
    moved = _items(estimate.get("displacements"))
    table = Table("sensor", "quality", "residual, K or µm" if moved else "residual, K")
    rows = zip(
        _items(estimate.get("sensors")),
        _items(estimate.get("sensor_quality")),
        _items(estimate.get("innovation_K")),
        strict=False,
    )
    for name, quality, innovation in rows:
        shown = Text(_word(quality), style=_style(_word(quality)))
        table.add_row(Text(_word(name)), shown, _number(_float(innovation), 3))
    return table


def _learned(document: Mapping[str, Any]) -> Text:
    """The learnt parameters in one paragraph, value ± σ of each."""
    learned = [
        f"{_word(name)} {_short(_table(entry).get('value'))} ± {_short(_table(entry).get('sigma'))}"
        for name, entry in list(_table(document.get("parameters")).items())[:_LONGEST_LIST]
    ]
    return Text("learnt: " + (", ".join(learned) or _UNKNOWN))


def _short(value: object) -> str:
    """A number of three digits."""
    number = _float(value)
    return _UNKNOWN if number is None else f"{number:.3g}"


def _number(value: float | None, digits: int) -> str:
    return _UNKNOWN if value is None else f"{value:.{digits}f}"


def live_line(latest: Mapping[str, Mapping[str, Any]]) -> str:
    """The heats in one line, beside their truth where it is published; empty before the first estimate.

    A terminal without a screen gets this line instead of the table.

    Args:
        latest: The newest message of each key, as `Subscription.latest` returns them.
    """
    heat = latest.get("heat", {})
    if not heat:
        return ""
    truth_W, sigma_W = _sources(latest.get("truth/heat", {}), "heat_W"), _sources(heat, "sigma_W")
    parts = []
    for name, value in _sources(heat, "heat_W").items():
        text = f"{name} {_number(value, 2)} ± {_number(sigma_W.get(name), 2)} W"
        if name in truth_W:
            text += f" (truth {_number(truth_W[name], 2)})"
        parts.append(text)
    field = [_float(t) for t in _items(latest.get("field", {}).get("temperature_degC"))]
    hottest = max((t for t in field if t is not None), default=None)
    health, quality = latest.get("health", {}), _quality(latest)
    quality = f"{quality}{accuracy(quality, health)}{without_sensors(health, heat)}"
    return f"{quality}: {', '.join(parts)}; hottest {_number(hottest, 1)} °C"
