"""The OPC UA server, asked by a real client over the wire."""

from __future__ import annotations

import pytest
from asyncua import Client, ua

from observer.gateway.opcua import NAMESPACE
from observer.tables.gateway import Opcua
from tests.gateway.feeding import fed_gateway
from tests.patience import eventually, until
from tests.publish.router import free_port

pytestmark = pytest.mark.system


async def read_node(client: Client, *path: str):
    index = await client.get_namespace_index(NAMESPACE)
    try:
        node = await client.nodes.objects.get_child([f"{index}:{part}" for part in ("lathe", "z", *path)])
        return await node.read_data_value(raise_on_bad_status=False)
    except ua.UaError:
        return None


async def _untilread_node(client: Client, *path: str, status: int):

    async def is_there():
        value = await read_node(client, *path)
        return value if value is not None and value.StatusCode.value == status else None

    return await eventually(is_there)


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
    await _untilread_node(client, "Heat", "nut", "Heat_W", status=ua.StatusCodes.Good)
    index = await client.get_namespace_index(NAMESPACE)
    path = [f"{index}:{part}" for part in ("lathe", "z", "Heat", "nut", "Heat_W")]
    node = await client.nodes.objects.get_child(path)
    with pytest.raises(ua.UaError):
        await node.write_value(5.0)
    with pytest.raises(ua.UaError):
        await client.nodes.objects.add_object(index, "another")
    assert await node.read_value() == 26.5
