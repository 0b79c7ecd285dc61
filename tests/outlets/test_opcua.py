"""The OPC UA server without a password, asked by a real client over the wire."""

from __future__ import annotations

import pytest
from asyncua import Client, ua

from observer.config.outlets import Opcua
from observer.outlets.opcua import NAMESPACE
from tests.bus.router import free_port
from tests.outlets.feeding import fed_outlets
from tests.outlets.nodes import node_of
from tests.patience import until

pytestmark = pytest.mark.system


async def test_nobody_can_write_whatever_the_name():
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    with fed_outlets(opcua=Opcua(listen=url)) as feed:
        until(lambda: feed.said()["reason"] is None)
        feed.estimate()
        for user in (None, "admin", "Admin"):
            client = Client(url)
            if user is not None:
                client.set_user(user)
            async with client:
                node, index = await node_of(client), await client.get_namespace_index(NAMESPACE)
                with pytest.raises(ua.UaError):
                    await node.write_value(5.0)
                with pytest.raises(ua.UaError):
                    await client.nodes.objects.add_object(index, "another")
                assert await node.read_value() == 26.5
