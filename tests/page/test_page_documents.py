"""The gateway's page of made-up documents in a real browser: alarms, forecast, compensation, login."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import cbor2
import pytest

from observer.gateway.framing import framed
from observer.gateway.start import Start
from observer.tables.gateway import Page
from tests.page.browser import CHROMIUM, answers, chromium
from tests.patience import PATIENCE_S, until
from tests.publish.router import free_port

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Debian's package chromium"),
]
NASTY = "<img src=x onerror=alert(1)> t3 is open"
NOW_S = time.time()
HEAD = {"time_s": NOW_S, "sequence": 7, "instance": "i"}
PLACES_M = [0.0, 0.5, 1.0]
DOCUMENTS: dict[str, Any] = {
    "config": {"config": {
        "source": [{"name": "nut", "position_channel": "nut_position_m", "stroke_m": [0.2, 0.8]}],
        "sensor": [{"name": "t3", "channel": "t3_degC", "position_m": 0.5}],
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
    "compensation": {**HEAD, "armed": True, "reason": None, "position_m": PLACES_M,
                     "error_um": [0.0, 19.0, 40.0]},
    "health": {"time_s": NOW_S, "state": "degraded", "reasons": [NASTY],
               "channels": {"t3_degC": {"quality": "missing", "age_s": 3.0, "fault": "open circuit"}}},
    "learned": {**HEAD, "parameters": {"surface.convection_W_m2K": {"value": 15.217, "sigma": 0.42}}},
    "alarms": {"time_s": NOW_S, "instance": "i", "alarms": [
        {"id": "sensor.t3.open_circuit", "kind": "open_circuit", "target": "t3", "severity": "major",
         "state": "unacknowledged", "since_s": NOW_S - 60, "reason": NASTY, "remedy": "mend the cable",
         "evidence": None},
    ], "bands": {"nut": {"known": True, "running_h": 30.0, "ratio": 1.12, "sigma": 0.04,
                         "trend_per_day": 0.01}}},
    "forecast": {"time_s": NOW_S, "instance": "i", "quality": "good", "reason": None,
                 "program": {"kind": "cycle", "period_s": 600.0, "text": "the last cycle goes on"},
                 "at_s": [NOW_S, NOW_S + 1800, NOW_S + 3600], "position_m": PLACES_M,
                 "temperature_degC": [[25.0] * 3] * 3, "sigma_K": [[0.1] * 3] * 3,
                 "error_um": [[0, 20, 41], [0, 25, 50], [0, 26, 52]], "error_sigma_um": [[0, 1, 2]] * 3,
                 "settled_at_s": NOW_S + 1800, "settles_within_um": 2.0, "warm_up": None},
}  # fmt: skip


def _estimate(sequence: int) -> bytes:
    def typed(value: float) -> cbor2.CBORTag:
        return cbor2.CBORTag(85, struct.pack("<f", value))

    return cbor2.dumps({
        **HEAD, "sequence": sequence, "quality": "degraded", "sources": ["nut"], "heat_W": typed(26.54),
        "law_W": typed(float("nan")), "sensors": ["t3"], "innovation_K": typed(float("nan")),
        "innovation_sigma_K": typed(0.1), "sensor_quality": ["missing"],
    })  # fmt: skip


@contextmanager
def gateway(**page: Any) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """The gateway's process with a page of these documents."""
    listen = f"127.0.0.1:{free_port()}"
    start = Start(machine="lathe", axis="z", period_s=60.0, page=Page(listen=listen, **page))
    process = subprocess.Popen(
        [sys.executable, "-m", "observer.gateway"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        told = [("start", start.model_dump_json().encode()), ("estimate", _estimate(7))]
        told += [(key, json.dumps(document).encode()) for key, document in DOCUMENTS.items()]
        process.stdin.write(b"".join(framed(*message) for message in told))
        process.stdin.flush()
        until(lambda: answers(f"http://{listen}/assets/page.css"), PATIENCE_S)
        assert json.loads(process.stdout.readline())["reason"] is None
        yield f"http://{listen}/", process
    finally:
        process.stdin.close()
        assert process.wait(PATIENCE_S) == 0
        assert process.stderr.read() == b""  # it ends without a word, whoever still looks
        process.stdout.close()
        process.stderr.close()


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started


def test_documents_are_shown_and_never_run(browser):
    with gateway() as (url, process):
        page, problems = browser.new_page(), []
        page.on("console", lambda m: problems.append(m.text) if m.type in {"error", "warning"} else None)
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("dialog", lambda dialog: problems.append(dialog.message))
        page.goto(url)
        page.wait_for_selector("#c-forecast canvas")
        page.wait_for_selector("tr[data-sensor=t3]")
        assert page.inner_text("#state") == "Degraded"
        assert page.inner_text("#reasons") == NASTY
        assert page.locator("main img").count() == 0
        assert "open circuit" in page.inner_text("#sensors")
        assert page.inner_text("tr[data-sensor=t3] [data-field=reading]") == "– °C"
        assert page.inner_text("[data-heat=nut]") == "26.5 ± 0.6 W"
        assert page.inner_text("[data-learnt='surface.convection_W_m2K']") == "15.22 ± 0.42"
        assert page.inner_text("#comp-words") == "compensation armed"
        assert "Settled within 2.0 µm" in page.inner_text("#forecast-words")
        assert "the last cycle goes on" in page.inner_text("#forecast-words")
        assert "1.12 ± 0.04" in page.inner_text("#alarms")
        assert "observer acknowledge sensor.t3.open_circuit" in page.inner_text("#alarms")
        page.click("#alarms button")
        assert json.loads(process.stdout.readline()) == {
            "acknowledge": "sensor.t3.open_circuit",
            "by": "page",
        }
        process.stdin.write(framed("alarms", json.dumps({**DOCUMENTS["alarms"], "alarms": []}).encode()))
        process.stdin.flush()
        page.wait_for_selector("#alarms .calm")
        assert problems == []
    page.close()


def test_who_looks_logs_in_where_it_is_asked(browser, tmp_path):
    users = tmp_path / "users"
    users.touch(0o600)
    users.write_text("anna:right\n", encoding="utf-8")
    with gateway(users_file=users) as (url, _):
        page = browser.new_page()
        page.goto(url)
        for password, seen in (("wrong", ".wrong:not(:empty)"), ("right", "tr[data-sensor=t3]")):
            page.fill("[name=user]", "anna")
            page.fill("[name=password]", password)
            page.keyboard.press("Enter")
            page.wait_for_selector(seen)
        (cookie,) = page.context.cookies()
        assert cookie["httpOnly"]
        assert cookie["sameSite"] == "Strict"
        page.click("#logout button")
        page.wait_for_selector("[name=password]")
    page.close()


def test_a_port_that_is_taken_is_a_reason_in_words():
    with gateway() as (url, _):
        listen = url.removeprefix("http://").strip("/")
        start = Start(machine="lathe", axis="z", period_s=60.0, page=Page(listen=listen))
        other = subprocess.run(
            [sys.executable, "-m", "observer.gateway"],
            input=framed("start", start.model_dump_json().encode()), capture_output=True, timeout=PATIENCE_S,
        )  # fmt: skip
    assert other.returncode == 0
    for line in other.stdout.splitlines():
        assert "another program listens" in json.loads(line)["reason"]
