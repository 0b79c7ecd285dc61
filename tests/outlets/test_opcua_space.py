"""What OPC UA itself defines, without what is not used here, still hangs together."""

from __future__ import annotations

import asyncio
import sys

import pytest
from asyncua import ua

from observer.config.outlets import Opcua
from observer.outlets.opcua_server import guarded

IDS = ua.ObjectIds
MOST_NODES = 2000  # of 6174 of asyncua 2.1


@pytest.fixture(scope="module")
def nodes():
    """What a server begins with; nobody here changes it."""
    return asyncio.run(guarded(Opcua())).iserver.aspace._nodes


def test_every_reference_and_data_type_is_there(nodes):
    assert 1000 < len(nodes) < MOST_NODES
    for node in nodes.values():
        away = [reference for reference in node.references if reference.NodeId not in nodes]
        assert not away, node.nodeid
        if kind := node.attributes.get(ua.AttributeIds.DataType):
            assert kind.value.Value.Value in nodes, node.nodeid


@pytest.mark.parametrize(
    "wanted",
    [
        IDS.Server_ServerStatus_State, IDS.Server_NamespaceArray, IDS.Server_ServerCapabilities,
        IDS.FolderType, IDS.BaseDataVariableType, IDS.Double, IDS.LocalizedText, IDS.HasComponent,
        IDS.ServerStatusDataType, IDS.ServerState, IDS.ModellingRule_Mandatory,
    ],
)  # fmt: skip
def test_the_address_space_has_what_clients_ask_for(nodes, wanted):
    assert ua.NodeId(wanted) in nodes


def test_the_address_space_is_without_what_nobody_serves(nodes):
    for unused in (IDS.AlarmConditionType, IDS.PublishSubscribe, IDS.FileType, IDS.ServerConfiguration):
        assert ua.NodeId(unused) not in nodes
    assert not [name for name in sys.modules if name.startswith("asyncua.server.standard_address_space")]
