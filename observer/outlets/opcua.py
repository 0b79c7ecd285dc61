"""A server of OPC UA: the documents' figures as variables, their quality as status codes.

| quality | status code |
|---|---|
| `good` | Good |
| `starting` | UncertainInitialValue |
| `degraded` | UncertainSubNormal |
| `stale`, or a service that is silent | UncertainLastUsableValue |
| `invalid`, or not known | BadNoData |

Source timestamps are the times of the estimates. Nothing can be written.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC
from typing import Any, NamedTuple

from asyncua import ua
from asyncua.common.node import Node
from asyncua.server.server import Server
from asyncua.ua.status_codes import StatusCodes

from observer.bus.exchange import KEYS, KeyFigure
from observer.config.outlets import ReportState
from observer.outlets.messages import Latest
from observer.outlets.opcua_history import PastValues
from observer.outlets.opcua_server import guarded
from observer.outlets.start import Start

# asyncua logs every client error with a traceback, which would fill the service's log.
logging.getLogger("asyncua").setLevel(logging.CRITICAL)

NAMESPACE = "urn:ballscrew-observer"
PERIOD_S = 0.25
STATUS = {
    "good": StatusCodes.Good,
    "starting": StatusCodes.UncertainInitialValue,
    "degraded": StatusCodes.UncertainSubNormal,
    "stale": StatusCodes.UncertainLastUsableValue,
    "invalid": StatusCodes.BadNoData,
}


class Value(NamedTuple):
    """A variable: its path below the axis, value, quality, and time (epoch)."""

    path: tuple[str, ...]
    value: Any
    quality: str
    time_s: float


async def serve(start: Start, latest: Latest, report_state: ReportState) -> None:
    """Serve until cancelled; raises `OSError` or `ConfigError` with one sentence where it cannot."""
    assert start.opcua is not None
    server = await guarded(start.opcua)
    server.set_endpoint(start.opcua.listen)
    server.set_server_name("Ballscrew Observer")
    past = start.past
    storage = None if past is None else PastValues(past, _data)
    if storage is not None:
        server.iserver.history_manager.set_storage(storage)
    index = await server.register_namespace(NAMESPACE)
    machine = await server.nodes.objects.add_object(index, start.machine)
    axis = await machine.add_object(index, start.axis)
    try:
        await server.start()
    except OSError as error:
        raise OSError(
            f"cannot listen on {start.opcua.listen} ({error.strerror}); change opcua.listen"
        ) from None
    report_state({"reason": None, "address": start.opcua.listen})
    tree = _Tree(server, index, axis, storage)
    try:
        while True:
            await tree.write_all(values(latest))
            await asyncio.sleep(PERIOD_S)
    finally:
        await server.stop()


def values(latest: Latest) -> Iterator[Value]:
    """Yield every variable known now."""
    silent = latest.is_stale
    for name, key in KEYS.items():
        document = latest.document(name) if key.figures else {}
        for figure in key.figures if document else ():
            quality = figure.quality(document) or "invalid" if key.rated else "good"
            yield from _values(figure, document, "stale" if silent else quality)
    if alarms := latest.document("alarms"):
        words = [
            f"{a['severity']} {a['id']} ({a['state']}): {a['reason']}; {a['remedy']}"
            for a in alarms["alarms"]
        ]
        quality = "stale" if silent else "good"
        yield Value(("Alarms", "Raised"), words, quality, alarms["time_s"])
        yield Value(("Alarms", "Count"), float(len(words)), quality, alarms["time_s"])


def _values(figure: KeyFigure, document: Mapping[str, Any], quality: str) -> Iterator[Value]:
    """The variables of a figure: one for each entry, or the column as an array."""
    if figure.node is None:
        return
    path, rows = figure.node.split("/"), figure.rows(document)
    if figure.by is not None and "{}" not in path:
        if rows:
            yield Value(tuple(path), [float(value) for _, value in rows], quality, document["time_s"])
        return
    used = document.get(figure.used or "", ())
    for i, (name, value) in enumerate(rows):
        unused = quality != "stale" and i < len(used) and used[i] != "good"
        place = tuple(name if part == "{}" else part for part in path)
        yield Value(place, _plain(value), "invalid" if unused else quality, document["time_s"])


def _plain(value: Any) -> Any:
    """Return text and lists unchanged, a number as a float, and NaN for an unknown number."""
    if isinstance(value, (str, list, tuple)):
        return list(value) if isinstance(value, tuple) else value
    return math.nan if value is None else float(value)


class _Tree:
    """The variables below an axis, made when their first value comes."""

    def __init__(self, server: Server, index: int, axis: Node, storage: PastValues | None) -> None:
        self._server, self._index, self._axis, self._storage = server, index, axis, storage
        self._folders: dict[tuple[str, ...], Node] = {(): axis}
        self._variables: dict[tuple[str, ...], Node] = {}
        self._written: dict[tuple[str, ...], Value] = {}

    async def write_all(self, current: Iterable[Value]) -> None:
        """Write the variables that have changed; others become invalid."""
        unknown = {path: last._replace(quality="invalid") for path, last in self._written.items()}
        for value in (unknown | {value.path: value for value in current}).values():
            await self._write(value)

    async def _write(self, value: Value) -> None:
        """Write a variable if it has changed."""
        last = self._written.get(value.path)
        if last is not None and (last.quality, last.time_s) == (value.quality, value.time_s):
            return
        self._written[value.path] = value
        data = _data(value.value, value.quality, value.time_s)
        assert data.Value is not None
        node = self._variables.get(value.path) or await self._create_variable(value.path, data.Value)
        await self._server.write_attribute_value(node.nodeid, data)

    async def _create_variable(self, path: tuple[str, ...], variant: ua.Variant) -> Node:
        for depth in range(1, len(path)):
            if path[:depth] not in self._folders:
                above = self._folders[path[: depth - 1]]
                self._folders[path[:depth]] = await above.add_object(self._index, path[depth - 1])
        folder = self._folders[path[:-1]]
        node = await folder.add_variable(self._index, path[-1], variant)
        self._variables[path] = node
        if self._storage is not None:
            await self._storage.add(node, path)
        return node


def _data(value: Any, quality: str, time_s: float) -> ua.DataValue:
    """A value with its quality as status, BadNoData for NaN, and its time."""
    is_unknown = isinstance(value, float) and math.isnan(value)
    status = StatusCodes.BadNoData if is_unknown else STATUS[quality]
    at = ua.DateTime.fromtimestamp(time_s, UTC).replace(tzinfo=None)
    return ua.DataValue(_variant(value), ua.StatusCode(ua.UInt32(status)), SourceTimestamp=at)


def _variant(value: Any) -> ua.Variant:
    if isinstance(value, list):
        kind = ua.VariantType.Double if value and isinstance(value[0], float) else ua.VariantType.String
        return ua.Variant(value, kind, is_array=True)
    return ua.Variant(value, ua.VariantType.String if isinstance(value, str) else ua.VariantType.Double)
