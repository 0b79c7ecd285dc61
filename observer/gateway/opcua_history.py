"""OPC UA's HistoryRead of estimates, answered from the recordings: raw values, and one per interval.

asyncua answers raw reads from a storage; here that is the archive, which keeps nothing of its own. It does
not know processed reads (part 11, 6.5.4); Average, Minimum and Maximum are added, a page of values at a time
with a continuation point, which is the time to continue from.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import cbor2
from asyncua import ua
from asyncua.common.node import Node
from asyncua.common.utils import Buffer, ServiceError
from asyncua.server.history import HistoryManager, HistoryStorageInterface
from asyncua.server.server import Server
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds
from asyncua.ua.status_codes import StatusCodes

from observer.archive.client import Archivist
from observer.archive.series import has_history
from observer.exchange import PastReply

MOST_VALUES = 5000
"""Of an answer; a continuation point gives the rest."""
_MOST_INTERVALS = 500
_LEAST_INTERVAL_S = 1e-3
_LEAST_VALUES = 50  # of a node, where many are read at once
_ATTEMPTS = 5
_FUNCTIONS: dict[Any, str] = {
    ObjectIds.AggregateFunction_Average: "average",
    ObjectIds.AggregateFunction_Minimum: "minimum",
    ObjectIds.AggregateFunction_Maximum: "maximum",
}
_OPEN = datetime(1602, 1, 1, tzinfo=UTC).timestamp()
"""An earlier time means none (part 11, 6.5.3.2)."""

_POINT_BYTES = 8
_LATEST_S = 1e11
_TICK_S = 1e-6  # both ends are included, and OPC UA's times are cut to 0.1 µs

Encode = Callable[[Any, str, float], ua.DataValue]


class PastValues(HistoryStorageInterface):
    """The history of the nodes with a recorded past; `encode` makes a value with its status."""

    def __init__(self, archivist: Callable[[], Archivist], encode: Encode) -> None:
        super().__init__(MOST_VALUES)
        self._archivist, self._encode = archivist, encode
        self._paths: dict[ua.NodeId, tuple[str, ...]] = {}

    async def init(self) -> None:
        """Begin; there is nothing to open."""

    async def stop(self) -> None:
        """End; there is nothing to close."""

    async def add(self, node: Node, path: tuple[str, ...]) -> None:
        """Show clients that a node has a history, if it has one."""
        if has_history(path):
            self._paths[node.nodeid] = path
            for attribute in (AttributeIds.AccessLevel, AttributeIds.UserAccessLevel):
                await node.set_attr_bit(attribute, ua.AccessLevel.HistoryRead)
            yes = ua.DataValue(ua.Variant(True, ua.VariantType.Boolean))
            await node.write_attribute(AttributeIds.Historizing, yes)

    async def read_node_history(
        self, node_id: ua.NodeId, start: datetime | None, end: datetime | None, nb_values: int
    ) -> tuple[list[ua.DataValue], datetime | None]:
        """The values from one time to another, of the later time first if that is `start`.

        Where one of the two is missing `nb_values` limits them. Raises `ServiceError`.
        """
        path = self._path(node_id)
        start_s, end_s = _seconds(start), _seconds(end)
        if (start_s is None and end_s is None) or (None in (start_s, end_s) and not nb_values):
            raise ServiceError(StatusCodes.BadHistoryOperationInvalid)
        backwards = start_s is None or (end_s is not None and end_s < start_s)
        low, high = (end_s, start_s) if backwards else (start_s, end_s)
        if start_s is None:
            low, high = -math.inf, end_s
        most = min(nb_values or MOST_VALUES, MOST_VALUES)
        question = {
            "node": path,
            "from_s": _bounded(low, -1e11),
            "to_s": _bounded(high, 1e11) + _TICK_S,
            "most": most,
            "backwards": backwards,
        }
        found = await self._ask("series", question)
        rows = zip(found["values"], found["quality"], found["time_s"], strict=True)
        values = [self._encode(value, quality, time_s) for value, quality, time_s in rows]
        more = found["next"] is not None and not (None in (start_s, end_s) and nb_values)
        return values, _moment(found["next"]) if more else None

    async def processed(
        self, rv: ua.HistoryReadValueId, details: ua.ReadProcessedDetails, function: ua.NodeId
    ) -> ua.HistoryReadResult:
        """The values of each interval, by one of the functions; raises `ServiceError`."""
        by = _FUNCTIONS.get(function.Identifier) if function.NamespaceIndex == 0 else None
        if by is None:
            raise ServiceError(StatusCodes.BadAggregateNotSupported)
        path, interval_s = self._path(rv.NodeId), details.ProcessingInterval / 1000.0
        start_s, end_s = _seconds(details.StartTime), _seconds(details.EndTime)
        if start_s is None or end_s is None or start_s >= end_s:
            raise ServiceError(StatusCodes.BadHistoryOperationInvalid)
        if not (interval_s == 0.0 or _LEAST_INTERVAL_S <= interval_s < math.inf):
            raise ServiceError(StatusCodes.BadHistoryOperationInvalid)
        if rv.ContinuationPoint:
            start_s = _continued(rv.ContinuationPoint, details.StartTime, details.EndTime)
        interval_s = interval_s or end_s - start_s
        stop_s = min(end_s, start_s + _MOST_INTERVALS * interval_s, start_s + max(interval_s, _SPAN_S))
        if stop_s < end_s:  # whole intervals, so that the next answer starts with one
            stop_s = start_s + interval_s * max(1, math.floor((stop_s - start_s) / interval_s + 1e-9))
        question = {"node": path, "from_s": start_s, "to_s": stop_s, "interval_s": interval_s, "by": by}
        found = await self._ask("aggregated", question)
        rows = zip(found["values"], found["quality"], found["time_s"], strict=True)
        data = ua.HistoryData(DataValues=[_calculated(self._encode(*row)) for row in rows])
        more = ua.ua_binary.Primitives.DateTime.pack(_moment(stop_s)) if stop_s < end_s - _TICK_S else None
        return ua.HistoryReadResult(HistoryData=data, ContinuationPoint=more)

    def _path(self, node_id: ua.NodeId) -> tuple[str, ...]:
        if node_id not in self._paths:
            raise ServiceError(StatusCodes.BadHistoryOperationUnsupported)
        return self._paths[node_id]

    async def _ask(self, what: str, question: dict[str, Any]) -> dict[str, Any]:
        """Query the archive, again while it is still reading; raises `ServiceError`."""
        reply = PastReply(b"")
        for _ in range(_ATTEMPTS):
            reply = await asyncio.to_thread(self._archivist().ask, what, question)
            if not reply.unfinished:
                break
        if reply.reason is not None:
            unfinished = StatusCodes.BadTimeout, StatusCodes.BadHistoryOperationUnsupported
            raise ServiceError(unfinished[0] if reply.unfinished else unfinished[1])
        found: dict[str, Any] = cbor2.loads(reply.payload)
        return found

    async def new_historized_node(self, node_id: Any, period: Any, count: int = 0) -> None:
        """Nothing to do: the recorder keeps it."""

    async def save_node_value(self, node_id: Any, datavalue: Any) -> None:
        """Nothing to do: the recorder keeps it."""


_SPAN_S = 6 * 3600.0
"""What is read for one answer of intervals, but for an interval that is longer."""


class PastManager(HistoryManager):
    """Answers processed reads too, and reports errors by node instead of one fault for all."""

    async def read_history(self, params: ua.HistoryReadParameters) -> list[ua.HistoryReadResult]:
        """Read the history of a few nodes, which share the values of one answer."""
        count, details = len(params.NodesToRead), params.HistoryReadDetails
        if isinstance(details, ua.ReadRawModifiedDetails) and count > 1:
            most = max(_LEAST_VALUES, MOST_VALUES // count)
            details.NumValuesPerNode = ua.Counter(min(details.NumValuesPerNode or most, most))
        results: list[ua.HistoryReadResult] = await super().read_history(params)
        return results

    async def _read_history(self, details: Any, rv: ua.HistoryReadValueId) -> ua.HistoryReadResult:
        storage = self.storage
        try:
            if isinstance(details, ua.ReadProcessedDetails) and isinstance(storage, PastValues):
                (function, *_) = [*details.AggregateType, ua.NodeId()]
                return await storage.processed(rv, details, function)
            if rv.ContinuationPoint and isinstance(details, ua.ReadRawModifiedDetails):
                _continued(rv.ContinuationPoint, details.StartTime, details.EndTime)
            return await super()._read_history(details, rv)
        except ServiceError as error:
            return ua.HistoryReadResult(StatusCode=ua.StatusCode(ua.UInt32(error.code)))


def give_history(server: Server, storage: PastValues) -> None:
    """Make a server answer from a storage; before it is started."""
    server.iserver.history_manager = PastManager(server.iserver)
    server.iserver.history_manager.set_storage(storage)


def _seconds(moment: datetime | None) -> float | None:
    """A time as seconds since 1970, None where it stands for none."""
    if moment is None:
        return None
    time_s = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return None if time_s <= _OPEN else time_s


def _continued(point: bytes, start: datetime | None, end: datetime | None) -> float:
    """The time, in seconds since 1970, at which an answer goes on.

    Raises `ServiceError` for a point that no answer about this span has given.
    """
    time_s = None
    if len(point) == _POINT_BYTES:
        time_s = _seconds(ua.ua_binary.Primitives.DateTime.unpack(Buffer(point)))
    ends_s = [end_s for end_s in (_seconds(start), _seconds(end)) if end_s is not None]
    first_s, last_s = min(ends_s, default=0.0), max(ends_s, default=0.0)
    is_within = time_s is not None and (len(ends_s) < 2 or first_s <= time_s <= last_s)
    if time_s is None or not is_within or abs(time_s) > _LATEST_S:
        raise ServiceError(StatusCodes.BadContinuationPointInvalid)
    return time_s


def _bounded(time_s: float | None, default_s: float) -> float:
    return default_s if time_s is None or not math.isfinite(time_s) else time_s


def _moment(time_s: float) -> datetime:
    return datetime.fromtimestamp(time_s, UTC).replace(tzinfo=None)


_CALCULATED = 0x401  # the value is an aggregate, computed (part 11, 6.3)


def _calculated(value: ua.DataValue) -> ua.DataValue:
    """The value, whose status says that it was computed."""
    assert value.StatusCode is not None
    value.StatusCode = ua.StatusCode(ua.UInt32(value.StatusCode.value | _CALCULATED))
    return value
