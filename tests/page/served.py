"""A page of made-up documents."""

from __future__ import annotations

import math
import ssl
import struct
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cbor2

from observer.config.outlets import Page
from observer.outlets.start import Start
from tests.bus.router import free_port
from tests.outlets.feeding import OutletsFeed, fed_outlets
from tests.page.browser import answers
from tests.patience import PATIENCE_S, until

NASTY = "<img src=x onerror=alert(1)> t3 is open"
NOW_S = time.time()
HEAD = {"time_s": NOW_S, "sequence": 7, "instance": "i"}
PLACES_M = [0.0, 0.5, 1.0]
DOCUMENTS: dict[str, Any] = {
    "config": {"config": {
        "source": [{"name": "nut", "position_channel": "nut_position_m", "stroke_m": [0.2, 0.8]}],
        "sensor": [{"name": "t3", "channel": "t3_degC", "position_m": 0.5}],
        "compensation": {"reverse": False, "zero_m": 0.0, "gradient_limit_um_m": 100.0},
    }},
    "readings": {**HEAD, "channels": {
        "t3_degC": {"value": None, "quality": "missing", "age_s": 3.0},
        "nut_position_m": {"value": 0.4, "quality": "good", "age_s": 0.0},
    }},
    "heat": {**HEAD, "sources": {"nut": {"heat_W": 26.54, "sigma_W": 0.61}}, "quality": "degraded"},
    "field": {**HEAD, "position_m": PLACES_M, "temperature_degC": [25.0, None, 27.0], "sigma_K": [0.1] * 3,
              "quality": "degraded"},
    "error": {**HEAD, "position_m": PLACES_M, "error_um": [0.0, 20.0, 41.0], "sigma_um": [1.0] * 3,
              "quality": "degraded"},
    "compensation": {**HEAD, "armed": True, "phase": "following", "reason": None, "hold_reason": None,
                     "released_s": None, "gradient_cut_um": 0.0, "position_m": PLACES_M,
                     "error_um": [0.0, 19.0, 40.0]},
    "health": {"time_s": NOW_S, "state": "degraded", "reasons": [NASTY],
               "channels": {"t3_degC": {"quality": "missing", "age_s": 3.0, "fault": "open circuit"}}},
    "learned": {**HEAD, "parameters": {"surface.convection_W_m2K": {"value": 15.217, "sigma": 0.42}}},
    "alarms": {"time_s": NOW_S, "instance": "i", "alarms": [
        {"id": "sensor.t3.open_circuit", "kind": "open_circuit", "target": "t3", "severity": "major",
         "state": "unacknowledged", "since_s": NOW_S - 60, "reason": NASTY, "remedy": "fix the cable",
         "evidence": None},
    ], "bands": {"nut": {"known": True, "running_h": 30.0, "ratio": 1.12, "sigma": 0.04,
                         "learning": None, "trend_per_day": 0.01},
                 "bearing": {"known": False, "running_h": 12.3, "ratio": None, "sigma": None,
                             "learning": "12.3 of 30 h of running", "trend_per_day": None}}},
    "forecast": {"time_s": NOW_S, "instance": "i", "quality": "good", "reason": None,
                 "program": {"kind": "cycle", "period_s": 600.0, "text": "the last cycle goes on"},
                 "at_s": [NOW_S, NOW_S + 1800, NOW_S + 3600], "position_m": PLACES_M,
                 "temperature_degC": [[25.0] * 3] * 3, "sigma_K": [[0.1] * 3] * 3,
                 "error_um": [[0, 20, 41], [0, 25, 50], [0, 26, 52]], "error_sigma_um": [[0, 1, 2]] * 3,
                 "settled_at_s": NOW_S + 1800,
                 "settled_between_s": [NOW_S + 900, NOW_S + 2700], "settles_within_um": 2.0},
}  # fmt: skip


def estimate(sequence: int, law_W: float = math.nan) -> bytes:
    def typed(value: float) -> cbor2.CBORTag:
        return cbor2.CBORTag(85, struct.pack("<f", value))

    return cbor2.dumps({
        **HEAD, "sequence": sequence, "quality": "degraded", "sources": ["nut"], "heat_W": typed(26.54),
        "law_W": typed(law_W), "sensors": ["t3"], "innovation_K": typed(float("nan")),
        "innovation_sigma_K": typed(0.1), "sensor_quality": ["missing"],
    })  # fmt: skip


@contextmanager
def served_page(
    ca: Path | None = None,
    documents: Mapping[str, Any] = DOCUMENTS,
    law_W: float = math.nan,
    **more: Any,
) -> Iterator[tuple[str, OutletsFeed]]:
    """The process of the outlets with a page of these documents, by TLS where it is given an authority.

    Gives the address of the page, and the bus; `more` are other settings of the start or of the page.
    """
    start = {name: more.pop(name) for name in Start.model_fields if name in more}
    page = Page(listen=f"127.0.0.1:{free_port()}", **more)
    trusted = None if ca is None else ssl.create_default_context(cafile=ca)
    url = f"http{'' if ca is None else 's'}://{page.listen}/"
    with fed_outlets(page=page, stderr=subprocess.PIPE, **start) as feed:
        until(lambda: answers(f"{url}assets/page.css", trusted), PATIENCE_S)
        assert feed.said()["reason"] is None
        send_all(feed, documents, estimate(7, law_W))
        yield url, feed


def send_all(feed: OutletsFeed, documents: Mapping[str, Any], estimate: bytes) -> None:
    """Send all documents of a machine."""
    feed.send("estimate", estimate)
    for key, document in documents.items():
        feed.document(key, document)


LONG = "a_very_long_name_on_the_motor_side_with_its_housing"
SENSORS = [f"{LONG}_{i}" if i == 4 else f"t{i}" for i in range(12)]
SOURCES = ["nut", "left_bearing", LONG, "motor_coupling", "ball_return_tube", "support_unit"]
REASON = f"{LONG}: the reading has not changed for 240 s while the model expects 1.8 K; " * 2 + "w" * 150


def crowd() -> dict[str, Any]:
    """The documents of twelve sensors and six sources, with long names and an alarm of each state."""
    sensor = [{"name": n, "channel": f"{n}_degC", "position_m": i / 11} for i, n in enumerate(SENSORS)]
    values = {s["channel"]: {"value": 25.0, "quality": "good", "age_s": 0.0} for s in sensor}
    (alarm,) = DOCUMENTS["alarms"]["alarms"]
    states = ("unacknowledged", "acknowledged", "returned")
    learned = {f"sensor.{name}.offset_K": {"value": -0.31, "sigma": 0.08} for name in SENSORS}
    source = [*DOCUMENTS["config"]["config"]["source"], *({"name": name} for name in SOURCES[1:])]
    band = DOCUMENTS["alarms"]["bands"]["nut"]
    heats = {name: {"heat_W": 126.5, "sigma_W": 10.6} for name in SOURCES}
    return {
        **DOCUMENTS,
        "config": {"config": {"source": source, "sensor": sensor}},
        "readings": {**HEAD, "channels": {**DOCUMENTS["readings"]["channels"], **values}},
        "heat": {**HEAD, "sources": heats, "quality": "good"},
        "health": {**DOCUMENTS["health"], "reasons": [f"{i}: {REASON}" for i in range(6)], "channels": {}},
        "learned": {**HEAD, "parameters": learned},
        "alarms": {
            **DOCUMENTS["alarms"],
            "alarms": [{**alarm, "id": f"{LONG}.{s}", "state": s, "reason": REASON} for s in states],
            "bands": dict.fromkeys(SOURCES, band),
        },
    }


def crowd_estimate() -> bytes:
    """The estimate that goes with it."""

    def typed(value: float, count: int) -> cbor2.CBORTag:
        return cbor2.CBORTag(85, struct.pack(f"<{count}f", *[value] * count))

    return cbor2.dumps({
        **HEAD, "quality": "degraded", "sources": SOURCES, "heat_W": typed(126.5, 6), "law_W": typed(24.0, 6),
        "sensors": SENSORS, "innovation_K": typed(-0.031, 12), "innovation_sigma_K": typed(0.1, 12),
        "sensor_quality": ["good", "stale", "rejected"] * 4,
    })  # fmt: skip
