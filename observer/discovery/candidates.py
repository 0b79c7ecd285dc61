"""Where a search begins: every effect of the library, at every target, in the shapes it may take.

A shape is an effect at a typical strength; how the prediction changes with it is the effect's signature.
Parameters that only scale a signature need one shape, those that change its form need several.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from observer.config import Config
from observer.discovery.hypothesis import Parameter
from observer.discovery.parameters import FILM
from observer.effects.base import EffectTable
from observer.effects.catalogue import KINDS, LIBRARY
from observer.laws import SPEED_LAWS, Surface
from observer.model.heat.law import law_channels

BY_KIND = dict(zip(KINDS, LIBRARY, strict=True))


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect at a target: the shapes to try, what is fitted with which natural scale, and upper limits."""

    kind: str
    target: str | None
    shapes: tuple[Mapping[str, float], ...]
    scales: Mapping[str, float]
    given: Mapping[str, Any] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)

    def effect(self, shape: Mapping[str, float]) -> EffectTable:
        """Return the effect in one of its shapes."""
        target = {} if self.target is None else {"target": self.target}
        return BY_KIND[self.kind].model_validate({"kind": self.kind, **target, **self.given, **shape})

    def parameters(self, index: int) -> tuple[Parameter, ...]:
        """What is fitted where the effect is number `index` of the configuration."""
        effect = BY_KIND[self.kind]
        bounds = {key: bounds_of(effect, key) for key in effect.parameters if key in self.scales}
        return tuple(
            Parameter(index, key, self.scales[key], low, min(high, self.limits.get(key, np.inf)))
            for key, (low, high) in bounds.items()
        )

    @property
    def name(self) -> str:
        """Kind and target."""
        return self.kind if self.target is None else f"{self.kind} at {self.target}"


def bounds_of(effect: type[EffectTable], key: str) -> tuple[float, float]:
    """The range of an effect's parameter, from its own table."""
    low, high = -np.inf, np.inf
    for limit in effect.model_fields[key].metadata:
        if isinstance(limit, Ge | Gt):
            low = float(limit.ge if isinstance(limit, Ge) else limit.gt)  # type: ignore[arg-type]
        elif isinstance(limit, Le | Lt):
            high = float(limit.le if isinstance(limit, Le) else limit.lt)  # type: ignore[arg-type]
    return low, high


def library(config: Config, keys: tuple[str, ...]) -> tuple[Candidate, ...]:
    """Return the candidates of a configuration whose free parameters are `keys`."""
    return (*_surface(config, keys), *_ends(config), *_heats(config), *_sensors(config))


def _surface(config: Config, keys: tuple[str, ...]) -> Iterator[Candidate]:
    L = config.screw.length_m
    spins = any(s.speed_channel is not None for s in config.source)
    if FILM not in keys and config.surface == Surface():
        yield _one("surface_convection", None, coefficient_W_m2K=5.0)
    if spins and not config.surface.turns:
        yield _one("speed_convection", None, gain=0.1)
    stretches = [(i * L / 8, (i + w) * L / 8) for w in (1, 2, 3, 4) for i in range(9 - w)]
    shapes = tuple({"from_m": a, "to_m": b, "extra_W_m2K": 5.0} for a, b in stretches)
    yield Candidate(
        "uneven_convection",
        None,
        shapes,
        {"from_m": L / 8, "to_m": L / 8, "extra_W_m2K": 5.0},
        limits={"from_m": L, "to_m": L},
    )
    yield _one("radiation", None, emissivity=0.3)
    yield _one("ambient_drift", None, rate_K_h=0.3)
    if spins:
        shapes = tuple({"conductance_W_K": 0.3, "inlet_degC": t} for t in (12.0, 20.0, 28.0))
        yield Candidate("coolant", None, shapes, {"conductance_W_K": 0.3, "inlet_degC": 5.0})


def _ends(config: Config) -> Iterator[Candidate]:
    spins = any(s.speed_channel is not None for s in config.source)
    for end in ("left", "right"):
        if getattr(config.boundary, end).kind == "prescribed":
            continue
        yield _one("end_conduction", end, conductance_W_K=0.05)
        yield _mass(end)
        if spins:
            yield _one("end_heat", end, heat_W_rpm=1e-3)
        yield _one("motor_heat", end, heat_W=2.0)


def _heats(config: Config) -> Iterator[Candidate]:
    L = config.screw.length_m
    for source in config.source:
        if source.shape == "nut":
            yield _mass(source.name)
            yield _one("dwell", source.name, fraction=0.1)
        if not law_channels(source, config.source):
            continue
        yield _one("friction_fade", source.name, per_K=3e-3)
        if source.law in SPEED_LAWS:
            yield _one("friction_speed", source.name, exponent=1.1, scales={"exponent": 0.2})
        shapes = tuple({"fraction": 0.2, "time_s": t} for t in (400.0, 1200.0, 3600.0))
        yield Candidate("run_in", source.name, shapes, {"fraction": 0.2, "time_s": 1200.0})
    shapes = tuple({"position_m": x, "heat_W": 2.0} for x in np.linspace(0.0, L, 13).tolist())
    yield Candidate(
        "local_heat", None, shapes, {"position_m": L / 10, "heat_W": 2.0}, limits={"position_m": L}
    )


def _sensors(config: Config) -> Iterator[Candidate]:
    for sensor in config.sensor:
        yield _one("sensor_lag", sensor.name, time_constant_s=20.0)
        yield _one("sensor_bias", sensor.name, offset_K=0.3)
        yield _one("sensor_drift", sensor.name, rate_K_h=0.2)


def _mass(target: str) -> Candidate:
    pairs = ((300.0, 1.0), (1000.0, 1.0), (1000.0, 5.0), (4000.0, 1.0), (4000.0, 5.0))
    shapes = tuple({"capacity_J_K": C, "conductance_W_K": G} for C, G in pairs)
    return Candidate("attached_mass", target, shapes, {"capacity_J_K": 1000.0, "conductance_W_K": 2.0})


def _one(
    kind: str, target: str | None, scales: Mapping[str, float] | None = None, **shape: float
) -> Candidate:
    return Candidate(kind, target, (shape,), scales or shape)
