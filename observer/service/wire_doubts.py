"""Doubts about values that arrive and yet cannot be right, for `observer check --wires`.

A wrong ready map, register, scale or byte order gives numbers, not faults. They show beside each other and
beside the air: exactly 0 °C, all equal, ten times a workshop's temperature.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, get_args

from drivers.decode import bytes_of, raw_of, words_of
from drivers.modbus import ModbusTable
from drivers.places import ByteOrder, ModbusChannel, Place
from observer.align.plausibility import Limits
from observer.installation import Installation
from observer.service.one_look import look
from observer.units import BY_NAME, ZERO_DEGC_K

WORKSHOP_DEGC, MACHINE_DEGC = (3.0, 45.0), (3.0, 95.0)
"""The air of a workshop, and what stands on a machine in it."""
_LIKELY_AIR_DEGC = (10.0, 38.0)
"""Narrower: a unit is proposed only where it makes the air this."""
BELOW_AIR_K, ABOVE_AIR_K = 10.0, 60.0
OFF_STROKE_M = 0.02
_OPEN_RAW = {"int16": (0x7FFF, -0x8000, 0x7FFE, -1), "uint16": (0xFFFF, 0x7FFF, 0x8000)}
"""What modules send for an open input and their maps do not name."""
_OF_ANOTHER_MAP = {
    "register_communication", "module_error", "not_ready", "under_range", "over_range", "open_circuit",
}  # fmt: skip
"""Faults that the status words of a ready map report at a module of another kind."""
_LEAST_EQUAL = 3
_RESOLVED_K = 0.05  # a finer number hardly ever repeats from sensor to sensor
_UNITS: tuple[tuple[str, str, Callable[[float], float]], ...] = (
    ("ten times a temperature", "a tenth of the scale", lambda v: v / 10.0),
    ("a hundred times a temperature", "a hundredth of the scale", lambda v: v / 100.0),
    ("a tenth of a temperature", "ten times the scale", lambda v: v * 10.0),
    ("a temperature in °F", "scale = 0.5556 and offset = -17.78", BY_NAME["degF"].to_base),
    ("a temperature in K", "offset = -273.15", BY_NAME["kelvin"].to_base),
    ("tenths of K", "scale = 0.1 and offset = -273.15", lambda v: v / 10.0 - ZERO_DEGC_K),
)


@dataclass(frozen=True, slots=True)
class _Module:
    """The temperatures that one driver delivered, and where it reads each."""

    preset: str | None
    places: Mapping[str, Place]
    values_degC: Mapping[str, float]


def wires_of(config: Installation) -> dict[str, Any]:
    """Return what every device delivers within a few seconds, the content of `observer check --wires --json`.

    It runs the drivers as the service does, so the service must not run at the same time where a device
    accepts one connection only.

    Raises:
        UserError: If a file that a driver names cannot be used.
    """
    limits, column = Limits.of(config), {name: j for j, name in enumerate(config.channels)}

    def doubt(channel: str, value: float) -> str | None:
        return limits.doubt(column[channel], value) if channel in column else None

    wires = look(config.open_drivers(), doubt)
    doubt_values(config, wires)
    for name, heartbeat_s in config.heartbeats_s.items():
        for driver in wires["drivers"].values():
            if (entry := driver["channels"].get(name)) is not None and entry["fault"] == "silent":
                entry["remedy"] = (
                    f"it sends only on change, at the latest every {heartbeat_s:g} s, and sent nothing now: "
                    "look again while its value changes"
                )
    return wires


def doubt_values(config: Installation, result: dict[str, Any]) -> None:
    """Mark in the findings of a look which values cannot be right, each with its remedy.

    Values are compared with the air, with each other, and with the stroke. Other units and byte orders are
    tried where they would make all values usual.

    Args:
        config: The configuration that the drivers come from.
        result: What `look` returned; it is changed.
    """
    sensors = [s.channel for s in config.sensor if s.kind == "temperature"]
    channels = dict.fromkeys([*sensors, config.ambient.channel or ""])
    by_channel = {name: one for d in result["drivers"].values() for name, one in d["channels"].items()}
    air = by_channel.get(config.ambient.channel or "", {}).get("value")
    air_degC = config.ambient.temperature_degC if config.ambient.channel is None else air
    for driver, settings in config.drivers.items():
        entries = result["drivers"][driver]["channels"]
        places = settings.map() if isinstance(settings, ModbusTable) else {}
        values = {n: e["value"] for n, e in entries.items() if n in channels and e["value"] is not None}
        module = _Module(getattr(settings, "device", None), places, values)
        for name, doubt, remedy in _of_temperatures(module, config.ambient.channel, air_degC):
            _mark(entries[name], doubt, remedy)
        suspects = [one for one in entries.values() if one["fault"] in _OF_ANOTHER_MAP]
        if module.preset and 2 * len(suspects) > len(entries):
            for one in suspects:
                one["remedy"] += f'; or this module is not device = "{module.preset}": {_WRITE_OUT}'
    for source in config.source:
        one = by_channel.get(source.position_channel or "")
        if one is not None and one["value"] is not None and source.stroke_m is not None:
            place = next((p for p in _places(config) if p[0] == source.position_channel), ("", None))[1]
            _doubt_position(one, source.stroke_m, place)
    result["good"] = bool(result["drivers"]) and all(one["usable"] for one in by_channel.values())


def _places(config: Installation) -> Iterator[tuple[str, Place]]:
    for settings in config.drivers.values():
        if isinstance(settings, ModbusTable):
            yield from settings.map().items()


def _mark(one: dict[str, Any], doubt: str, remedy: str) -> None:
    one |= {"implausible": one["implausible"] or doubt, "usable": False, "remedy": remedy}


def _of_temperatures(
    module: _Module, air: str | None, air_degC: float | None
) -> Iterator[tuple[str, str, str]]:
    """Each doubtful channel with the problem of its value, and the remedy."""
    judged = dict(module.values_degC)
    for name, value in module.values_degC.items():
        place = module.places.get(name)
        if doubt := _no_sensor(value, place):
            yield name, doubt, _not_connected(module)
            del judged[name]
    if not judged:
        return
    steps_K = [abs(p.scale) for n, p in module.places.items() if n in judged]
    fine = module.places and all(getattr(module.places[n], "is_float", False) for n in judged)
    if len(judged) >= _LEAST_EQUAL and len(set(judged.values())) == 1:
        value = next(iter(judged.values()))
        if fine or max(steps_K, default=0.0) < _RESOLVED_K or not _is_usual(value, None, is_air=True):
            for name in judged:
                yield name, f"all {len(judged)} channels read exactly {value:g} °C", _one_register(module)
            return
    own_air_degC = judged.get(air or "", air_degC)
    usual = {n: _is_usual(v, own_air_degC, is_air=n == air) for n, v in judged.items()}
    if all(usual.values()):
        return
    fitting = [unit for unit in _UNITS if _fits(unit[2], judged, air, own_air_degC)]
    for name, value in judged.items() if fitting else ():
        looks = " or ".join(f"{unit[0]}, {unit[2](value):.1f} °C" for unit in fitting)
        yield name, f"{value:.4g} °C is {looks}", _rescaled(module, ", or ".join(unit[1] for unit in fitting))
    if fitting:
        return
    for name, value in judged.items():
        if not usual[name]:
            yield name, _far(value, own_air_degC, is_air=name == air), _far_remedy(module, name, value)


def _fits(
    convert: Callable[[float], float],
    values_degC: Mapping[str, float],
    air: str | None,
    air_degC: float | None,
) -> bool:
    """Whether all temperatures are usual once converted; the air with them, where this module reads it."""
    there_degC = convert(air_degC) if air in values_degC and air_degC is not None else air_degC
    own_degC = values_degC.get(air or "")
    if own_degC is not None and not _LIKELY_AIR_DEGC[0] < convert(own_degC) < _LIKELY_AIR_DEGC[1]:
        return False
    return all(_is_usual(convert(v), there_degC, is_air=name == air) for name, v in values_degC.items())


def _no_sensor(value: float, place: Place | None) -> str:
    """Why a value is that of an input without a sensor, empty where it may be a temperature."""
    raw = math.nan if place is None else round((value - place.offset) / place.scale)
    if value == 0.0 or raw == 0:
        return f"exactly {value:.4g} °C, the number 0 in the register"
    if raw in _OPEN_RAW.get(getattr(place, "type", ""), ()):
        return f"the number {int(raw):d}, by which many modules report an open input"
    return ""


def _is_usual(value_degC: float, air_degC: float | None, *, is_air: bool) -> bool:
    low, high = WORKSHOP_DEGC if is_air else MACHINE_DEGC
    near = is_air or air_degC is None or -BELOW_AIR_K < value_degC - air_degC < ABOVE_AIR_K
    return low < value_degC < high and near


def _far(value_degC: float, air_degC: float | None, *, is_air: bool) -> str:
    if is_air or air_degC is None:
        return f"{value_degC:.4g} °C is no temperature of a workshop"
    return f"{value_degC:.4g} °C is {value_degC - air_degC:+.0f} K from the air, {air_degC:.4g} °C"


def _not_connected(module: _Module) -> str:
    if module.preset:
        return (
            f"connect a thermocouple to this input; where one is connected, the module is not what device = "
            f'"{module.preset}" stands for: {_WRITE_OUT}'
        )
    return "connect a thermocouple to this input; where one is connected, correct register, function and type"


_WRITE_OUT = "correct device, or write its registers out (module other in observer init asks for them)"


def _one_register(module: _Module) -> str:
    if module.preset:
        return f'device = "{module.preset}" does not fit this module, or it does not measure: {_WRITE_OUT}'
    return "look whether the module measures; else correct the registers, which must differ"


def _rescaled(module: _Module, change: str) -> str:
    if module.preset:
        return f'the module is set to another format than device = "{module.preset}" expects: {_WRITE_OUT}'
    return f"give the channel {change}"


def _far_remedy(module: _Module, name: str, value_degC: float) -> str:
    place = module.places.get(name)
    order = (
        "" if place is None else _other_order(value_degC, place, lambda v: _is_usual(v, None, is_air=True))
    )
    if order:
        return f"set byte_order = {order}"
    base = (
        "if no sensor is on this input, remove the channel; else correct register, function, type and scale"
    )
    return _not_connected(module) if module.preset else base


def _other_order(value: float, place: Place, is_right: Callable[[float], bool]) -> str:
    """The one byte order in which a value would be right, and the value; empty where none or several are."""
    if not isinstance(place, ModbusChannel) or place.type.endswith("16"):
        return ""
    kind, order = place.type, place.order
    try:
        words = words_of((value - place.offset) / place.scale, kind, order)
    except (struct.error, OverflowError, ValueError):
        return ""
    right = {}
    for other in get_args(ByteOrder):
        reordered = place.value(raw_of(bytes_of(words, other), kind))
        if other != order and math.isfinite(reordered) and is_right(reordered):
            right[other] = reordered
    return "".join(f'"{other}", which gives {v:.4g}' for other, v in right.items()) if len(right) == 1 else ""


def _doubt_position(one: dict[str, Any], stroke_m: tuple[float, float], place: Place | None) -> None:
    """Mark a position outside the stroke: its offset, scale or byte order is wrong."""
    low_m, high_m = stroke_m

    def is_right(value_m: float) -> bool:
        return low_m - OFF_STROKE_M <= value_m <= high_m + OFF_STROKE_M

    if is_right(one["value"]):
        return
    order = "" if place is None else _other_order(one["value"], place, is_right)
    doubt = f"{one['value']:.4g} m is outside the stroke, {low_m:g} to {high_m:g} m from the screw's left end"
    remedy = (
        f"set byte_order = {order}"
        if order
        else "check scale and sign; then set offset so that the nut's middle is right: with the nut at its "
        f"left end of travel the channel must read {low_m:g} m"
    )
    _mark(one, doubt, one["remedy"] if one["implausible"] and not order else remedy)
