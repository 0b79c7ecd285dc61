"""OPC UA's HistoryRead of estimates, raw values only, answered from the published steps.

asyncua reads histories from a storage. This one only reads the past. A continuation point is the time of the
next value.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.common.node import Node
from asyncua.common.utils import Buffer, ServiceError
from asyncua.server.history import HistoryStorageInterface
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.status_codes import StatusCodes

from observer.errors import UserError
from observer.record.series import Series, has_history, series
from observer.record.step_store import Past

MOST_VALUES = 5000
"""Of an answer; a continuation point gives the remaining ones."""
_OPEN_S = datetime(1602, 1, 1, tzinfo=UTC).timestamp()
"""An earlier time stands for no time (part 11, 6.5.3.2)."""
_POINT_BYTES = 8
_LATEST_S = 1e11
_TICK_S = 1e-6  # both ends are included, and OPC UA's times are cut to 0.1 µs

Encode = Callable[[Any, str, float], ua.DataValue]


class PastValues(HistoryStorageInterface):
    """The history of the nodes with a recorded past; `encode` makes a value with its status."""

    def __init__(self, past: Past, encode: Encode) -> None:
        super().__init__(MOST_VALUES)
        self._past, self._encode = past, encode
        self._paths: dict[ua.NodeId, tuple[str, ...]] = {}

    async def init(self) -> None:
        """Begin, without a file or connection to open."""

    async def stop(self) -> None:
        """End, without a file or connection to close."""

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
        if node_id not in self._paths:
            raise ServiceError(StatusCodes.BadHistoryOperationUnsupported)
        start_s, end_s = _seconds(start), _seconds(end)
        if (start_s is None and end_s is None) or (None in (start_s, end_s) and not nb_values):
            raise ServiceError(StatusCodes.BadHistoryOperationInvalid)
        backwards = start_s is None or (end_s is not None and end_s < start_s)
        low, high = (end_s, start_s) if backwards else (start_s, end_s)
        if start_s is None:
            low, high = -math.inf, end_s
        path, most = self._paths[node_id], min(nb_values or MOST_VALUES, MOST_VALUES)
        from_s, to_s = _bounded(low, -_LATEST_S), _bounded(high, _LATEST_S) + _TICK_S

        def read() -> Series:
            return series(self._past, path, from_s, to_s, most, backwards=backwards)

        try:
            answer = await asyncio.to_thread(read)
        except UserError:
            raise ServiceError(StatusCodes.BadHistoryOperationUnsupported) from None
        rows = zip(answer.values, answer.quality, answer.time_s, strict=True)
        values = [self._encode(value, quality, time_s) for value, quality, time_s in rows]
        goes_on = answer.next_s is not None and not (None in (start_s, end_s) and nb_values)
        return values, None if answer.next_s is None or not goes_on else _moment(answer.next_s)


def check_continuation_point(point: bytes, details: ua.ReadRawModifiedDetails) -> None:
    """Raise `ServiceError` for a point that no answer about this span has given."""
    time_s = None
    if len(point) == _POINT_BYTES:
        time_s = _seconds(ua.ua_binary.Primitives.DateTime.unpack(Buffer(point)))
    ends_s = [_seconds(moment) for moment in (details.StartTime, details.EndTime)]
    span_s = [end_s for end_s in ends_s if end_s is not None]
    is_within = time_s is not None and (len(span_s) < len(ends_s) or min(span_s) <= time_s <= max(span_s))
    if time_s is None or not is_within or abs(time_s) > _LATEST_S:
        raise ServiceError(StatusCodes.BadContinuationPointInvalid)


def _seconds(moment: datetime | None) -> float | None:
    """Return a time in seconds since 1970, None for a missing time."""
    if moment is None:
        return None
    time_s = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return None if time_s <= _OPEN_S else time_s


def _bounded(time_s: float | None, default_s: float) -> float:
    return default_s if time_s is None or not math.isfinite(time_s) else time_s


def _moment(time_s: float) -> datetime:
    return datetime.fromtimestamp(time_s, UTC).replace(tzinfo=None)
