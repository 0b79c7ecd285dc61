"""The gateway's page of made-up documents in a real browser: alarms, forecast, compensation, login."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from observer.gateway.framing import framed
from observer.gateway.start import Start
from observer.tables.gateway import Page
from tests.page.browser import CHROMIUM, chromium
from tests.page.gateway import DOCUMENTS, NASTY, gateway
from tests.patience import PATIENCE_S

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Debian's package chromium"),
]


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
