"""The client of a real service: typed messages, the last at once, and none that looks good when it is old."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

import observer
from observer.library.messages import message_from
from tests.bus.router import Router, free_port
from tests.patience import PATIENCE_S
from tests.system.plant import COMPENSATION, Daemon, Subscriber, machine, table_for


@pytest.fixture
def service(tmp_path: Path) -> Iterator[tuple[Daemon, str]]:
    """A service that estimates well."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        with Daemon(tmp_path, table) as daemon:
            with Subscriber(endpoint) as seen:
                seen.wait_until_good()
            yield daemon, endpoint


@pytest.mark.system
async def test_a_client_arms_and_disarms_and_is_refused_with_the_reason(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint]) | {"compensation": COMPENSATION}
        with Daemon(tmp_path, table) as daemon:
            with Subscriber(endpoint) as heard:
                heard.wait_until_good()
            async with observer.connect(endpoint, timeout_s=PATIENCE_S) as client:
                assert await client.command("arm", without=["t1"]) == "armed"
                assert await client.command("disarm") == "disarmed"
                assert await client.command("acknowledge") == "acknowledged: all"
                for kind, options, reason in (
                    ("arm", {"without": ["nobody"]}, "there is no sensor nobody; the sensors are t1, "),
                    ("acknowledge", {"alarm": "none.there"}, "there is no alarm none.there"),
                    ("arm", {"without": ["t1;id=x"]}, "'t1;id=x' is not a name"),
                    ("fire", {}, "there is no command 'fire'"),
                ):
                    with pytest.raises(observer.UserError, match=reason):
                        await client.command(kind, **options)
            daemon.stop()


@pytest.mark.system
async def test_a_service_sends_everything_and_then_nothing(service: tuple[Daemon, str]) -> None:
    daemon, endpoint = service
    async with observer.connect(endpoint) as client, asyncio.timeout(3 * PATIENCE_S):
        assert (client.machine, client.axis) == ("demo", "x")
        first = client.heat.last
        assert first is not None
        assert set(first.sources) == {"nut", "left_bearing", "right_bearing"}
        assert client.field.last is not None
        assert len(client.field.last.temperature_degC) == len(client.field.last.position_m) == 21
        assert client.error.last is not None
        assert len(client.error.last.error_um) == len(client.error.last.sigma_um) == 21
        assert client.health.last is not None
        assert client.health.last.channels["t1_degC"]["quality"] == "good"
        assert client.alarms.last is not None
        times = []
        async for heat in client.heat:
            times.append(heat.time_s)
            if len(times) == 4:
                break
        assert times == sorted(set(times))
        assert times[0] >= first.time_s
        daemon.stop()
        async for heat in client.heat:
            if heat.quality == "stale":
                break
        assert client.heat.last is not None
        assert client.heat.last.quality == "stale"


@pytest.mark.system
async def test_who_does_not_answer_is_a_sentence() -> None:
    nowhere = f"tcp/127.0.0.1:{free_port()}"
    with pytest.raises(observer.UserError, match=f"no service answers at {nowhere}"):
        async with observer.connect(nowhere, timeout_s=0.5):
            pass
    with Router() as router, pytest.raises(observer.UserError, match="no service answers"):
        async with observer.connect(router.endpoint, "lathe-7", "z", timeout_s=2.0):
            pass


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"[]",
        b'{"time_s": "x", "quality": "good", "sources": {}}',
        b'{"sources": {}}',
        b"\xff",
        b"[" * 9999,
    ],
)
def test_an_invalid_message_is_none(data: bytes) -> None:
    assert message_from(observer.ServiceHeat, data) is None
    good = (
        b'{"time_s": 1.0, "quality": "good", "sources": {"nut": {"heat_W": null, "sigma_W": 2}}, "more": 1}'
    )
    heat = message_from(observer.ServiceHeat, good)
    assert heat is not None
    assert heat.sources["nut"].heat_W is None
