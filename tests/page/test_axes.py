"""Other axes on the page: what is said of them, what of them is passed on, and what they are believed."""

from __future__ import annotations

import json

import httpx
import pytest
from pydantic import ValidationError

from observer.gateway.messages import Latest
from observer.gateway.start import Start
from observer.page.app import application
from observer.page.axes import Neighbour, summary, worst_alarm
from observer.page.guard import Logins
from observer.page.stream import Stream
from observer.tables.gateway import Page

HERE = "http://127.0.0.1:8080"
NOBODY = "127.0.0.1:9"


def _alarm(severity: str, state: str) -> dict[str, str]:
    return {"severity": severity, "state": state, "reason": f"{severity} {state}"}


def test_unacknowledged_alarms_come_before_worse_ones():
    alarms = [
        _alarm("invalid", "acknowledged"),
        _alarm("minor", "unacknowledged"),
        _alarm("major", "returned"),
    ]
    assert worst_alarm(alarms) == alarms[2]
    assert worst_alarm(alarms[:2]) == alarms[1]
    assert worst_alarm(alarms[:1]) == alarms[0]
    assert worst_alarm([]) is None


def test_without_a_heartbeat_an_axis_is_stale_whatever_it_said():
    said = {"hello": {"machine": "mill", "axis": "z"}, "health": {"state": "good"}}
    assert summary(said)["state"] == "stale"
    assert summary({**said, "beat": {"stale": False}})["state"] == "good"
    assert summary({**said, "beat": {"stale": True}})["state"] == "stale"


@pytest.mark.parametrize("said", [b"[]", b"7", b"{", b'{"alarms": [1]}', b'{"alarms": [{}]}'])
def test_an_axis_with_invalid_messages_is_shown_by_its_last_valid_one(said):
    axis = Neighbour(NOBODY, login=True)
    axis._take("hello", b'{"machine": "mill", "axis": "z", "login": false}')
    axis._take("alarms", said)
    assert axis.summary()["machine"] == "mill"
    assert axis.summary()["alarm"] is None
    # who has logged in here logs out here
    assert json.loads(axis._newest["hello"].split(b"data: ")[1])["login"] is True


@pytest.mark.parametrize("address", ["192.168.0.7:80", "mill.example:80", "0.0.0.0:80", "127.0.0.1"])
def test_an_axis_elsewhere_is_rejected(address):
    with pytest.raises(ValidationError, match=r"not on this computer|no address"):
        Page(axes=(address,))


def _client(login: Logins | None) -> tuple[httpx.AsyncClient, list[tuple[str, str]]]:
    seen: list[tuple[str, str]] = []
    start = Start(machine="lathe", axis="z", period_s=0.5, page=Page())
    axes = [Neighbour(NOBODY, login is not None)]
    stream = Stream(Latest(0.5), start)
    app = application(start, stream, login, lambda alarm, by: seen.append((alarm, by)), axes)
    return httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url=HERE), seen


@pytest.mark.parametrize(
    "path",
    ["axes/0/recent.json", "axes/2/recent.json", "axes/1/login", "axes/1/assets/main.js", "axes/1/axes.json",
     "axes/1/axes/1/recent.json", "axes/1/events/x", "axes/1/reports/a/b/report.html"],
)  # fmt: skip
async def test_nothing_else_of_an_axis_is_passed_on(path):
    client, _ = _client(None)
    assert (await client.get(f"/{path}")).status_code == 404
    assert (await client.post(f"/{path}", data={}, headers={"origin": HERE})).status_code == 404


async def test_an_axis_that_does_not_answer_is_said_in_words():
    client, _ = _client(None)
    answer = await client.get("/axes/1/recent.json")
    assert answer.status_code == 502
    assert "does not answer" in answer.text


async def test_a_name_is_believed_only_where_nobody_logs_in():
    client, seen = _client(None)
    form = {"id": "a", "by": "anna"}
    assert (await client.post("/acknowledge", data=form, headers={"origin": HERE})).status_code == 200
    assert seen == [("a", "anna")]
    login = Logins({"ben": "right"}, secure=False)
    client, seen = _client(login)
    client.headers["cookie"] = login.cookie("ben").split(";")[0]
    assert (await client.post("/acknowledge", data=form, headers={"origin": HERE})).status_code == 200
    assert seen == [("a", "ben")]
