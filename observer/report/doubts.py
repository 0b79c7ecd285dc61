"""What a configuration says that may be possible and can hardly be meant: warnings of `observer check`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

from observer.installation import Installation
from observer.installation.problems import key_of
from observer.installation.slips import doubt

NEAR = 1e-3
"""Places nearer than this part of the screw's length are the same place."""
_DEVIATION_OF_STEPS = 1.0 / math.sqrt(12.0)  # what rounding to whole steps of 1 adds


def doubts(config: Installation) -> list[str]:
    """Return what looks like a slip, a sentence each."""
    return [
        *_unusual(config.model_dump(exclude_unset=True)),
        *_same_places(config),
        *_short_strokes(config),
        *_shared_registers(config),
        *_finer_than_the_device(config),
        *_in_the_clear(config),
    ]


def _in_the_clear(config: Installation) -> Iterator[str]:
    if config.page is not None and (doubt := config.page.doubt):
        yield doubt


def _unusual(table: Mapping[str, Any]) -> Iterator[str]:
    for path, value in _numbers(table, ()):
        if found := doubt(path, value):
            yield f"{key_of(path, table)} = {found}"


def _numbers(at: Any, path: tuple[int | str, ...]) -> Iterator[tuple[tuple[int | str, ...], float]]:
    """Every number with its place."""
    if isinstance(at, Mapping):
        inner: Iterator[tuple[int | str, Any]] = iter(at.items())
    elif isinstance(at, list | tuple):
        inner = iter(enumerate(at))
    else:
        if isinstance(at, int | float) and not isinstance(at, bool):
            yield path, at
        return
    for key, value in inner:
        yield from _numbers(value, (*path, key))


def _same_places(config: Installation) -> Iterator[str]:
    near_m = NEAR * config.screw.length_m
    sensors = [(s.name, s.position_m) for s in config.sensor if s.position_m is not None]
    points = [(s.name, s.position_m) for s in config.source if s.estimate and s.position_m is not None]
    for kind, places, harm in (
        ("sensors", sensors, "the second tells nothing new; mend one position_m, or keep it as a spare"),
        ("sources", points, "their heats cannot be told apart; mend one position_m, or join them"),
    ):
        for (one, at_m), (other, other_m) in itertools.combinations(places, 2):
            if abs(at_m - other_m) < near_m:
                yield f"{kind} {one} and {other} are both at {at_m:g} m: {harm}"


def _short_strokes(config: Installation) -> Iterator[str]:
    for source in config.source:
        low, high = source.stroke_m or (0.0, math.inf)
        if source.length_m is not None and high - low < source.length_m:
            yield (
                f"source {source.name}: the stroke of {high - low:g} m is shorter than the nut, "
                f"{source.length_m:g} m; check stroke_m and length_m"
            )


def _shared_registers(config: Installation) -> Iterator[str]:
    """Values that overlap, within a device and between drivers of the same device."""
    entries = [
        (name, channel, addresses)
        for name, driver in config.drivers.items()
        for channel, addresses in driver.occupied().items()
    ]
    for (driver, one, a), (other_driver, other, b) in itertools.combinations(entries, 2):
        if shared := a & b:
            second = other if driver == other_driver else f"{other} of drivers.{other_driver}"
            register = min(address[-1] for address in shared)  # type: ignore[type-var]
            yield (
                f"drivers.{driver}: {one} and {second} both read register {register}; check the "
                "register and the type of both"
            )


def _finer_than_the_device(config: Installation) -> Iterator[str]:
    steps = {channel: step for driver in config.drivers.values() for channel, step in driver.steps().items()}
    for sensor in config.sensor:
        step_K = steps.get(sensor.channel, 0.0)
        if sensor.noise_K < _DEVIATION_OF_STEPS * step_K:
            yield (
                f"sensor {sensor.name}: noise_K = {sensor.noise_K:g} is finer than its device, whose steps "
                f"of {step_K:g} K alone make {_DEVIATION_OF_STEPS * step_K:.2g} K; raise it to that at least"
            )
