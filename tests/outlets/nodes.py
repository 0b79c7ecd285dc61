"""Nodes of the OPC UA server, as a client finds them."""

from __future__ import annotations

from typing import Any

from asyncua import Client, ua

from observer.outlets.opcua import NAMESPACE
from tests.patience import eventually

HEAT = ("lathe", "z", "Heat", "nut", "Heat_W")


async def read_node(client: Client, *path: str) -> ua.DataValue | None:
    """The value of a node below the axis, of whatever quality; None while there is none."""
    index = await client.get_namespace_index(NAMESPACE)
    try:
        node = await client.nodes.objects.get_child([f"{index}:{part}" for part in ("lathe", "z", *path)])
        return await node.read_data_value(raise_on_bad_status=False)
    except ua.UaError:
        return None


async def node_of(client: Client, *path: str) -> Any:
    """The node of a path, the heat's unless another is given, once it is there."""
    index = await client.get_namespace_index(NAMESPACE)

    async def node() -> Any:
        try:
            return await client.nodes.objects.get_child([f"{index}:{part}" for part in path or HEAT])
        except ua.UaError:
            return None

    return await eventually(node)
