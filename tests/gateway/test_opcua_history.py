"""HistoryRead over the wire, by a real client: what was recorded, raw and aggregated by interval."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from asyncua import Client, ua
from asyncua.ua.object_ids import ObjectIds

from observer.gateway.opcua import NAMESPACE, STATUS
from observer.publish.codec import config_json, decode_estimate
from observer.tables.gateway import Opcua
from tests.archive.lived import BEGIN_S, PERIOD_S, configuration, lived
from tests.gateway.feeding import fed_gateway
from tests.patience import eventually, until
from tests.publish.router import free_port

pytestmark = pytest.mark.system
HEAT = ("lathe", "z", "Heat", "nut", "Heat_W")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("opcua")
    config = configuration(folder)
    named = config.machine.model_copy(update={"name": "lathe", "axis": "z"})
    config = config.model_copy(update={"machine": named})
    estimates, _, _ = lived(config, 400, rotate_bytes=20_000)
    return config, estimates


def _at(since_s: float) -> datetime:
    return datetime.fromtimestamp(BEGIN_S + since_s, UTC).replace(tzinfo=None)


async def _node(client: Client, *path: str):
    index = await client.get_namespace_index(NAMESPACE)

    async def found():
        try:
            return await client.nodes.objects.get_child([f"{index}:{part}" for part in path])
        except ua.UaError:
            return None

    return await eventually(found)


async def _read(client: Client, node, details, point: bytes | None = None) -> ua.HistoryReadResult:
    value = ua.HistoryReadValueId(NodeId=node.nodeid, ContinuationPoint=point)
    asked = ua.HistoryReadParameters(HistoryReadDetails=details, NodesToRead=[value])
    (result,) = await client.uaclient.history_read(asked)
    return result


def _aggregate(function: int, from_s: float, to_s: float, interval_s: float) -> ua.ReadProcessedDetails:
    kind = ua.NodeId(function, 0)
    return ua.ReadProcessedDetails(
        StartTime=_at(from_s), EndTime=_at(to_s), ProcessingInterval=1000.0 * interval_s, AggregateType=[kind]
    )


async def test_a_client_reads_what_was_published(recorded):
    config, messages = recorded
    published = [decode_estimate(message) for message in messages]
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    folder = config.record.directory
    with fed_gateway(opcua=Opcua(listen=url), recordings=folder) as feed:
        until(lambda: feed.said()["reason"] is None)
        feed.send("config", config_json(config, "00000001").encode())
        feed.send("estimate", messages[-1])
        async with Client(url, timeout=60, watchdog_intervall=60.0) as client:
            node = await _node(client, *HEAT)
            assert await node.read_attribute(ua.AttributeIds.Historizing)
            assert ua.AccessLevel.HistoryRead in await node.get_access_level()
            nut = published[0]["sources"].index("nut")
            heats = np.array([float(e["heat_W"][nut]) for e in published])
            wanted = [(STATUS[e["quality"]], round(e["time_s"], 3)) for e in published]

            def stamps(values):
                return [
                    (v.StatusCode.value, round(v.SourceTimestamp.replace(tzinfo=UTC).timestamp(), 3))
                    for v in values
                ]

            whole = await node.read_raw_history(_at(0), _at(199.5))
            assert stamps(whole) == wanted
            np.testing.assert_allclose([v.Value.Value for v in whole], heats, rtol=1e-6)
            few = await _read(client, node, ua.ReadRawModifiedDetails(
                StartTime=_at(10), EndTime=_at(60), NumValuesPerNode=7))  # fmt: skip
            assert stamps(few.HistoryData.DataValues) == wanted[20:27]
            next_ = await _read(
                client, node,
                ua.ReadRawModifiedDetails(StartTime=_at(10), EndTime=_at(60), NumValuesPerNode=7),
                few.ContinuationPoint,
            )  # fmt: skip
            assert stamps(next_.HistoryData.DataValues) == wanted[27:34]
            back = await _read(client, node, ua.ReadRawModifiedDetails(
                StartTime=_at(60), EndTime=_at(10), NumValuesPerNode=5))  # fmt: skip
            assert stamps(back.HistoryData.DataValues) == wanted[120:115:-1]
            rest = await _read(
                client, node,
                ua.ReadRawModifiedDetails(StartTime=_at(60), EndTime=_at(10), NumValuesPerNode=5),
                back.ContinuationPoint,
            )  # fmt: skip
            assert stamps(rest.HistoryData.DataValues) == wanted[115:110:-1]

            for function, by in (
                (ObjectIds.AggregateFunction_Average, np.mean),
                (ObjectIds.AggregateFunction_Minimum, np.min),
                (ObjectIds.AggregateFunction_Maximum, np.max),
            ):
                found = await _read(client, node, _aggregate(function, 100.0, 160.0, 20.0))
                values = found.HistoryData.DataValues
                steps = int(20.0 / PERIOD_S)
                expected = [by(part) for part in _batched(heats[200:320].tolist(), steps)]
                np.testing.assert_allclose([v.Value.Value for v in values], expected, rtol=1e-5)
                assert all(v.StatusCode.value & 0x401 == 0x401 for v in values)
            none = await _read(client, node, _aggregate(ObjectIds.AggregateFunction_Count, 0.0, 9.0, 9.0))
            assert none.StatusCode.value == ua.StatusCodes.BadAggregateNotSupported
            before = _aggregate(ObjectIds.AggregateFunction_Average, -99.0, -9.0, 45.0)
            nothing = await _read(client, node, before)
            assert [v.StatusCode.value & 0xFFFF0000 for v in nothing.HistoryData.DataValues] == [
                ua.StatusCodes.BadNoData
            ] * 2
            field = await _node(client, "lathe", "z", "Field", "Temperature_degC")
            (first, *_) = await field.read_raw_history(_at(50), _at(51))
            np.testing.assert_allclose(first.Value.Value, published[100]["field_degC"], rtol=1e-6)


def _batched(values: list[float], n: int):
    return [values[i : i + n] for i in range(0, len(values), n)]


FORGED = [bytes(3), bytes(9), bytes(8), b"\xff" * 8, b"\x00\x01" * 4, b"x" * 4000]
INTERVALS_MS = [float("nan"), float("inf"), -float("inf"), -1.0, 1e-300, 1e300]


async def test_a_hostile_history_read_gets_an_error_and_ends_no_process(recorded):
    config, messages = recorded
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    with fed_gateway(opcua=Opcua(listen=url), recordings=config.record.directory) as feed:
        until(lambda: feed.said()["reason"] is None)
        feed.send("config", config_json(config, "00000001").encode())
        feed.send("estimate", messages[-1])
        async with Client(url, timeout=60, watchdog_intervall=60.0) as client:
            node = await _node(client, *HEAT)
            assert len(await node.read_raw_history(_at(0), _at(9))) == 19
            archive = _children(feed.process.pid)
            average = ObjectIds.AggregateFunction_Average
            raw = ua.ReadRawModifiedDetails(StartTime=_at(10), EndTime=_at(60), NumValuesPerNode=7)
            for details in (raw, _aggregate(average, 0.0, 90.0, 30.0)):
                for point in FORGED:
                    answer = await _read(client, node, details, point)
                    assert answer.StatusCode.value == ua.StatusCodes.BadContinuationPointInvalid, point
            for interval_ms in INTERVALS_MS[:-1]:
                answer = await _read(client, node, _aggregate(average, 0.0, 90.0, interval_ms / 1000.0))
                assert answer.StatusCode.value == ua.StatusCodes.BadHistoryOperationInvalid, interval_ms
            whole = await _read(client, node, _aggregate(average, 0.0, 90.0, INTERVALS_MS[-1]))
            assert len(whole.HistoryData.DataValues) == 1
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
