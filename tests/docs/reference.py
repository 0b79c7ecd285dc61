"""The keys on the reference pages, written from the classes of the configuration: `make reference`.

What a key means stands beside its field, in a comment that begins with `#:`; its default is the field's. The
rest of a page is written by hand. Where a class has no such comments, the page keeps its own words.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from textwrap import dedent
from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from drivers import can, canopen, modbus, mtconnect, opcua, places, player
from observer.bus.exchange import KEYS
from observer.config import publishing
from observer.config.effects.base import EffectTable
from observer.config.effects.catalogue import LIBRARY
from observer.config.quantities import Section
from observer.installation import Installation

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"


def _within(annotation: Any) -> Iterator[type[BaseModel]]:
    """The tables that a field can hold."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        yield annotation
    for part in get_args(annotation):
        yield from _within(part)


def _tables(model: type[BaseModel], path: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """The headings of all tables of a configuration, and their classes."""
    for name, field in model.model_fields.items():
        if name == "effect":  # has a page of its own
            continue
        for section in _within(field.annotation):
            if any(not list(_within(f.annotation)) for f in section.model_fields.values()):
                many = get_origin(field.annotation) is tuple and not path
                yield f"`[[{name}]]`" if many else f"`[{path}{name}]`", section
            yield from _tables(section, f"{path}{name}.")


def _headed() -> dict[str, type[BaseModel]]:
    """Each class once, under the headings of all tables that have its keys."""
    headings: dict[type[BaseModel], list[str]] = {}
    for heading, section in _tables(Installation):
        headings.setdefault(section, []).append(heading)
    return {", ".join(same): section for section, same in headings.items()}


CONFIGURATION = _headed() | {"A client's file": publishing.Client}
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
SHARED = {
    "`[[candidate]]`": "`[[sensor]]`",
    "`modbus_rtu`": "`modbus_tcp`",
    "`canopen`": "`can`",
    "A CAN channel": "A Modbus channel",
    "An OPC UA channel": "A Modbus channel",
    "An MTConnect channel": "A Modbus channel",
}
"""Tables that refer to another table for the keys that are the same there."""
_ROWS = re.compile(r"(?m)(^\| key \| payload \|.*\n\|[-|]+\n)((?:\|.*\n)*)")
_ITEM = re.compile(r"^- `(\w+)`(?: \((.*?)\))?: (.*)$", re.M)
_LIST = re.compile(r"(?:^- `.*\n?)+", re.M)


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
    """A field's default as the page writes it; empty where there is none."""
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    return "" if value is None else f"`{json.dumps(value, default=str)}`"


def items(model: type[BaseModel], page: dict[str, str]) -> dict[str, str]:
    """The item of each key of a class, in the order of those that the `page` has already, by meaning."""
    names = {field.alias or name: (name, field) for name, field in model.model_fields.items()}
    made = {}
    if issubclass(model, EffectTable):
        names.pop("kind")  # the heading is its value
    for key in [*(k for k in page if k in names), *(k for k in names if k not in page)]:
        name, field = names[key]
        said = (meanings(c).get(name) for c in model.__mro__ if c not in (BaseModel, object))
        meaning, value = next(filter(None, said), ""), default(field)
        if not value:  # a text that ends in "; – is …" gives the default in words
            meaning, _, value = meaning.partition("; – is ")
        given = f" ({value})" if value else ""
        made[key] = f"- `{key}`{given}: {meaning or page.get(key, '')}\n"
    return made


def listed(title: str, model: type[BaseModel], texts: dict[str, str]) -> str:
    """The list of the keys of a class; keys that are as in another list share an item."""
    page = _meanings_of(texts[title])
    if (other := SHARED.get(title)) is None:
        return "".join(items(model, page).values())
    models = {heading: section for kinds in TABLES.values() for heading, section in kinds.items()}
    elsewhere = items(models[other], _meanings_of(texts[other]))
    own = items(model, page | {k: v for k, v in _meanings_of(texts[other]).items() if k not in page})
    same = [key for key in model.model_fields if key in own and elsewhere.get(key) == own[key]]
    names, link = (
        ", ".join(f"`{key}`" for key in same),
        re.sub("[^a-z_-]", "", other.lower().replace(" ", "-")),
    )
    last = f"- {names}: as in [{other.removeprefix('A ')}](#{link})\n" if same else ""
    return "".join(item for key, item in own.items() if key not in same) + last


def _meanings_of(text: str) -> dict[str, str]:
    """The meanings of the keys that a text lists."""
    return {key: meaning for key, _, meaning in _ITEM.findall(text)}


def section_of(title: str, model: type[BaseModel], texts: dict[str, str]) -> str:
    """The text under a heading, with its list."""
    text, keys = texts[title], listed(title, model, texts)
    return _LIST.sub(lambda _: keys, text, count=1) if _LIST.search(text) else text + keys


def effect(model: type[EffectTable], text: str) -> str:
    """The text under the heading of an effect: what its class says, and the prose after its keys."""
    by_hand = re.search(r"(?ms)^- `[^\n]*\n\n(?!Identifiable)(.*?\n\n)Identifiable with", text)
    last = f"Identifiable with {model.excitation}. Source: {model.source}.".replace("..", ".")
    prose = by_hand[1] if by_hand else ""
    return f"\n{model.__doc__}\n\n{''.join(items(model, {}).values())}\n{prose}{last}\n"


def keys() -> str:
    """The rows of the published keys."""
    return "".join(
        f"| `{name}` | {key.holds} | {key.sent or '–'} | {key.query_answer or '–'} |\n"
        for name, key in KEYS.items()
    )


def written(page: str) -> str:
    """A page as it should be."""
    if page == "zenoh.md":
        return _ROWS.sub(lambda found: found[1] + keys(), (REFERENCE / page).read_text(encoding="utf-8"))
    head, *parts = re.split(r"(?m)^## ", (REFERENCE / page).read_text(encoding="utf-8"))
    texts = dict(part.split("\n", 1) for part in parts)
    tables, made = TABLES[page], []
    for title in tables:
        texts.setdefault(title, f"\n{tables[title].__doc__}\n\n")
    if page == "effects.md":
        made = [f"## {title}\n{effect(model, texts[title])}" for title, model in tables.items()]  # type: ignore[arg-type]
        return head + "\n".join(made)
    for title, text in texts.items():
        section = section_of(title, tables[title], texts) if title in tables else text
        made.append(f"## {title}\n{section.rstrip()}\n")
    return head + "\n".join(made)


if __name__ == "__main__":
    for name in (*TABLES, "zenoh.md"):
        (REFERENCE / name).write_text(written(name), encoding="utf-8")
