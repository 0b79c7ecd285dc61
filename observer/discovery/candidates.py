"""Where a search begins: every effect of the library, at every target, in the shapes it may take.

A shape is an effect at a typical strength; how the prediction changes with it is the effect's signature.
Parameters that only scale a signature need one shape, those that change its form need several.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from observer.config import Config
from observer.effects.base import EffectTable
from observer.effects.catalogue import KINDS, LIBRARY
from observer.fit.hypothesis import Parameter
from observer.fit.parameters import FILM
from observer.model.law import law_channels
from observer.tables.laws import SPEED_LAWS, Surface

BY_KIND = dict(zip(KINDS, LIBRARY, strict=True))
NEUTRAL = {"exponent": 1.0}
"""Where a parameter changes nothing, if that is not zero."""
LEAST_LAG_S = 10.0
"""Sensors that lag less are within tolerance."""
MOST_CAPACITY_J_K = 2e4
"""Forty kilograms of steel; a body that stores more hardly warms, and is a loss."""
INLET_degC = (-20.0, 90.0)
"""Of any coolant."""
CELLS = 8
"""Parts of the screw from which stretches of another film are made up."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect at a target: the shapes to try, what is fitted with which natural scale, and its limits
    where they are narrower than the effect's own.

    `linear` are the parameters that a strength multiplies, all together; `told` those whose interval must end
    below their upper limit, for beyond it the effect is another one.
    """

    kind: str
    target: str | None
    shapes: tuple[Mapping[str, float], ...]
    scales: Mapping[str, float]
    linear: tuple[str, ...]
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    told: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Kind and target."""
        return self.kind if self.target is None else f"{self.kind} at {self.target}"

    def effect(self, shape: Mapping[str, float], strength: float = 1.0) -> EffectTable:
        """Return the effect in one of its shapes, so many times as strong."""
        values = dict(shape)
        for p in self.parameters(0):
            if p.key in self.linear:
                neutral = NEUTRAL.get(p.key, 0.0)
                values[p.key] = float(np.clip(neutral + strength * (shape[p.key] - neutral), p.low, p.high))
        target = {} if self.target is None else {"target": self.target}
        return BY_KIND[self.kind].model_validate({"kind": self.kind, **target, **values})

    def strengths(self, shape: Mapping[str, float]) -> tuple[float, float]:
        """The range of strengths that the bounds of the effect allow."""
        low, high = -np.inf, np.inf
        for p in self.parameters(0):
            if p.key in self.linear:
                neutral = NEUTRAL.get(p.key, 0.0)
                ends = sorted((limit - neutral) / (shape[p.key] - neutral) for limit in (p.low, p.high))
                low, high = max(low, ends[0]), min(high, ends[1])
        return low, high

    def parameters(self, index: int) -> tuple[Parameter, ...]:
        """What is fitted where the effect is number `index` of the configuration."""
        effect = BY_KIND[self.kind]
        bounds = {key: bounds_of(effect, key) for key in effect.parameters if key in self.scales}
        limits = {key: self.limits.get(key, (-np.inf, np.inf)) for key in bounds}
        return tuple(
            Parameter(index, key, self.scales[key], max(low, limits[key][0]), min(high, limits[key][1]))
            for key, (low, high) in bounds.items()
        )


def bounds_of(effect: type[EffectTable], key: str) -> tuple[float, float]:
    """The range of an effect's parameter, from its own table."""
    low, high = -np.inf, np.inf
    for limit in effect.model_fields[key].metadata:
        if isinstance(limit, Ge | Gt):
            low = float(limit.ge if isinstance(limit, Ge) else limit.gt)  # type: ignore[arg-type]
        elif isinstance(limit, Le | Lt):
            high = float(limit.le if isinstance(limit, Le) else limit.lt)  # type: ignore[arg-type]
    return low, high


def library(config: Config, keys: tuple[str, ...], without: Sequence[str] = ()) -> tuple[Candidate, ...]:
    """Return the candidates of a configuration whose free parameters are `keys`, but for some kinds."""
    every = (*_surface(config, keys), *_ends(config), *_heats(config), *_sensors(config))
    return tuple(c for c in every if c.kind not in without)


def _surface(config: Config, keys: tuple[str, ...]) -> Iterator[Candidate]:
    L = config.screw.length_m
    spins = any(s.speed_channel is not None for s in config.source)
    if FILM not in keys and config.surface == Surface():
        yield _one("surface_convection", None, coefficient_W_m2K=5.0)
    if spins and not config.surface.turns:
        yield _one("speed_convection", None, gain=0.1)
    stretches = [(i * L / CELLS, (i + w) * L / CELLS) for w in (1, 2, 3, 4) for i in range(CELLS + 1 - w)]
    shapes = tuple({"from_m": a, "to_m": b, "extra_W_m2K": 5.0} for a, b in stretches)
    scales = {"from_m": L / CELLS, "to_m": L / CELLS, "extra_W_m2K": 5.0}
    limits = {"from_m": (0.0, L), "to_m": (0.0, L)}
    yield Candidate("uneven_convection", None, shapes, scales, ("extra_W_m2K",), limits)
    yield _one("radiation", None, emissivity=0.3)
    yield _one("ambient_drift", None, rate_K_h=0.3)
    if spins:
        shapes = tuple({"conductance_W_K": 0.3, "inlet_degC": t} for t in (12.0, 20.0, 28.0))
        scales = {"conductance_W_K": 0.3, "inlet_degC": 5.0}
        limits = {"inlet_degC": INLET_degC}
        yield Candidate("coolant", None, shapes, scales, ("conductance_W_K",), limits)


def _ends(config: Config) -> Iterator[Candidate]:
    spins = any(s.speed_channel is not None for s in config.source)
    for end in ("left", "right"):
        if getattr(config.boundary, end).kind == "prescribed":
            continue
        yield _one("end_conduction", end, conductance_W_K=0.05)
        yield _mass(end)
        if spins:
            yield _one("end_heat", end, heat_W_rpm=1e-3)
        yield replace(_one("motor_heat", end, heat_W=2.0), limits={"heat_W": (0.0, np.inf)})


def _heats(config: Config) -> Iterator[Candidate]:
    L = config.screw.length_m
    for source in config.source:
        on_screw = source.screw_share > 0.0
        if source.shape == "nut" and on_screw:
            yield _mass(source.name)
            yield _one("dwell", source.name, fraction=0.1)
        if not law_channels(source, config.source):
            continue
        if on_screw:
            yield _one("friction_fade", source.name, per_K=3e-3)
        if source.law in SPEED_LAWS:
            yield _one("friction_speed", source.name, {"exponent": 0.2}, exponent=1.1)
        shapes = tuple({"fraction": 0.2, "time_s": t} for t in (400.0, 1200.0, 3600.0))
        yield Candidate("run_in", source.name, shapes, {"fraction": 0.2, "time_s": 1200.0}, ("fraction",))
    shapes = tuple({"position_m": x, "heat_W": 2.0} for x in np.linspace(0.0, L, 13).tolist())
    scales = {"position_m": L / 10, "heat_W": 2.0}
    yield Candidate("local_heat", None, shapes, scales, ("heat_W",), {"position_m": (0.0, L)})


def _sensors(config: Config) -> Iterator[Candidate]:
    for sensor in config.sensor:
        lags = tuple({"time_constant_s": t} for t in (20.0, 60.0, 150.0, 400.0))
        limits = {"time_constant_s": (LEAST_LAG_S, 3600.0)}
        scales = {"time_constant_s": 20.0}
        yield Candidate("sensor_lag", sensor.name, lags, scales, ("time_constant_s",), limits)
        yield _one("sensor_bias", sensor.name, offset_K=0.3)
        yield _one("sensor_drift", sensor.name, rate_K_h=0.2)


def _mass(target: str) -> Candidate:
    """Bodies by time constant and by how much of their heat the screw feels."""
    pairs = ((100.0, 3.0), (500.0, 1.0), (2000.0, 5.0), (4000.0, 1.0))
    shapes = tuple({"capacity_J_K": C, "conductance_W_K": G} for C, G in pairs)
    scales = {"capacity_J_K": 1000.0, "conductance_W_K": 2.0}
    limits = {"capacity_J_K": (0.0, MOST_CAPACITY_J_K)}
    linear = ("capacity_J_K", "conductance_W_K")
    return Candidate("attached_mass", target, shapes, scales, linear, limits, told=("capacity_J_K",))


def _one(
    kind: str, target: str | None, scales: Mapping[str, float] | None = None, **shape: float
) -> Candidate:
    return Candidate(kind, target, (shape,), scales or shape, tuple(shape))
