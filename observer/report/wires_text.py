"""What came over the wires, for people: `observer check --wires`."""

from __future__ import annotations

from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

UNITS = {
    "degC": "°C",
    "m": "m",
    "rpm": "rpm",
    "W": "W",
    "mm": "mm",
    "um": "µm",
    "K": "K",
    "s": "s",
    "Nm": "Nm",
}
"""How the unit that ends a channel's name is shown."""


def as_text(found: dict[str, Any]) -> RenderableType:
    """Lay out what came: a line for each driver, below it one for each of its channels."""
    table = Table(show_header=False, box=None, pad_edge=False)
    for _ in range(4):
        table.add_column(overflow="fold")
    for name, driver in found["drivers"].items():
        state = "connected" if driver["connected"] else "not connected"
        table.add_row(Text(name, style="bold"), state, _rate(driver), _errors(driver))
        for channel, one in driver["channels"].items():
            style = "" if one["usable"] else "yellow"
            table.add_row(*(Text(cell, style=style) for cell in _cells(channel, one)))
    if not found["drivers"]:
        return Text("no drivers: write a [drivers.…] table for each device", style="yellow")
    verdict = "every channel came" if found["good"] else "warning: not every channel came with a usable value"
    return Group(table, Text(verdict, style="green" if found["good"] else "yellow"))


def unit_of(channel: str) -> str:
    """The unit by the name's last part, empty where it tells none."""
    return UNITS.get(channel.rsplit("_", 1)[-1], "") if "_" in channel else ""


def _cells(channel: str, one: dict[str, Any]) -> tuple[str, str, str, str]:
    value = "–" if one["value"] is None else f"{one['value']:.6g} {unit_of(channel)}".rstrip()
    age = "" if one["age_s"] is None else f"{one['age_s']:.2f} s old"
    return f"  {channel}", value, age, one["fault"] or one["implausible"] or ""


def _rate(driver: dict[str, Any]) -> str:
    rate, wanted = driver["rate_Hz"], 1.0 / driver["period_s"]
    came = "nothing" if rate is None else f"{rate:.3g} Hz"
    return f"{came}, {wanted:.3g} Hz wanted"


def _errors(driver: dict[str, Any]) -> str:
    if not driver["errors"] and not driver["last_error"]:
        return ""
    return f"{driver['errors']} errors, the last: {driver['last_error'] or 'unknown'}"[:120]
