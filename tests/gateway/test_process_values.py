"""Process values over OPC UA: found by their type, with units and ranges, by a real client."""

from __future__ import annotations

from datetime import UTC

import numpy as np
import pytest
from asyncua import Client, Node, ua

from observer.gateway.opcua import NAMESPACE
from observer.gateway.process_values import PADIM, PROCESS_VALUE_TYPE, PROCESS_VALUES, unit
from observer.tables.gateway import Opcua
from tests.gateway.feeding import fed_gateway
from tests.patience import eventually, until
from tests.publish.router import free_port

pytestmark = pytest.mark.system
CONFIG = {
    "source": [{"name": "nut", "initial_sigma_W": 30.0}, {"name": "left", "initial_sigma_W": 10.0}],
    "compensation": {"limit_um": 150.0},
    "sensor": [{"name": "t1", "channel": "t1_degC"}, {"name": "probe", "channel": "probe_um"}],
}
READINGS = {"t1_degC": {"value": 21.5, "quality": "rejected", "age_s": 0.25}}


@pytest.mark.parametrize(("symbol", "number"), [("W", 5723220), ("°C", 4408652), ("µm", 13384)])
def test_units_have_the_numbers_of_the_published_table(symbol, number):
    """From UNECE_to_OPCUA.csv of the OPC Foundation (OPC 10000-8)."""
    assert unit(symbol).UnitId == number


async def _by_type(client: Client) -> dict[str, Node]:
    """Every object below the axis whose type is ProcessValueType, by its name."""
    values = await client.get_namespace_index(PROCESS_VALUES)
    index = await client.get_namespace_index(NAMESPACE)
    axis = await client.nodes.objects.get_child([f"{index}:lathe", f"{index}:z"])
    found = {}
    for folder in await axis.get_children():
        for node in await folder.get_children(nodeclassmask=ua.NodeClass.Object):
            if await node.read_type_definition() == ua.NodeId(PROCESS_VALUE_TYPE, values):
                found[(await node.read_browse_name()).Name] = node
    return found


async def test_a_client_finds_them_by_type_and_reads_units_ranges_and_status():
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    with fed_gateway(opcua=Opcua(listen=url)) as feed:
        until(lambda: feed.said()["reason"] is None)
        feed.document("config", {"config": CONFIG})
        feed.document("readings", {"channels": READINGS})
        time_s = feed.estimate("degraded")
        async with Client(url) as client:
            padim = await client.get_namespace_index(PADIM)

            async def whole():
                found = await _by_type(client)
                return found if len(found) == 2 + 3 + 3 + 1 else None

            found = await eventually(whole)

            async def shown(name: str):
                node = found[name]
                assert await (await node.get_child(f"{padim}:SignalTag")).read_value() == name
                signal = await node.get_child(f"{padim}:AnalogSignal")
                kind = client.get_node(await signal.read_type_definition())
                assert (await kind.read_browse_name()).Name == "AnalogSignalVariableType"
                properties = {
                    (await p.read_browse_name()).Name: await p.read_value()
                    for p in await signal.get_properties()
                }
                usual = properties["EURange"]
                value = await signal.read_data_value(raise_on_bad_status=False)
                return value, properties, (usual.Low, usual.High)

            heat, of_heat, usual = await shown("Heat_nut")
            assert (heat.Value.Value, usual) == (26.5, (-90.0, 90.0))
            assert of_heat["EngineeringUnits"] == unit("W")
            assert heat.StatusCode.value == ua.StatusCodes.UncertainSubNormal
            assert heat.SourceTimestamp.replace(tzinfo=UTC).timestamp() == pytest.approx(time_s, abs=1e-3)
            error, of_error, usual = await shown("Error_500mm")
            assert (error.Value.Value, usual) == (8.0, (-150.0, 150.0))
            assert of_error["EngineeringUnits"].DisplayName.Text == "µm"
            field, of_field, usual = await shown("Temperature_1000mm")
            assert (field.Value.Value, usual) == (22.0, (-40.0, 150.0))
            assert "InstrumentRange" not in of_field
            sensor, of_sensor, _ = await shown("Sensor_t1")
            assert sensor.StatusCode.value == ua.StatusCodes.BadNoData
            assert of_sensor["InstrumentRange"].High == 150.0

            values = await client.get_namespace_index(PROCESS_VALUES)
            above, node = [], client.get_node(ua.NodeId(PROCESS_VALUE_TYPE, values))
            while (await node.read_browse_name()).Name != "BaseObjectType":
                node = await node.get_parent()
                above.append((await node.read_browse_name()).Name)
            assert above == ["AnalogSignalType", "SignalType", "BaseObjectType"]


def test_a_number_of_a_unit_is_its_code_in_characters():
    assert unit("°C").UnitId == int(np.frombuffer(b"\0CEL", ">i4")[0])
