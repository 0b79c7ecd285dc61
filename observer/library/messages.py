"""The messages of a running service as typed objects; an invalid message is None."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from pydantic import TypeAdapter

from observer.frames import FORCE, PARTS

Message = TypeVar("Message")


@dataclass(frozen=True, slots=True)
class SourceHeat:
    """The heat of a source; a value is None where it is unknown.

    Attributes:
        heat_W: The estimate.
        sigma_W: Its standard deviation.
        bound_W: Half-width of its bound; None where none is published.
    """

    heat_W: float | None
    sigma_W: float | None
    bound_W: float | None = None


@dataclass(frozen=True, slots=True)
class ServiceHeat:
    """The heats of one step.

    Attributes:
        time_s: Time of the step, s since 1970.
        quality: `good`, `starting`, `degraded`, `stale` or `invalid`; use the heats only where it is `good`.
        sources: The heats by the names of their sources.
    """

    time_s: float
    quality: str
    sources: Mapping[str, SourceHeat]


@dataclass(frozen=True, slots=True)
class ServiceField:
    """The temperature along the screw at one step.

    Attributes:
        time_s: Time of the step, s since 1970.
        quality: As of `ServiceHeat`.
        position_m: The places, (g,).
        temperature_degC: Temperature at these, (g,); None where unknown.
        sigma_K: Its standard deviation, (g,).
        bound_K: Half-width of its bound, (g,); empty where none is published.
    """

    time_s: float
    quality: str
    position_m: tuple[float, ...]
    temperature_degC: tuple[float | None, ...]
    sigma_K: tuple[float | None, ...]
    bound_K: tuple[float | None, ...] = ()


@dataclass(frozen=True, slots=True)
class ServiceThermalError:
    """The thermal error along the screw at one step, and the axial force of a screw held at both ends.

    Attributes:
        time_s: Time of the step, s since 1970.
        quality: As of `ServiceHeat`.
        position_m: The places, (g,).
        error_um: Thermal error at these, (g,), positive away from x = 0.
        sigma_um: Its standard deviation, (g,).
        bound_um: Half-width of its bound, (g,); empty where none is published.
        force_N: Axial force, tension positive; None for a screw that is free at one end.
        force_sigma_N: Its standard deviation.
        force_bound_N: Half-width of its bound; None where none is published.
    """

    time_s: float
    quality: str
    position_m: tuple[float, ...]
    error_um: tuple[float | None, ...]
    sigma_um: tuple[float | None, ...]
    bound_um: tuple[float | None, ...] = ()
    force_N: float | None = None
    force_sigma_N: float | None = None
    force_bound_N: float | None = None


@dataclass(frozen=True, slots=True)
class ServiceHealth:
    """The state of a service, and the reasons why it or its estimates are not good.

    Attributes:
        time_s: Time of the message, s since 1970.
        state: Of the service; `stale` if it has not been heard.
        quality: Of its estimates, as of `ServiceHeat`.
        reasons: A sentence each; empty where all is good.
        channels: An object for each channel: its quality and age, with the keys of the message `health`.
        drivers: An object for each driver: its counts of readings, drops and reconnects.
    """

    time_s: float
    state: str
    quality: str
    reasons: tuple[str, ...]
    channels: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    drivers: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ServiceAlarm:
    """An alarm.

    Attributes:
        id: Names it in `ServiceClient.command("acknowledge", alarm=…)`.
        severity: `minor`, `major` or `invalid`.
        state: Whether it is active, and acknowledged.
        reason: What is wrong, a sentence.
        remedy: What to do, a sentence; empty where none is known.
    """

    id: str
    severity: str
    state: str
    reason: str
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class ServiceAlarms:
    """The alarms that are raised.

    Attributes:
        time_s: Time of the message, s since 1970.
        alarms: All that are raised; empty where none is.
        quality: `stale` where the service has not been heard, so that no alarm is missing unnoticed.
    """

    time_s: float
    alarms: tuple[ServiceAlarm, ...]
    quality: str = "good"


def message_from(kind: type[Message], data: bytes | Mapping[str, Any]) -> Message | None:
    """Return a message of a kind; None where the data lack a key or have one of another type.

    Args:
        kind: Its class in this module.
        data: JSON, or a decoded document. Keys that the class lacks are ignored, so later versions can be
            read.
    """
    try:
        adapter = TypeAdapter(kind)
        return adapter.validate_json(data) if isinstance(data, bytes) else adapter.validate_python(data)
    except ValueError:
        return None


def documents_of(estimate: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the documents `heat`, `field` and `error` of a decoded estimate, with the keys that it
    contains.

    Args:
        estimate: The message `estimate`, with arrays by its keys.

    Returns:
        Documents as published under these keys, so that one class reads both. NaN and infinity are None.
    """
    values_by_key = {
        key: _numbers(value) for key, value in estimate.items() if isinstance(value, np.ndarray | list)
    }
    headers = {
        part: {"time_s": estimate.get("time_s"), "quality": estimate.get(f"{part}_quality")} for part in PARTS
    }
    columns = zip(
        *(values_by_key.get(key, []) for key in ("heat_W", "heat_sigma_W", "heat_bound_W")), strict=False
    )
    heats = [dict(zip(("heat_W", "sigma_W", "bound_W"), row, strict=True)) for row in columns]
    documents = {
        "heat": headers["heat"] | {"sources": dict(zip(estimate.get("sources", ()), heats, strict=False))}
    }
    places = {"position_m": values_by_key.get("position_m", [])}
    for name, keys in (
        ("field", {"temperature_degC": "field_degC", "sigma_K": "field_sigma_K", "bound_K": "field_bound_K"}),
        ("error", {"error_um": "error_um", "sigma_um": "error_sigma_um", "bound_um": "error_bound_um"}),
    ):
        columns_of_part = {
            key: values_by_key[column] for key, column in keys.items() if column in values_by_key
        }
        documents[name] = headers[name] | places | columns_of_part
    documents["error"] |= {key: values_by_key[key][0] for key in FORCE if key in values_by_key}
    return documents


def _numbers(values: Any) -> list[Any]:
    """Return plain values, None in place of NaN and infinity."""
    plain = np.asarray(values).tolist()
    return [None if isinstance(v, float) and not math.isfinite(v) else v for v in plain]
