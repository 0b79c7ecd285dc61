"""Estimates and readings as process values of the machinery companion specification (OPC 40001-2).

Of that specification and of PADIM (OPC 30081), from which it derives, only the types that are used here are
made, by hand, under their published namespaces and numbers. It is therefore not a conforming implementation.
There are no deviation alarms: their types belong to those that `opcua_server` leaves out.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Self

from asyncua import ua
from asyncua.common.node import Node
from asyncua.server.server import Server
from asyncua.ua.object_ids import ObjectIds

from observer.align.plausibility import SCREW_RANGE_DEGC
from observer.frames import PARTS
from observer.gateway.messages import Latest

PADIM = "http://opcfoundation.org/UA/PADIM/"
PROCESS_VALUES = "http://opcfoundation.org/UA/Machinery/ProcessValues/"
PROCESS_VALUE_TYPE = 1003
_SIGNAL_TYPE, _SIGNAL_TAG, _ANALOG_SIGNAL_TYPE, _ANALOG_SIGNAL, _ANALOG_VARIABLE_TYPE = (
    1008, 1035, 1022, 1027, 1111,
)  # fmt: skip
_IDS = ObjectIds
_UNECE = "http://www.opcfoundation.org/UA/units/un/cefact"
_CODES = {"W": ("WTT", "watt"), "°C": ("CEL", "degree Celsius"), "µm": ("4H", "micrometre")}
_PRIORS = 3.0  # σ of a heat's prior within which it is expected
Limits = tuple[float, float]


def unit(symbol: str) -> ua.EUInformation:
    """Return a unit by its code of UN/ECE, whose characters are its number (OPC 10000-8, 5.6.4.3)."""
    code, words = _CODES[symbol]
    number = int.from_bytes(code.encode(), "big")
    return ua.EUInformation(_UNECE, number, ua.LocalizedText(symbol), ua.LocalizedText(words))


class ProcessSignal(NamedTuple):
    """A process value: its name, which is its tag, value, unit, usual range, quality, and time (epoch).

    `instrument` is what its sensor can measure, None for an estimate.
    """

    name: str
    value: float | None
    unit: str
    usual: Limits
    quality: str
    time_s: float
    instrument: Limits | None = None


def process_signals(latest: Latest) -> Iterator[ProcessSignal]:
    """Yield the process values known now; none before configuration and estimate."""
    config, estimate = latest.document("config").get("config"), latest.document("estimate")
    if not config or not estimate:
        return
    silent, time_s = latest.is_stale, estimate["time_s"]
    qualities = {part: "stale" if silent else estimate[f"{part}_quality"] for part in PARTS}
    sigma_W = {source["name"]: source["initial_sigma_W"] for source in config["source"]}
    for name, heat_W in zip(estimate["sources"], estimate["heat_W"], strict=True):
        most_W = _PRIORS * sigma_W[name]
        usual = (-most_W, most_W)
        yield ProcessSignal(f"Heat_{name}", float(heat_W), "W", usual, qualities["heat"], time_s)
    limit_um = config["compensation"]["limit_um"]
    for column, kind, symbol, usual in (
        ("field_degC", "Temperature", "°C", SCREW_RANGE_DEGC),
        ("error_um", "Error", "µm", (-limit_um, limit_um)),
    ):
        quality = qualities[column.partition("_")[0]]
        for x_m, value in zip(estimate["position_m"], estimate[column], strict=False):
            yield ProcessSignal(f"{kind}_{1000 * x_m:.6g}mm", float(value), symbol, usual, quality, time_s)
    readings = latest.document("readings").get("channels", {})
    for sensor in config["sensor"]:
        if (read := readings.get(sensor["channel"])) is not None and sensor["channel"].endswith("_degC"):
            own = "stale" if silent else {"good": "good", "stale": "stale"}.get(read["quality"], "invalid")
            usual = SCREW_RANGE_DEGC
            yield ProcessSignal(
                f"Sensor_{sensor['name']}",
                read["value"],
                "°C",
                usual,
                own,
                time_s - (read["age_s"] or 0.0),
                usual,
            )


class ProcessValueTree:
    """The process values below an axis, each made when its first value comes."""

    def __init__(self, server: Server, index: int, padim: int, folder: Node, kind: Node) -> None:
        self._server, self._index, self._padim, self._folder, self._kind = server, index, padim, folder, kind
        self._variables: dict[str, Node] = {}
        self._written: dict[str, tuple[str, float]] = {}

    @classmethod
    async def below(cls, server: Server, index: int, axis: Node) -> Self:
        """Make the types, and the folder in the namespace `index`."""
        padim = await server.register_namespace(PADIM)
        values = await server.register_namespace(PROCESS_VALUES)
        kind = await _types(server, padim, values)
        return cls(server, index, padim, await axis.add_object(index, "ProcessValues"), kind)

    async def write(self, signal: ProcessSignal, data: ua.DataValue) -> None:
        """Write a value if it has changed."""
        if self._written.get(signal.name) == (signal.quality, signal.time_s):
            return
        self._written[signal.name] = (signal.quality, signal.time_s)
        variable = self._variables.get(signal.name) or await self._made(signal)
        await self._server.write_attribute_value(variable.nodeid, data)

    async def _made(self, signal: ProcessSignal) -> Node:
        made = await self._folder.add_object(
            self._index, signal.name, self._kind.nodeid, instantiate_optional=False
        )
        await (await made.get_child(f"{self._padim}:SignalTag")).write_value(signal.name)
        variable = await made.get_child(f"{self._padim}:AnalogSignal")
        await (await variable.get_child("0:EngineeringUnits")).write_value(unit(signal.unit))
        await (await variable.get_child("0:EURange")).write_value(ua.Range(*signal.usual))
        if signal.instrument is not None:
            await variable.add_property(0, "InstrumentRange", ua.Range(*signal.instrument))
        self._variables[signal.name] = variable
        return variable


def _node(number: int, index: int = 0) -> ua.NodeId:
    return ua.NodeId(ua.Int32(number), ua.Int16(index))


async def _declared(
    server: Server, above: Node, nodeid: ua.NodeId, name: ua.QualifiedName, kind: Node
) -> Node:
    """Make a number of a type of variables, which asyncua's `add_variable` does not offer."""
    shown, read = ua.LocalizedText(name.Name), ua.AccessLevel.CurrentRead.mask
    attributes = ua.VariableAttributes(
        DisplayName=shown, Value=ua.Variant(0.0, ua.VariantType.Double), DataType=_node(_IDS.Double),
        ValueRank=ua.ValueRank.Scalar, AccessLevel=read, UserAccessLevel=read,
    )  # fmt: skip
    item = ua.AddNodesItem(
        ParentNodeId=above.nodeid, ReferenceTypeId=_node(_IDS.HasComponent), RequestedNewNodeId=nodeid,
        BrowseName=name, NodeClass=ua.NodeClass.Variable, NodeAttributes=attributes,
        TypeDefinition=kind.nodeid,
    )  # fmt: skip
    (result,) = await server.iserver.isession.add_nodes([item])
    result.StatusCode.check()
    return server.get_node(nodeid)


async def _types(server: Server, padim: int, values: int) -> Node:
    """Make SignalType, AnalogSignalType, AnalogSignalVariableType and ProcessValueType; returns the last."""

    def named(number: int, name: str, index: int = padim) -> tuple[ua.NodeId, ua.QualifiedName]:
        return _node(number, index), ua.QualifiedName(name, index)

    signal = await server.nodes.base_object_type.add_object_type(*named(_SIGNAL_TYPE, "SignalType"))
    tag = await signal.add_property(*named(_SIGNAL_TAG, "SignalTag"), "")
    above = server.get_node(_node(_IDS.AnalogUnitRangeType))
    analog = await above.add_variable_type(
        *named(_ANALOG_VARIABLE_TYPE, "AnalogSignalVariableType"), _node(_IDS.Number)
    )
    kind = await signal.add_object_type(*named(_ANALOG_SIGNAL_TYPE, "AnalogSignalType"))
    variable = await _declared(server, kind, *named(_ANALOG_SIGNAL, "AnalogSignal"), analog)
    units = await variable.add_property(0, "EngineeringUnits", unit("W"))
    usual = await variable.add_property(0, "EURange", ua.Range(0.0, 0.0))
    for node in (tag, variable, units, usual):  # mandatory: instances get them
        await node.set_modelling_rule(True)
    return await kind.add_object_type(*named(PROCESS_VALUE_TYPE, "ProcessValueType", values))
