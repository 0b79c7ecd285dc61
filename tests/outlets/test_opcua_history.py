"""HistoryRead over the wire, by a real client: raw values of what was recorded."""

from __future__ import annotations

from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from asyncua import Client, ua

from observer.bus.codec import config_json, decode_estimate
from observer.config.outlets import Opcua
from observer.outlets.opcua import STATUS
from tests.bus.router import free_port
from tests.outlets.feeding import fed_outlets
from tests.outlets.nodes import node_of
from tests.patience import until
from tests.record.lived import BEGIN_S, configuration, lived

pytestmark = pytest.mark.system


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("opcua")
    config = configuration(folder)
    named = config.machine.model_copy(update={"name": "lathe", "axis": "z"})
    config = config.model_copy(update={"machine": named})
    estimates, _, _ = lived(config, 400, rotate_bytes=20_000)
    return config, estimates


@asynccontextmanager
async def connected(recorded):
    """A client of outlets that have the recordings and the newest estimate; and what feeds them."""
    config, messages = recorded
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    with fed_outlets(opcua=Opcua(listen=url), recordings=config.record.directory) as feed:
        until(lambda: feed.said()["reason"] is None)
        feed.send("config", config_json(config, "00000001").encode())
        feed.send("estimate", messages[-1])
        async with Client(url, timeout=60, watchdog_intervall=60.0) as client:
            yield client, feed


def _at(since_s: float) -> datetime:
    return datetime.fromtimestamp(BEGIN_S + since_s, UTC).replace(tzinfo=None)


async def _read(client: Client, node, details, point: bytes | None = None) -> ua.HistoryReadResult:
    value = ua.HistoryReadValueId(NodeId=node.nodeid, ContinuationPoint=point)
    asked = ua.HistoryReadParameters(HistoryReadDetails=details, NodesToRead=[value])
    (result,) = await client.uaclient.history_read(asked)
    return result


def _stamps(values):
    return [(v.StatusCode.value, round(v.SourceTimestamp.replace(tzinfo=UTC).timestamp(), 3)) for v in values]


async def test_a_client_reads_what_was_published(recorded):
    published = [decode_estimate(message) for message in recorded[1]]
    nut = published[0]["sources"].index("nut")
    wanted = [(STATUS[e["quality"]], round(e["time_s"], 3)) for e in published]
    async with connected(recorded) as (client, _feed):
        node = await node_of(client)
        assert await node.read_attribute(ua.AttributeIds.Historizing)
        assert ua.AccessLevel.HistoryRead in await node.get_access_level()
        whole = await node.read_raw_history(_at(0), _at(199.5))
        assert _stamps(whole) == wanted
        heats = [float(e["heat_W"][nut]) for e in published]
        np.testing.assert_allclose([v.Value.Value for v in whole], heats, rtol=1e-6)
        for from_s, to_s, first, second in (
            (10, 60, wanted[20:27], wanted[27:34]),
            (60, 10, wanted[120:113:-1], wanted[113:106:-1]),  # backwards
        ):
            asked = ua.ReadRawModifiedDetails(StartTime=_at(from_s), EndTime=_at(to_s), NumValuesPerNode=7)
            few = await _read(client, node, asked)
            assert _stamps(few.HistoryData.DataValues) == first
            rest = await _read(client, node, asked, few.ContinuationPoint)
            assert _stamps(rest.HistoryData.DataValues) == second
        field = await node_of(client, "lathe", "z", "Field", "Temperature_degC")
        (first, *_) = await field.read_raw_history(_at(50), _at(51))
        np.testing.assert_allclose(first.Value.Value, published[100]["field_degC"], rtol=1e-6)


FORGED = [bytes(3), bytes(9), bytes(8), b"\xff" * 8, b"\x00\x01" * 4, b"x" * 4000]


async def test_a_hostile_history_read_gets_an_error_and_ends_no_process(recorded):
    async with connected(recorded) as (client, feed):
        node = await node_of(client)
        assert len(await node.read_raw_history(_at(0), _at(9))) == 19
        archive = _children(feed.process.pid)
        raw = ua.ReadRawModifiedDetails(StartTime=_at(10), EndTime=_at(60), NumValuesPerNode=7)
        for point in FORGED:
            answer = await _read(client, node, raw, point)
            assert answer.StatusCode.value == ua.StatusCodes.BadContinuationPointInvalid, point
        assert _children(feed.process.pid) == archive
        asked = ua.HistoryReadParameters(
            HistoryReadDetails=raw, NodesToRead=[ua.HistoryReadValueId(NodeId=node.nodeid)] * 3000
        )
        with pytest.raises(ua.uaerrors.BadTooManyOperations):
            await client.uaclient.history_read(asked)
        assert len(await node.read_raw_history(_at(0), _at(9))) == 19


def _children(pid: int) -> list[str]:
    """The processes that a process has started."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return sorted(child for task in tasks for child in (task / "children").read_text().split())


async def test_aggregates_are_refused_and_an_unknown_node_spoils_no_other(recorded):
    async with connected(recorded) as (client, _feed):
        node = await node_of(client)
        processed = ua.ReadProcessedDetails(
            StartTime=_at(0), EndTime=_at(90), ProcessingInterval=30_000.0,
            AggregateType=[ua.NodeId(ua.ObjectIds.AggregateFunction_Average)],
        )  # fmt: skip
        answer = await _read(client, node, processed)
        assert answer.StatusCode.value == ua.StatusCodes.BadNotImplemented
        raw = ua.ReadRawModifiedDetails(StartTime=_at(0), EndTime=_at(9))
        nodes = [ua.NodeId(ua.ObjectIds.Server), node.nodeid]
        both = ua.HistoryReadParameters(
            HistoryReadDetails=raw, NodesToRead=[ua.HistoryReadValueId(NodeId=one) for one in nodes]
        )
        unknown, heat = await client.uaclient.history_read(both)
        assert unknown.StatusCode.value == ua.StatusCodes.BadHistoryOperationUnsupported
        assert len(heat.HistoryData.DataValues) == 19
