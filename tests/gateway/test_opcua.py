"""The OPC UA server, asked by a real client over the wire."""

from __future__ import annotations

from datetime import UTC

import pytest
from asyncua import Client, ua

from observer.gateway.opcua import NAMESPACE
from observer.tables.gateway import Opcua
from tests.gateway.feeding import ALARM, HEALTH, fed_gateway
from tests.patience import eventually, until
from tests.publish.router import free_port

pytestmark = pytest.mark.system


async def _read(client: Client, *path: str):
    index = await client.get_namespace_index(NAMESPACE)
    try:
        node = await client.nodes.objects.get_child([f"{index}:{part}" for part in ("lathe", "z", *path)])
        return await node.read_data_value(raise_on_bad_status=False)
    except ua.UaError:
        return None


async def _until_read(client: Client, *path: str, status: int):

    async def is_there():
        value = await _read(client, *path)
        return value if value is not None and value.StatusCode.value == status else None

    return await eventually(is_there)


STATUS = {
    "good": ua.StatusCodes.Good,
    "degraded": ua.StatusCodes.UncertainSubNormal,
    "invalid": ua.StatusCodes.BadNoData,
}


async def test_estimates_have_their_quality_as_status():
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    with fed_gateway(opcua=Opcua(listen=url)) as feed:
        until(lambda: feed.said()["reason"] is None)
        feed.document("health", HEALTH | {"time_s": 1.0})
        feed.document("alarms", {"time_s": 1.0, "alarms": [ALARM], "bands": {}})
        async with Client(url) as client:
            for quality, status in STATUS.items():
                time_s = feed.estimate(quality)
                heat = await _until_read(client, "Heat", "nut", "Heat_W", status=status)
                if quality != "invalid":
                    assert heat.Value.Value == 26.5
                assert heat.SourceTimestamp.replace(tzinfo=UTC).timestamp() == pytest.approx(time_s, abs=1e-3)
                state = await _until_read(client, "Health", "State", status=ua.StatusCodes.Good)
                assert state.Value.Value == "degraded"
                raised = await _until_read(client, "Alarms", "Raised", status=ua.StatusCodes.Good)
                assert raised.Value.Value == [
                    f"major sensor_fault.t2.open_circuit (unacknowledged): open; {ALARM['remedy']}"
                ]
                if quality == "good":
                    await _assert_every_part(client)


async def _assert_every_part(client: Client) -> None:
    """What else there is of a good estimate."""
    curve = await _read(client, "Field", "Temperature_degC")
    assert curve.Value.Value == [21.0, 25.5, 22.0]
    bounds = [await _read(client, *p) for p in (("Heat", "nut", "Bound_W"), ("Field", "Bound_K"))]
    assert [bound.Value.Value for bound in bounds] == [2.5, [0.5, 0.75, 1.5]]
    error = await _read(client, "Error", "Bound_um")
    assert error.Value.Value == [0.0, 4.0, 9.0]
    await _until_read(client, "Sensors", "t2", "Innovation_K", status=ua.StatusCodes.BadNoData)


async def test_a_silent_service_is_reported():
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    with fed_gateway(period_s=0.5, opcua=Opcua(listen=url)) as feed:
        until(lambda: feed.said()["reason"] is None)
        feed.estimate()
        async with Client(url) as client:
            last = ua.StatusCodes.UncertainLastUsableValue
            await _until_read(client, "Heat", "nut", "Heat_W", status=last)


async def test_nobody_can_write_whatever_the_name():
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    with fed_gateway(opcua=Opcua(listen=url)) as feed:
        until(lambda: feed.said()["reason"] is None)
        feed.estimate()
        for user in (None, "admin", "Admin"):
            client = Client(url)
            if user is not None:
                client.set_user(user)
            async with client:
                await _assert_is_read_only(client)


async def _assert_is_read_only(client: Client) -> None:
    await _until_read(client, "Heat", "nut", "Heat_W", status=ua.StatusCodes.Good)
    index = await client.get_namespace_index(NAMESPACE)
    path = [f"{index}:{part}" for part in ("lathe", "z", "Heat", "nut", "Heat_W")]
    node = await client.nodes.objects.get_child(path)
    with pytest.raises(ua.UaError):
        await node.write_value(5.0)
    with pytest.raises(ua.UaError):
        await client.nodes.objects.add_object(index, "another")
    assert await node.read_value() == 26.5
