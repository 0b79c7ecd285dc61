"""A server of OPC UA: estimates and what surrounds them as variables, their quality as status codes.

| quality | status code |
|---|---|
| `good` | Good |
| `starting` | UncertainInitialValue |
| `degraded` | UncertainSubNormal |
| `stale`, or a service that is silent | UncertainLastUsableValue |
| `invalid`, or not known | BadNoData |

Source timestamps are the estimates' own times. Nothing can be written.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Iterator, Mapping
from datetime import UTC
from typing import Any, NamedTuple

from asyncua import ua
from asyncua.common.node import Node
from asyncua.server.server import Server
from asyncua.ua.status_codes import StatusCodes

from observer.gateway.messages import Latest
from observer.gateway.opcua_server import guarded
from observer.gateway.start import Say, Start

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
    """A variable: its place below the axis, its value, what that is worth, and of when it is (epoch)."""

    path: tuple[str, ...]
    value: Any
    quality: str
    time_s: float


async def serve(start: Start, latest: Latest, say: Say) -> None:
    """Serve until cancelled; raises `OSError` or `ConfigError` with one sentence where it cannot."""
    assert start.opcua is not None
    server = await guarded(start.opcua)
    server.set_endpoint(start.opcua.listen)
    server.set_server_name("Ballscrew Observer")
    index = await server.register_namespace(NAMESPACE)
    machine = await server.nodes.objects.add_object(index, start.machine)
    axis = await machine.add_object(index, start.axis)
    try:
        await server.start()
    except OSError as error:
        raise OSError(
            f"cannot listen on {start.opcua.listen} ({error.strerror}); change opcua.listen"
        ) from None
    say({"reason": None, "address": start.opcua.listen})
    tree = _Tree(server, index, axis)
    try:
        while True:
            for value in values(latest):
                await tree.write(value)
            await asyncio.sleep(PERIOD_S)
    finally:
        await server.stop()


def values(latest: Latest) -> Iterator[Value]:
    """Yield every variable known now."""
    silent = latest.is_stale
    if estimate := latest.document("estimate"):
        yield from _of_estimate(estimate, "stale" if silent else estimate["quality"])
    own = "stale" if silent else "good"
    if health := latest.document("health"):
        yield Value(("Health", "State"), "stale" if silent else health["state"], own, health["time_s"])
        yield Value(("Health", "Reasons"), list(health["reasons"]), own, health["time_s"])
    if alarms := latest.document("alarms"):
        words = [f"{a['severity']} {a['id']} ({a['state']}): {a['reason']}" for a in alarms["alarms"]]
        yield Value(("Alarms", "Raised"), words, own, alarms["time_s"])
        yield Value(("Alarms", "Count"), float(len(words)), own, alarms["time_s"])
    if learned := latest.document("learned"):
        yield from _of_learned(learned, "stale" if silent else learned["quality"])
    if (forecast := latest.document("forecast")) and forecast.get("settled_at_s") is not None:
        quality = "stale" if silent else forecast["quality"]
        yield Value(("Forecast", "SettledAt_s"), float(forecast["settled_at_s"]), quality, forecast["time_s"])


def _of_estimate(estimate: Mapping[str, Any], quality: str) -> Iterator[Value]:
    time_s = estimate["time_s"]
    for i, name in enumerate(estimate["sources"]):
        for leaf, key in _OF_HEAT.items():
            yield Value(("Heat", name, leaf), float(estimate[key][i]), quality, time_s)
    for part, keys in _CURVES.items():
        for leaf, key in keys.items():
            if len(estimate[key]):
                yield Value((part, leaf), [float(x) for x in estimate[key]], quality, time_s)
    for i, name in enumerate(estimate["sensors"]):
        used = estimate["sensor_quality"][i] == "good" or quality == "stale"
        own = quality if used else "invalid"
        yield Value(("Sensors", name, "Innovation_K"), float(estimate["innovation_K"][i]), own, time_s)
        yield Value(("Sensors", name, "Quality"), estimate["sensor_quality"][i], quality, time_s)


def _of_learned(learned: Mapping[str, Any], quality: str) -> Iterator[Value]:
    for name, learnt in learned["parameters"].items():
        for leaf, key in (("Value", "value"), ("Sigma", "sigma")):
            number = math.nan if learnt[key] is None else float(learnt[key])
            yield Value(("Learned", name, leaf), number, quality, learned["time_s"])


_OF_HEAT = {"Heat_W": "heat_W", "Sigma_W": "heat_sigma_W", "Bound_W": "heat_bound_W", "Law_W": "law_W"}
_CURVES = {
    "Field": {
        "Position_m": "position_m",
        "Temperature_degC": "field_degC",
        "Sigma_K": "field_sigma_K",
        "Bound_K": "field_bound_K",
    },
    "Error": {"Error_um": "error_um", "Sigma_um": "error_sigma_um", "Bound_um": "error_bound_um"},
}


class _Tree:
    """The variables below an axis, made when their first value comes."""

    def __init__(self, server: Server, index: int, axis: Node) -> None:
        self._server, self._index, self._axis = server, index, axis
        self._folders: dict[tuple[str, ...], Node] = {(): axis}
        self._variables: dict[tuple[str, ...], Node] = {}
        self._written: dict[tuple[str, ...], tuple[str, float]] = {}

    async def write(self, value: Value) -> None:
        """Write a variable, unless it is as it was."""
        if self._written.get(value.path) == (value.quality, value.time_s):
            return
        self._written[value.path] = (value.quality, value.time_s)
        known = not (isinstance(value.value, float) and math.isnan(value.value))
        status = STATUS[value.quality] if known else StatusCodes.BadNoData
        variant = _variant(value.value)
        node = self._variables.get(value.path) or await self._made(value.path, variant)
        at = ua.DateTime.fromtimestamp(value.time_s, UTC).replace(tzinfo=None)
        data = ua.DataValue(variant, ua.StatusCode(ua.UInt32(status)), SourceTimestamp=at)
        await self._server.write_attribute_value(node.nodeid, data)

    async def _made(self, path: tuple[str, ...], variant: ua.Variant) -> Node:
        for depth in range(1, len(path)):
            if path[:depth] not in self._folders:
                above = self._folders[path[: depth - 1]]
                self._folders[path[:depth]] = await above.add_object(self._index, path[depth - 1])
        folder = self._folders[path[:-1]]
        node = await folder.add_variable(self._index, path[-1], variant)
        self._variables[path] = node
        return node


def _variant(value: Any) -> ua.Variant:
    if isinstance(value, list):
        kind = ua.VariantType.Double if value and isinstance(value[0], float) else ua.VariantType.String
        return ua.Variant(value, kind, is_array=True)
    return ua.Variant(value, ua.VariantType.String if isinstance(value, str) else ua.VariantType.Double)
