"""The tables of the reference pages, written from the classes of the configuration: `make reference`.

What a key means stands beside its field, in a comment that begins with `#:`; its default is the field's. The
rest of a page is written by hand. Where a class has no such comments, the page keeps its own words.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
from functools import cache
from pathlib import Path
from textwrap import dedent

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from drivers import can, canopen, modbus, mtconnect, opcua, places, player
from observer import config
from observer.effects.catalogue import LIBRARY
from observer.tables import estimator, gateway, keeping, laws, mounting, nodes, publishing, sections

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"
CONFIGURATION = {
    "`[machine]`": config.MachineName,
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
    "`[record]`": keeping.RecordSettings,
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
TABLES: dict[str, dict[str, type[BaseModel]]] = {
    "configuration.md": CONFIGURATION,
    "devices.md": DEVICES,
    "effects.md": {f"`{effect.named()}`": effect for effect in LIBRARY},
}
_HEAD = "| key | default | meaning |\n|---|---|---|\n"
_ROW = re.compile(r"^\| `(\w+)` \| (.*?) \| (.*) \|$", re.M)


@cache
def meanings(model: type) -> dict[str, str]:
    """What each field that a class itself declares means: the `#:` after it, or on the lines above it."""
    source = dedent(inspect.getsource(model))
    lines = source.split("\n")
    found = {}
    for node in ast.parse(source).body[0].body:  # type: ignore[attr-defined]
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        said, above = [lines[(node.end_lineno or node.lineno) - 1].partition("  #: ")[2]], node.lineno - 2
        while lines[above].strip().startswith("#: "):
            said.insert(0, lines[above].strip().removeprefix("#: "))
            above -= 1
        if text := " ".join(filter(None, said)):
            found[node.target.id] = text
    return found


def default(field: FieldInfo) -> str:
    """A field's default as the page writes it."""
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    return "–" if value is None else f"`{json.dumps(value, default=str)}`"


def table(model: type[BaseModel], page: dict[str, str]) -> str:
    """The table of a class, its keys in the order of those that the `page` has already, by meaning."""
    keys = {field.alias or name: (name, field) for name, field in model.model_fields.items()}
    rows = []
    for key in [*(k for k in page if k in keys), *(k for k in keys if k not in page)]:
        name, field = keys[key]
        said = (meanings(c).get(name) for c in model.__mro__ if c not in (BaseModel, object))
        rows.append(f"| `{key}` | {default(field)} | {next(filter(None, said), page.get(key, ''))} |\n")
    return _HEAD + "".join(rows)


def section_of(page: str, title: str, model: type[BaseModel], text: str) -> str:
    """The text under a heading, with its table, and with what the class of an effect says of it."""
    before, _, after = text.partition(_HEAD)
    own = table(model, {key: meaning for key, _, meaning in _ROW.findall(after)})
    prose = "".join(re.split(r"(?m)^(?!\|)", after, maxsplit=1)[1:])
    if page != "effects.md":
        return before + own + prose
    prose = re.sub(r"(?m)^Identifiable with .*$", "", prose).strip("\n")
    prose = f"{prose}\n\n" if prose else ""
    last = f"Identifiable with {model.excitation}. Source: {model.source}."  # type: ignore[attr-defined]
    return f"\n{model.__doc__}\n\n{own}\n{prose}{last.replace('..', '.')}\n"


def written(page: str) -> str:
    """A page as it should be."""
    head, *parts = re.split(r"(?m)^## ", (REFERENCE / page).read_text(encoding="utf-8"))
    texts = dict(part.split("\n", 1) for part in parts)
    tables, made = TABLES[page], []
    for title in tables if page == "effects.md" else texts:
        text = texts.get(title, "")
        if title in tables:
            text = section_of(page, title, tables[title], text)
        made.append(f"## {title}\n{text.rstrip()}\n")
    return head + "\n".join(made)


if __name__ == "__main__":
    for name in TABLES:
        (REFERENCE / name).write_text(written(name), encoding="utf-8")
