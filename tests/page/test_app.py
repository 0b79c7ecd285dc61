"""What the page answers, and whom: without a browser, a service or a port."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cbor2
import httpx
import numpy as np
import pytest

from observer.config.outlets import Page
from observer.outlets.messages import Latest
from observer.outlets.page_app import application
from observer.outlets.page_guard import COOKIE, POLICY, Logins
from observer.outlets.page_stream import Innovations, Stream
from observer.outlets.start import Start

HERE = "http://127.0.0.1:8080"


def _start(period_s: float) -> Start:
    return Start(machine="lathe", axis="z", period_s=period_s)


@pytest.fixture
def page():
    """Make a client of a page, for those whom `login` lets in."""

    def made(
        login: Logins | None = None, settings: Page | None = None
    ) -> tuple[httpx.AsyncClient, list[tuple[str, str]]]:
        seen: list[tuple[str, str]] = []

        async def acknowledge(alarm: str, by: str) -> str | None:
            seen.append((alarm, by))
            return "no alarm of that id" if alarm == "none" else None

        start = Start(machine="lathe", axis="z", period_s=0.5, page=settings or Page())
        stream = Stream(Latest(0.5), _start(0.5))
        app = application(start, stream, login, acknowledge)
        return httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url=HERE), seen

    return made


async def test_every_answer_of_the_page_has_the_headers_that_seal_it(page):
    client, _ = page()
    for path in ("/", "/assets/main.js", "/past.json", "/none"):
        answer = await client.get(path)
        assert answer.headers["content-security-policy"] == POLICY
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "no-referrer"


async def test_every_file_that_the_page_names_is_there(page):
    client, _ = page()
    text = (await client.get("/")).text
    names = [part.split('"')[0] for part in text.split('"/assets/')[1:]]
    assert len(names) > 10
    for name in names:
        assert (await client.get(f"/assets/{name}")).status_code == 200, name
    assert (await client.get("/assets/uplot.LICENSE.txt")).text.startswith("The MIT License")
    assert "style=" not in text
    assert "<style" not in text


@pytest.mark.parametrize(
    ("host", "status"),
    [("127.0.0.1:8080", 200), ("localhost:9", 200), ("[::1]:80", 200), ("192.168.0.7", 200),
     ("evil.example", 421), ("127.0.0.1.evil.example:8080", 421), ("", 421)],
)  # fmt: skip
async def test_a_foreign_name_does_not_lead_here(page, host, status):
    client, _ = page()
    assert (await client.get("/", headers={"host": host})).status_code == status


async def test_an_alarm_is_acknowledged_by_the_page_itself_alone(page):
    client, seen = page()
    for origin in ({}, {"origin": "http://evil.example"}, {"origin": "null"}):
        answer = await client.post("/acknowledge", data={"id": "sensor.t3"}, headers=origin)
        assert answer.status_code == 403
    assert seen == []
    answer = await client.post(
        "/acknowledge", data={"id": "sensor.t3", "by": "anna"}, headers={"origin": HERE}
    )
    assert answer.status_code == 200
    assert seen == [("sensor.t3", "page")]
    refused = await client.post("/acknowledge", data={"id": "none"}, headers={"origin": HERE})
    assert (refused.status_code, refused.text) == (502, "no alarm of that id\n")
    for wrong in ("", "a" * 201, "a\nb"):
        answer = await client.post("/acknowledge", data={"id": wrong}, headers={"origin": HERE})
        assert answer.status_code == 400
    assert len(seen) == 2


async def test_who_has_to_log_in_sees_nothing_before(page):
    client, seen = page(Logins({"anna": "right"}, secure=False))
    assert (await client.get("/")).headers["location"] == "/login"
    for path in ("/events", "/recent.json", "/history.json?from=0&to=1", "/assets/main.js"):
        assert (await client.get(path)).status_code == 401, path
    own = {"origin": HERE}
    assert (await client.post("/acknowledge", data={"id": "a"}, headers=own)).status_code == 401
    wrong = await client.post("/login", data={"user": "anna", "password": "x"}, headers=own)
    assert wrong.status_code == 403
    assert "do not match; try again" in wrong.text
    assert "set-cookie" not in wrong.headers
    right = await client.post("/login", data={"user": "anna", "password": "right"}, headers=own)
    assert right.headers["location"] == "/"
    assert (await client.get("/recent.json")).status_code == 200
    await client.post("/acknowledge", data={"id": "a"}, headers=own)
    assert seen == [("a", "anna")]
    assert (await client.post("/logout", headers=own)).headers["set-cookie"].startswith(f"{COOKIE}=;")
    assert (await client.get("/recent.json")).status_code == 401


@pytest.mark.parametrize(
    ("listen", "tls", "clear"),
    [("127.0.0.1:80", False, False), ("0.0.0.0:80", True, False), ("0.0.0.0:80", False, True)],
)
async def test_a_login_that_others_can_read_says_so(page, listen, tls, clear):
    files = {"certificate": Path("c"), "key": Path("k")} if tls else {}
    settings = Page(listen=listen, users_file=Path("u"), **files)
    client, _ = page(Logins({"anna": "right"}, secure=tls), settings)
    text = (await client.get("/login")).text
    assert ("not encrypted" in text) == clear
    assert "{" not in text
    assert (settings.doubt is not None) == clear


async def test_without_a_recording_the_page_says_what_to_do(page):
    client, _ = page()
    assert "record.directory" in (await client.get("/past.json")).json()["reason"]
    assert (await client.get("/history.json?from=1")).status_code == 400
    assert (await client.get("/history.json?from=1&to=x")).status_code == 400


async def test_a_viewer_who_is_behind_gets_the_newest_of_each_kind():
    now = [0.0]
    stream = Stream(Latest(0.5), _start(0.5), clock=lambda: now[0])
    viewer = stream.join().body_iterator
    first = await anext(viewer)
    assert first.startswith(b"event: hello\n")
    assert b"retry: 1000\n" in first, "a browser by itself tries each third second"
    for k in range(1000):
        now[0] += 0.5
        stream.take("heat", json.dumps({"sequence": k}).encode())
    assert await anext(viewer) == b'event: heat\ndata: {"sequence": 999}\n\n'
    await viewer.aclose()


def test_no_kind_is_sent_more_than_ten_times_a_second():
    now = [0.0]
    stream = Stream(Latest(0.01), _start(0.01), clock=lambda: now[0])
    sent = []
    stream.send = lambda key, data: sent.append(key)
    for _ in range(1000):
        now[0] += 0.01
        stream.take("heat", b"{}")
        stream.take("health", b"{}")
    assert 90 <= sent.count("heat") <= 112
    assert sent.count("health") == 1000


def test_invalid_estimates_are_left_out_and_the_last_hour_is_kept():
    stream = Stream(Latest(0.5), _start(0.5), clock=lambda: float(np.random.default_rng().uniform()))
    stream.take("estimate", b"\xff")
    for k in range(2000):
        field = {"time_s": 2.0 * k, "quality": "good", "temperature_degC": [20.0, None]}
        stream.recent.take("field", json.dumps(field).encode())
    rows = json.loads(stream.recent.document())["rows"]
    assert len(rows) == 900
    assert rows[-1]["time_s"] - rows[0]["time_s"] == 3596.0
    assert rows[0]["temperature_degC"] == [20.0, None]


def _estimate(sequence: int, innovation_K: float, **more) -> dict:
    return {"time_s": 0.5 * sequence, "sequence": sequence, "instance": "i", "sensors": ["t1"],
            "innovation_K": [innovation_K], "innovation_sigma_K": [0.1], **more}  # fmt: skip


def test_the_last_innovation_stays_with_its_age_and_is_late_when_the_next_one_is():
    innovations = Innovations()
    for sequence in range(5):  # a reading every second, a step every half
        innovations.take(_estimate(sequence, math.nan if sequence % 2 else 0.1 * sequence))
    at_s = [innovations.document(time_s)["t1"] for time_s in (2.0, 2.5, 3.0, 4.0)]
    assert {kept["value"] for kept in at_s} == {0.4}
    assert {kept["sequence"] for kept in at_s} == {4}
    assert [kept["age_s"] for kept in at_s] == [0.0, 0.5, 1.0, 2.0]
    assert [kept["late"] for kept in at_s] == [False, False, False, True]
    innovations.take(_estimate(5, math.nan, instance="another"))
    assert innovations.document(2.5) == {}


def test_no_innovation_is_lost_between_the_steps_sent():
    now, sent = [0.0], []
    stream = Stream(Latest(0.05), _start(0.05), clock=lambda: now[0])
    stream.send = lambda key, data: sent.append(json.loads(data.split(b"data: ")[1]))
    for sequence in range(100):
        now[0] += 0.05
        values = {"innovation_K": math.nan if sequence % 20 != 1 else 1.0}
        stream.take("estimate", cbor2.dumps(_estimate(sequence, values["innovation_K"])))
    assert len(sent) <= 51
    assert {t["sequence"] % 20 for t in sent if t["innovations"]}.isdisjoint({1})  # it has no reading itself
    assert all(t["innovations"]["t1"]["value"] == 1.0 for t in sent[1:])
