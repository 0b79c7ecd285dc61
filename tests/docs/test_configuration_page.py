"""The reference pages list exactly the keys of the configuration, with their defaults."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from pydantic import BaseModel

import drivers
from drivers import can, canopen, devices, modbus, mtconnect, opcua, places, player
from observer import config
from observer.effects.base import EffectTable
from observer.effects.catalogue import KINDS, LIBRARY
from observer.tables import (
    estimator,
    gateway,
    keeping,
    laws,
    mounting,
    nodes,
    publishing,
    quantities,
    sections,
)

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"
CONFIGURATION = {
    "`[machine]`": config.Machine,
    "`[screw]`": sections.Screw,
    "`[surface]`": laws.Surface,
    "`[ambient]`": sections.Ambient,
    "`[boundary.left]`, `[boundary.right]`": sections.Boundary,
    "`[[source]]`": sections.Source,
    "`[source.bearing]`": laws.BearingFriction,
    "`[source.nut_friction]`": laws.NutFriction,
    "`[[node]]`": nodes.Node,
    "`[[link]]`": nodes.Link,
    "`[[sensor]]`": sections.Sensor,
    "`[tolerance]`": estimator.Tolerance,
    "`[integrity]`": estimator.Integrity,
    "`[model]`": config.Model,
    "`[estimator]`": config.EstimatorSettings,
    "`[calibrate]`": config.Calibrate,
    "`[discover]`": config.Discover,
    "`[output]`": config.Output,
    "`[supports]`": mounting.Supports,
    "`[compensation]`": mounting.Compensation,
    "`[compensation.control]`": mounting.ModbusControl,
    "`[forecast]`": estimator.ForecastSettings,
    "`[log]`": config.Logs,
    "`[limits]`": config.ChannelLimits,
    "`[publish]`": publishing.Publish,
    "`[publish.tls]`": publishing.Tls,
    "`[publish.login]`": publishing.Login,
    "`[publish.access]`": publishing.Access,
    "A client's file": publishing.Client,
    "`[page]`": gateway.Page,
    "`[metrics]`": gateway.Metrics,
    "`[mqtt]`": gateway.Mqtt,
    "`[opcua]`": gateway.Opcua,
    "`[record]`": keeping.Record,
    "`[checkpoint]`": keeping.Checkpoint,
    "`[alarms]`": keeping.AlarmSettings,
}
DEVICES = {
    "`modbus_tcp`": modbus.ModbusTcpSettings,
    "`modbus_rtu`": modbus.ModbusRtuSettings,
    "A Modbus channel": places.ModbusChannel,
    "`can`": can.CanSettings,
    "A CAN channel": places.CanChannel,
    "`canopen`": canopen.CanopenSettings,
    "`opcua`": opcua.OpcUaSettings,
    "An OPC UA channel": places.OpcUaChannel,
    "`mtconnect`": mtconnect.MtConnectSettings,
    "An MTConnect channel": places.MtConnectChannel,
    "`player`": player.PlayerSettings,
}
CASES = [("configuration.md", t, m) for t, m in CONFIGURATION.items()]
CASES += [("devices.md", t, m) for t, m in DEVICES.items()]
CASES += [("effects.md", f"`{kind}`", effect) for kind, effect in zip(KINDS, LIBRARY, strict=True)]


def _documented(page: str, title: str) -> dict[str, str]:
    """Key → default of the table under a heading."""
    text = (REFERENCE / page).read_text(encoding="utf-8")
    section = text.split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0]
    return dict(re.findall(r"^\| `(\w+)` \| `?(.*?)`? \| .*\|$", section, flags=re.M))


def test_the_page_of_effects_is_the_library() -> None:
    """Each effect in its order, with its equation, what a log must hold, and its source."""
    text = (REFERENCE / "effects.md").read_text(encoding="utf-8")
    assert tuple(re.findall(r"^## `(\w+)`$", text, flags=re.M)) == KINDS
    for kind, effect in zip(KINDS, LIBRARY, strict=True):
        section = text.split(f"\n## `{kind}`\n", 1)[1].split("\n## ", 1)[0].strip()
        assert section.startswith(f"{effect.__doc__}\n\n| key |"), kind
        last = f"A log tells it with {effect.excitation}. Source: {effect.source}."
        assert section.endswith(last.replace("..", ".")), kind


def _coded(model: type[BaseModel]) -> Iterator[tuple[str, str]]:
    for name, field in model.model_fields.items():
        if field.is_required():
            default = "required"
        else:
            value = field.get_default(call_default_factory=True)
            default = "–" if value is None else json.dumps(value, default=str)
        yield field.alias or name, default


@pytest.mark.parametrize(
    ("page", "title", "model"), CASES, ids=lambda v: str(v) if isinstance(v, str) else ""
)
def test_a_table_of_the_page_is_the_code(page: str, title: str, model: type[BaseModel]) -> None:
    assert _documented(page, title) == dict(_coded(model))


def test_every_section_of_a_configuration_has_its_table() -> None:
    bases = {sections.Description, sections.Boundaries, EffectTable, laws.HeatLaw}
    found = set(quantities.Section.__subclasses__()) | set(laws.HeatLaw.__subclasses__())
    assert found - bases == set(CONFIGURATION.values())


def test_every_effect_is_in_the_library() -> None:
    assert set(EffectTable.__subclasses__()) == set(LIBRARY)


def test_every_kind_of_driver_has_its_table() -> None:
    union, *_ = get_args(drivers.DriverSettings)
    assert set(get_args(union)) <= set(DEVICES.values())


def test_every_ready_device_is_listed() -> None:
    text = (REFERENCE / "devices.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| .* \| (\d+) \|$", text, flags=re.M))
    assert {name: int(inputs) for name, inputs in rows.items()} == devices.MODBUS_INPUTS | devices.CAN_INPUTS
