"""What outlets hear of a service: after its restart nothing of the one before, and documents asked again."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh
from asyncua import Client as OpcuaClient

from observer.bus.session import session_config
from observer.config.outlets import Metrics, Opcua
from observer.config.publishing import Client, Login
from observer.errors import ConfigError
from observer.outlets import bus
from observer.outlets.bus import Bus
from observer.outlets.messages import Latest
from observer.outlets.page_stream import Stream
from observer.outlets.start import Start
from tests.bus.router import free_port
from tests.outlets.feeding import HEALTH, fed_outlets
from tests.outlets.nodes import read_node
from tests.outlets.test_metrics import scraped
from tests.patience import PATIENCE_S, eventually, until

ARMED = {"time_s": 1.0, "armed": True, "phase": "following", "quality": "good", "instance": "0a0a0a0a"}
CONFIG = Path("config/demo.toml")


@pytest.mark.system
async def test_what_the_service_no_longer_publishes_after_a_restart_is_dropped():
    listen, url = f"127.0.0.1:{free_port()}", f"opc.tcp://127.0.0.1:{free_port()}"
    with fed_outlets(metrics=Metrics(listen=listen), opcua=Opcua(listen=url)) as feed:
        assert [feed.said()["reason"] for _ in range(2)] == [None, None]
        feed.document("compensation", ARMED)
        until(lambda: "ballscrew_compensation_armed" in scraped(listen))
        async with OpcuaClient(url) as client:

            async def is_good() -> bool:
                armed = await read_node(client, "Compensation", "Armed")
                return armed is not None and armed.StatusCode.is_good()

            await eventually(is_good)
            feed.document("health", HEALTH | {"time_s": 2.0, "instance": "0b0b0b0b"})
            until(lambda: "ballscrew_compensation_armed" not in scraped(listen))

            async def is_bad() -> bool:
                armed = await read_node(client, "Compensation", "Armed")
                return armed is not None and armed.StatusCode.is_bad()

            await eventually(is_bad)
        assert "ballscrew_cycles_total" in scraped(listen)


async def test_a_viewer_is_told_what_is_dropped_and_a_later_one_gets_nothing_of_it():
    latest = Latest(60.0)
    stream = Stream(latest, Start(machine="lathe", axis="z", period_s=60.0))
    latest.put("compensation", json.dumps(ARMED).encode())
    heard = latest.messages()
    stream.take(*await anext(heard))
    viewer = stream.join().body_iterator
    assert b'"armed": true' in await anext(viewer)
    latest.forget()
    stream.take(*await anext(heard))
    assert await anext(viewer) == b"event: compensation\ndata: null\n\n"
    later = stream.join().body_iterator
    assert b"compensation" not in await anext(later)
    for left in (viewer, later, heard):
        await left.aclose()


@pytest.mark.system
def test_the_configuration_is_asked_again_until_it_is_heard(monkeypatch):
    monkeypatch.setattr(bus, "_QUERY_S", 0.1)
    endpoint, heard = f"tcp/127.0.0.1:{free_port()}", {}
    start = Start(machine="lathe", axis="z", period_s=1.0, connect=endpoint)
    with zenoh.open(session_config("peer", (), (endpoint,))) as session:
        made = Bus(start, heard.__setitem__, heard.clear, reports=False)
        made.start()
        health = session.declare_publisher(f"{start.prefix}/health")
        until(lambda: health.matching_status.matching)
        token = session.liveliness().declare_token(f"{start.prefix}/alive")
        until(lambda: health.put(b"{}") or heard)  # the service is there, and has not answered

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(f"{start.prefix}/config", b'{"hash":"h"}')

        answers = session.declare_queryable(f"{start.prefix}/config", answer)
        until(lambda: heard.get("config") == b'{"hash":"h"}')
        answers.undeclare()
        token.undeclare()
        made.close(PATIENCE_S)


def test_a_login_that_cannot_be_used_is_an_error_at_once(tmp_path):
    login = Login(user="panel", password_file=tmp_path / "missing")
    start = Start(machine="lathe", axis="z", period_s=1.0, client=Client(login=login))
    with pytest.raises(ConfigError, match=r"login\.password_file"):
        Bus(start, lambda *_: None, lambda: None, reports=False)


@pytest.mark.system
def test_outlets_that_the_service_starts_are_not_started_by_hand():
    command = [sys.executable, "-m", "observer", "outlets", "--config", str(CONFIG)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert ended.returncode == 2
    assert "set [outlets] start = false" in ended.stderr
