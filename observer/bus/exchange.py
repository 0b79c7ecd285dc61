"""Shared by service, publisher and outlets: the published keys, commands and their outcomes, the status."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Protocol, get_args

from observer.units import BY_SUFFIX, unit_of

ESTIMATE_ENCODING = "application/cbor;ballscrew.estimate.v1"
ESTIMATES_ENCODING = "application/cbor;ballscrew.estimates.v1"
PAGE_ENCODING = "application/cbor;ballscrew.page.v1"
JSON_ENCODING = "application/json"
Severity = Literal["minor", "major", "invalid"]
"""The severities of EPICS, by rank; a value under an *invalid* alarm cannot be used at all."""
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
AlarmState = Literal["pending", "unacknowledged", "acknowledged", "returned"]


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """A value of a document, or one for each entry of a table, as metrics, OPC UA and the page show it.

    Attributes:
        path: Leads to the value, its names separated by dots; `*` is every entry of a table.
        words: Describe it, a sentence.
        metric: Its name for Prometheus after `ballscrew_`; None for no metric. Text counts as 1 if it is
            `good`, else 0.
        node: Its place in OPC UA below the axis, `{}` the entry's name; None for no node. Without `{}` a
            column is one array.
        by: In a document of columns, the column of their names; None for others.
        label: The label of the metric that has the entry's name.
        labelled: Whether the metric also has the document's quality as a label.
        counter: Whether the value only grows.
        used: The column of qualities by which OPC UA marks single values; None for none.
        part: The part of an estimate whose quality is the figure's; empty where the whole counts.
    """

    path: str
    words: str
    metric: str | None = None
    node: str | None = None
    by: str | None = None
    label: str = "name"
    labelled: bool = True
    counter: bool = False
    used: str | None = None
    part: str = ""

    @property
    def factor(self) -> float:
        """From the document's unit, which ends the path, to the metric's base unit."""
        unit = BY_SUFFIX.get(unit_of(self.path))
        return 1.0 if unit is None else unit.size

    def quality(self, document: Mapping[str, Any]) -> str | None:
        """Return the quality of the figure in a message: that of its part where the message rates parts.

        Returns:
            None for a message without any quality.
        """
        quality: str | None = document.get(f"{self.part}_quality", document.get("quality"))
        return quality

    def rows(self, document: Mapping[str, Any]) -> list[tuple[str, Any]]:
        """Return the values in a document with the names of their entries.

        Returns:
            Pairs of name and value. The name is empty for a single value, a position has four digits, and the
                value is None where it is unknown. A document without the figure has no pairs.
        """
        if self.by is not None:
            names, values = document.get(self.by, ()), document.get(self.path, ())
            return [(_entry(name), value) for name, value in zip(names, values, strict=False)]
        tables: list[tuple[str, Any]] = [("", document)]
        for part in self.path.split("."):
            if part == "*":
                tables = [row for _, table in tables for row in table.items()]
            else:
                tables = [(name, table[part]) for name, table in tables if part in table]
        return tables


def _entry(name: Any) -> str:
    """Return the label of an entry: its name, or its position with four digits."""
    return name if isinstance(name, str) else f"{float(name):.4g}"


@dataclass(frozen=True, slots=True)
class Key:
    """A key below `ballscrew/<machine>/<axis>/`.

    Attributes:
        holds: Describes its payload.
        sent: Describes when it is published; None for one that only answers.
        rate_Hz: Largest rate of one made of each step, or the name of that setting in `[publish]`; None for
            every step.
        encoding: Of its payload.
        query_answer: Describes the answer to a query of any role that may query (`publish.session`); None if
            there is no answer.
        retained: Whether an MQTT broker, and outlets that start late, get its last message at once.
        needs: What the service must have for the key to exist; None for every service.
        rated: Whether its `quality` is that of its figures.
        page_every_s: Least interval at which the page shows it.
        panel: Whether the page has a panel for it; if not, its figures are in a table.
        figures: The values that metrics, OPC UA and the page show.
    """

    holds: str
    sent: str | None
    rate_Hz: float | str | None = None
    encoding: str = JSON_ENCODING
    query_answer: str | None = None
    retained: bool = False
    needs: Literal["expansion", "learned", "compensation", "forecast", "probing"] | None = None
    rated: bool = False
    page_every_s: float = 0.0
    panel: bool = False
    figures: tuple[KeyFigure, ...] = ()


def _of_sources(path: str, words: str, metric: str, leaf: str) -> KeyFigure:
    node = f"Heat/{{}}/{leaf}"
    return KeyFigure(path, words, metric, node, by="sources", label="source", part="heat")


def _along(path: str, words: str, metric: str, node: str) -> KeyFigure:
    part = path.partition("_")[0]
    return KeyFigure(path, words, metric, node, by="position_m", label="position_m", part=part)


_SENSOR: dict[str, Any] = {"by": "sensors", "label": "sensor"}
_LEARNED: dict[str, Any] = {"label": "parameter", "labelled": False}
_IN_ITS_UNIT = "What has been learnt, in the unit of its name."
_LAST = "the last document"

KEYS = {
    "estimate": Key(
        "CBOR, encoding `application/cbor;ballscrew.estimate.v1`: everything a step returns",
        "every step",
        encoding=ESTIMATE_ENCODING,
        query_answer="the last estimate; `?last=N` an array of the last N, encoding "
        "`application/cbor;ballscrew.estimates.v1`; `?from=…;to=…` those of [a time](#the-past)",
        rated=True,
        page_every_s=0.09,
        panel=True,
        figures=(
            _of_sources("heat_W", "Heat that enters the screw.", "heat_watts", "Heat_W"),
            _of_sources("heat_sigma_W", "Its standard deviation.", "heat_sigma_watts", "Sigma_W"),
            _of_sources("heat_bound_W", "Its bound.", "heat_bound_watts", "Bound_W"),
            _of_sources("law_W", "The heat by its law.", "heat_law_watts", "Law_W"),
            KeyFigure("position_m", "Where field and error are.", node="Field/Position_m", by="position_m"),
            _along("field_degC", "Temperature.", "temperature_celsius", "Field/Temperature_degC"),
            _along("field_sigma_K", "Its sigma.", "temperature_sigma_celsius", "Field/Sigma_K"),
            _along("field_bound_K", "Its bound.", "temperature_bound_celsius", "Field/Bound_K"),
            _along("error_um", "Thermal error.", "error_meters", "Error/Error_um"),
            _along("error_sigma_um", "Its sigma.", "error_sigma_meters", "Error/Sigma_um"),
            _along("error_bound_um", "Its bound.", "error_bound_meters", "Error/Bound_um"),
            KeyFigure(
                "innovation_K", "Reading less expected.", "innovation_celsius", "Sensors/{}/Innovation_K",
                used="sensor_quality", **_SENSOR,
            ),
            KeyFigure(
                "sensor_quality", "Whether the reading was used.", "sensor_good", "Sensors/{}/Quality",
                labelled=False, **_SENSOR,
            ),
        ),
    ),
    "readings": Key(
        "JSON: what the estimate was made of, each channel with its quality and age",
        "every step",
        query_answer="the last document; `?from=…;to=…` those of [a time](#the-past)",
        page_every_s=0.09,
        panel=True,
    ),
    "heat": Key(
        "JSON: heat, sigma and bound of each source",
        "every step",
        rated=True,
        page_every_s=0.09,
        panel=True,
        figures=(
            KeyFigure(
                "sensors_used", "Sensors that the estimate uses.", "sensors_used", "SensorsUsed",
                labelled=False,
            ),
            KeyFigure("sensors", "Configured sensors.", "sensors", "SensorsConfigured", labelled=False),
        ),
    ),
    "field": Key(
        "JSON: temperature, sigma and bound at each grid point",
        "at most `field_rate_Hz`",
        "field_rate_Hz",
        rated=True,
        page_every_s=0.45,
        panel=True,
    ),
    "error": Key(
        "JSON: thermal error, sigma and bound at each grid point",
        "at most `field_rate_Hz`, with an expansion coefficient",
        "field_rate_Hz",
        needs="expansion",
        rated=True,
        page_every_s=0.45,
        panel=True,
    ),
    "learned": Key(
        "JSON: what has been [learnt](../explanation/learning.md) of the machine, each with its sigma",
        "once a second, if anything is",
        1.0,
        retained=True,
        needs="learned",
        rated=True,
        panel=True,
        figures=(
            KeyFigure("parameters.*.value", _IN_ITS_UNIT, "learned", "Learned/{}/Value", **_LEARNED),
            KeyFigure("parameters.*.sigma", _IN_ITS_UNIT, "learned_sigma", "Learned/{}/Sigma", **_LEARNED),
        ),
    ),
    "health": Key(
        "JSON: state, reasons, quality and age of each channel, counts",
        "on change, and every 5 s",
        query_answer="the last report; this is what `observer health` asks",
        retained=True,
        panel=True,
        figures=(
            KeyFigure("state", "The state of the service.", node="Health/State"),
            KeyFigure("reasons", "What is wrong.", node="Health/Reasons"),
            KeyFigure("degraded_sensors", "Sensors that are not used.", node="Health/DegradedSensors"),
            KeyFigure("cycles", "Steps of the estimator.", "cycles", counter=True),
            KeyFigure("overruns", "Steps left out because the computer was late.", "overruns", counter=True),
            KeyFigure("published", "Messages that went to Zenoh.", "published", counter=True),
            KeyFigure("publish_drops", "Messages that could not go to Zenoh.", "publish_drops", counter=True),
            KeyFigure("unsent.*.steps", "Steps kept to be sent late.", "unsent_steps", label="outlet"),
            KeyFigure("recorded", "Rows that were recorded.", "recorded", counter=True),
            KeyFigure("record_drops", "Rows that could not be recorded.", "record_drops", counter=True),
            KeyFigure("drivers.*.errors", "Failed polls.", "driver_errors", label="driver", counter=True),
            KeyFigure(
                "drivers.*.reconnects", "Connections after the first.", "driver_reconnects", label="driver",
                counter=True,
            ),
            KeyFigure(
                "drivers.*.error_frames", "Error frames of a CAN bus.", "driver_error_frames", label="driver",
                counter=True,
            ),
            KeyFigure(
                "drivers.*.bus_off", "Reports of a CAN bus that its interface is off.", "driver_bus_off",
                label="driver", counter=True,
            ),
            KeyFigure(
                "channels.*.age_s", "Age of the last usable value.", "channel_age_seconds", label="channel"
            ),
        ),
    ),
    "alarms": Key(
        "JSON: what somebody should [come and look for](../explanation/alarms.md), and each heat compared "
        "with what was learnt of it",
        "on change, and every 5 s, if enabled",
        query_answer=_LAST,
        retained=True,
        panel=True,
    ),
    "forecast": Key(
        "JSON: temperatures and thermal error of the next hour with σ, where it settles (`settled_degC`, "
        "`settled_error_um`, with σ) and when (`settled_at_s`, with 95 % in `settled_between_s`) "
        "([how](../explanation/forecast.md))",
        "every minute, unless off",
        query_answer=_LAST,
        retained=True,
        needs="forecast",
        rated=True,
        panel=True,
        figures=(
            KeyFigure(
                "settled_at_s", "When it will have settled.", "forecast_settled_timestamp_seconds",
                "Forecast/SettledAt_s",
            ),
        ),
    ),
    "probing": Key(
        "JSON: whether to [probe now](../how-to/probe.md#probe-now) (`probe_now`): the thermal "
        "error is known to `within_um` at worst, the part needs `needs_um`, and probing would leave "
        "`after_um`",
        "every 5 s, with a displacement sensor and what the part needs",
        query_answer=_LAST,
        retained=True,
        needs="probing",
        rated=True,
        figures=(
            KeyFigure("probe_now", "Whether to probe now.", node="Probing/ProbeNow"),
            KeyFigure(
                "within_um", "What the error is known to.", "error_within_meters", "Probing/Within_um",
            ),
            KeyFigure(
                "after_um", "And after a probing.", "error_after_probing_meters", "Probing/After_um",
            ),
        ),
    ),
    "compensation": Key(
        "JSON: table and line for a control, and whether they may be used "
        "([how to](../how-to/compensate.md))",
        "every step, if enabled",
        query_answer=_LAST,
        retained=True,
        needs="compensation",
        rated=True,
        panel=True,
        figures=(
            KeyFigure(
                "armed", "Whether the compensation is armed.", "compensation_armed", "Compensation/Armed",
                labelled=False,
            ),
            KeyFigure(
                "phase", "What it does: following, holding, releasing or off.", node="Compensation/Phase"
            ),
        ),
    ),
    "config": Key(
        'JSON `{"hash", "instance", "config"}`: the configuration in force and its hash, '
        "without credentials",
        None,
        query_answer="the configuration",
        retained=True,
        panel=True,
    ),
}  # fmt: skip
"""Everything that publisher, outlets, MQTT, metrics, OPC UA, page and reference page need to know of a key,
except the code that makes its document.
"""
RETAINED = tuple(name for name, key in KEYS.items() if key.retained)

KINDS = ("arm", "disarm", "zero", "reset", "acknowledge")
_STRANGE = re.compile(r"[^A-Za-z0-9_.@-]")
_NAME_LENGTH = 64


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a command.

    Attributes:
        done: Whether it was done.
        text: Why or why not, in words.
        time_s: When, in the service's time, s since 1970.
    """

    done: bool
    text: str
    time_s: float


@dataclass(frozen=True, slots=True)
class Command:
    """A command to the service.

    Attributes:
        kind: One of `KINDS`.
        by: The sender's name, as they call themselves.
        asked_s: When it came, on the monotonic clock.
        answer: Takes the outcome, from any thread, and waits for nothing.
        refused: The reason if it was rejected already and is only to be recorded; else None.
        about: The alarm that is acknowledged; None for all.
        without: The sensors that arming may do without.
    """

    kind: str
    by: str
    asked_s: float
    answer: Callable[[Outcome], None]
    refused: str | None = None
    about: str | None = None
    without: tuple[str, ...] = ()


def plain_name(text: str, most: int = _NAME_LENGTH) -> str:
    """Return a name safe for a log: at most `most` letters, digits and `_.@-`, others replaced by `_`."""
    return _STRANGE.sub("_", text[:most])


class PastReply(NamedTuple):
    """An answer about the past.

    Attributes:
        payload: The page; empty without one.
        reason: Why there is no page, a sentence; None with one.
    """

    payload: bytes
    reason: str | None = None


class PastAccess(Protocol):
    """Access to the past, for the publisher's queries."""

    def ask(self, key: str, parameters: Mapping[str, str]) -> PastReply:
        """Return a page of a key, or the reason for its absence; blocks, and may be called from any
        thread.
        """

    def close(self) -> None:
        """End what runs, and answer no further query."""


@dataclass(frozen=True, slots=True)
class PublishStatus:
    """The state of publishing.

    Attributes:
        connected: Whether a Zenoh session is open.
        published: Messages sent so far.
        dropped: Messages lost so far.
        reconnects: Sessions after the first.
        reason: A sentence on what is wrong; None if nothing is.
        settled: Whether the first attempt at a session has ended.
        taken: A sentence if another service has the axis; else None.
        duplicate: A sentence if another service of the axis runs at once; else None.
        alive: Whether queries are answered.
        unsent: By outlet, what it still has to send late: `steps`, and their `duration_s`.
    """

    connected: bool = False
    published: int = 0
    dropped: int = 0
    reconnects: int = 0
    reason: str | None = None
    settled: bool = True
    taken: str | None = None
    duplicate: str | None = None
    alive: bool = True
    unsent: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
