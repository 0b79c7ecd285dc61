"""What a client of OPC UA may take: nodes a request, items, subscriptions, sessions; nobody else waits."""

from __future__ import annotations

import asyncio
import math
import subprocess
import sys
import urllib.request

import pytest
from asyncua import Client, ua

from observer.config.outlets import Opcua, Page
from tests.bus.router import free_port
from tests.outlets.feeding import fed_outlets, feed_machine
from tests.outlets.nodes import node_of
from tests.patience import PATIENCE_S, Stopwatch, eventually, until

pytestmark = pytest.mark.system
ROOT = ua.NodeId(ua.ObjectIds.RootFolder)
MANY_REFERENCES = ua.NodeId(ua.ObjectIds.Server)
"""A hundred times those of this node are more than 2000."""
MANY = 16_000
SOON_S = 1.0
"""An outlet that is busy delays no other by more."""


class Handler:
    """Takes changes, and does nothing with them."""

    def datachange_notification(self, *_) -> None:
        pass


def _browse(count: int, node: ua.NodeId = ROOT) -> ua.BrowseParameters:
    one = ua.BrowseDescription(NodeId=node, ReferenceTypeId=ua.NodeId(), ResultMask=63)
    return ua.BrowseParameters(NodesToBrowse=[one] * count)


def _read(count: int) -> ua.ReadParameters:
    one = ua.ReadValueId(NodeId=ROOT, AttributeId=ua.AttributeIds.BrowseName)
    return ua.ReadParameters(NodesToRead=[one] * count)


def _path() -> ua.BrowsePath:
    element = ua.RelativePathElement(TargetName=ua.QualifiedName("Objects", 0))
    return ua.BrowsePath(StartingNode=ROOT, RelativePath=ua.RelativePath(Elements=[element]))


@pytest.fixture
def served():
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    with fed_outlets(opcua=Opcua(listen=url)) as feed:
        feed_machine(feed)
        yield url


async def test_a_request_names_a_limited_number_of_nodes(served):
    async with Client(served, timeout=PATIENCE_S) as client:
        session = client.uaclient
        assert len(await session.read(_read(1000))) == 1000
        assert len(await session.browse(_browse(100))) == 100
        for request in (
            session.read(_read(1001)),
            session.browse(_browse(101)),
            session.translate_browsepaths_to_nodeids([_path()] * 1001),
        ):
            with pytest.raises(ua.uaerrors.BadTooManyOperations):
                await request
        limits = client.get_node(ua.ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerBrowse)
        assert await limits.read_value() == 100


async def test_an_answer_lists_a_limited_number_of_references(served):
    async with Client(served, timeout=PATIENCE_S) as client:
        results = await client.uaclient.browse(_browse(100, MANY_REFERENCES))
        assert results[0].References
        assert sum(len(result.References) for result in results) <= 2000
        codes = {result.StatusCode.value for result in results if not result.References}
        assert codes == {ua.StatusCodes.BadNoContinuationPoints}


async def test_a_session_has_a_limited_number_of_items_and_subscriptions(served):
    async with Client(served, timeout=PATIENCE_S) as client:
        node = await node_of(client)
        first = await client.create_subscription(500, Handler())
        for _ in range(10):
            await first.subscribe_data_change([node] * 100)
        with pytest.raises(ua.uaerrors.BadTooManyMonitoredItems):
            await first.subscribe_data_change([node])
        for _ in range(9):
            await client.create_subscription(500, Handler())
        with pytest.raises(ua.uaerrors.BadTooManySubscriptions):
            await client.create_subscription(500, Handler())


async def test_every_requested_interval_becomes_one_between_100_ms_and_a_minute(served):
    """The request is made by hand, as the client itself refuses to send some of these numbers."""
    async with Client(served, timeout=PATIENCE_S) as client:
        for requested_ms in (math.nan, -1.0, 0.0, -math.inf, 5e-324, math.inf, 1e308):
            request = ua.CreateSubscriptionParameters(
                RequestedPublishingInterval=requested_ms, RequestedLifetimeCount=100, PublishingEnabled=True
            )
            result = await client.uaclient.create_subscription(request, lambda _: None)
            expected_ms = 60_000.0 if requested_ms > 1e4 else 100.0
            assert result.RevisedPublishingInterval == expected_ms, requested_ms
            await client.uaclient.delete_subscriptions([result.SubscriptionId])
        changes: asyncio.Queue[float] = asyncio.Queue()
        handler = Handler()
        handler.datachange_notification = lambda _node, value, _data: changes.put_nowait(value)
        subscription = await client.create_subscription(0.0, handler)
        await subscription.subscribe_data_change(await node_of(client), sampling_interval=math.nan)
        await asyncio.wait_for(changes.get(), PATIENCE_S)


async def test_a_connection_has_one_session(served):
    async with Client(served, timeout=PATIENCE_S) as client:
        with pytest.raises(ua.uaerrors.BadTooManySessions):
            await client.create_session()


async def test_nobody_uses_the_subscription_of_another_session(served):
    async with Client(served, timeout=PATIENCE_S) as one, Client(served, timeout=PATIENCE_S) as other:
        subscription = await one.create_subscription(500, Handler())
        number = subscription.subscription_id
        (result,) = await other.uaclient.delete_subscriptions([number])
        assert result.value == ua.StatusCodes.BadSubscriptionIdInvalid
        await subscription.subscribe_data_change([await node_of(one)])


async def test_a_client_that_takes_no_answers_is_cut_off(served):
    status = ua.ReadValueId(ua.NodeId(ua.ObjectIds.Server_ServerStatus), ua.AttributeIds.Value)
    client = Client(served, timeout=PATIENCE_S)
    await client.connect()
    protocol = client.uaclient.protocol
    protocol.transport.pause_reading()
    answers = []

    def is_cut_off() -> bool:
        request = ua.ReadRequest()
        request.Parameters.NodesToRead = [status] * 300
        answers.append(protocol._send_request(request))
        return protocol.transport.is_closing()

    await eventually(is_cut_off)
    client.disconnect_socket()
    for answer in answers:
        answer.cancel()
    await asyncio.gather(*answers, return_exceptions=True)
    async with Client(served, timeout=PATIENCE_S) as other:
        assert await other.nodes.objects.get_children()


async def test_a_session_ends_with_its_connection(served):
    """Were they kept, the limit of all subscriptions would be reached."""
    for _ in range(25):
        client = Client(served, timeout=PATIENCE_S)
        await client.connect()
        for _ in range(10):
            await client.create_subscription(500, Handler())
        client.uaclient.protocol.transport.abort()
        client.disconnect_socket()
    async with Client(served, timeout=PATIENCE_S) as client:

        async def created():
            try:
                return await client.create_subscription(500, Handler())
            except ua.uaerrors.BadTooManySubscriptions:
                return None

        assert await eventually(created)


FLOOD = """
import asyncio, sys
from asyncua import Client, ua
from tests.outlets.test_opcua_limits import MANY_REFERENCES, _browse, _read

async def main():
    async with Client(sys.argv[1], timeout=600) as client:
        print("flooding", flush=True)
        while True:
            await client.uaclient.browse(_browse(100, MANY_REFERENCES))
            await client.uaclient.read(_read(1000))

asyncio.run(main())
"""


async def test_the_page_answers_while_opcua_is_flooded():
    listen, url = f"127.0.0.1:{free_port()}", f"opc.tcp://127.0.0.1:{free_port()}"
    with fed_outlets(opcua=Opcua(listen=url), page=Page(listen=listen)) as feed:
        until(lambda: feed.said()["reason"] is None)
        until(lambda: feed.said()["reason"] is None)
        feed.estimate()
        page = f"http://{listen}/recent.json"
        flooding = [
            subprocess.Popen([sys.executable, "-c", FLOOD, url], stdout=subprocess.PIPE) for _ in range(2)
        ]
        try:
            for process in flooding:
                assert process.stdout.readline() == b"flooding\n"
            longest_s = await asyncio.to_thread(_longest_s, page, feed.process.pid)
        finally:
            for process in flooding:
                process.kill()
                process.wait(PATIENCE_S)
                process.stdout.close()
        async with Client(url, timeout=PATIENCE_S) as client:
            with pytest.raises(ua.uaerrors.BadTooManyOperations):
                await client.uaclient.browse(_browse(MANY // 5))
        assert longest_s < SOON_S


def _longest_s(page: str, pid: int) -> float:
    longest_s = 0.0
    for _ in range(20):
        watch = Stopwatch(pid)
        with urllib.request.urlopen(page, timeout=PATIENCE_S) as answer:
            assert answer.status == 200
        longest_s = max(longest_s, watch.took_s())
    return longest_s
