"""Nuisance parameters: known of any machine only within a tolerance, and not a missing effect.

Each is a small change of the configuration with the standard deviation given by `[tolerance]`. It may vary
inside every hypothesis under a Gaussian prior. It is neither reported nor written back.

The whole configuration is changed here. Filters take parameters to first order on the retained modes
(`model.learning`). A fit varies film, heats and material together, which compensate each other exactly, and
first-order errors would separate them. The film of `tests/data/rig`, 13.9 W/m²K, would come out at 14.4.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from observer.config.effects.base import EffectTable, Unnamed
from observer.config.effects.catalogue import offset_of
from observer.config.effects.terms import (
    AmbientShift,
    End,
    EndConductance,
    Lag,
    LawFactor,
    SensorOffset,
    StretchFilm,
    Term,
)
from observer.config.laws import SPEED_LAWS
from observer.config.machine import Config
from observer.config.sensors import Sensor
from observer.fit.parameters import PARAMETERS, candidates, get, with_values
from observer.frames import FloatArray

Scope = Literal["whole", "position", "lag", "run"]

TOLERANCE_OF = {
    "convection": ("surface.convection_W_m2K", "surface.factor"),
    "conductivity": ("screw.conductivity_W_mK",),
    "heat_capacity": ("screw.density_kg_m3", "screw.specific_heat_J_kgK"),
}
"""The parameters that each relative tolerance covers."""
UNEVEN = 0.01
"""Relative unevenness of a film along the screw."""
STRETCHES = 4
SETTLING_S = (900.0, 3600.0)
"""Time constants with which friction may settle to its law; their sum represents any between."""


def tolerances(config: Config, runs: int = 1) -> Iterator[tuple[Config, Scope]]:
    """Yield the configuration changed by one standard deviation of a tolerance, and its scope.

    Parameters that are free are left out.

    Args:
        config: The machine with its `[tolerance]`.
        runs: Number of logs. With several, the heat of each source differs between them.

    Yields:
        Pairs of a configuration and a scope. "whole" is one parameter. "position" and "lag" stand for one of
        each sensor, all changed at once; "run" for one of each log.
    """
    screw, tolerance = config.screw, config.tolerance
    for key, share in (
        ("conductivity_W_mK", tolerance.conductivity),
        ("specific_heat_J_kgK", tolerance.heat_capacity),
    ):
        if share > 0.0 and f"screw.{key}" not in (config.calibrate.free or ()):
            other = screw.model_copy(update={key: getattr(screw, key) * (1 + share)})
            yield config.model_copy(update={"screw": other}), "whole"
    yield from _of_parts(config)
    if tolerance.position_m > 0.0:
        moved = (_moved_inward(s, screw.length_m, tolerance.position_m) for s in config.sensor)
        yield config.model_copy(update={"sensor": tuple(moved)}), "position"
    film = config.surface.convection_W_m2K
    if film > 0:
        edges = np.linspace(0.0, screw.length_m, STRETCHES + 1)
        for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            yield with_terms(config, StretchFilm(a, b, UNEVEN * film)), "whole"
    for sensor in config.sensor:
        offset_K = sensor.offset(tolerance.offset_K)
        if offset_K > 0.0:
            zeroed = sensor.kind == "displacement"  # which is set to zero for each log
            yield with_terms(config, SensorOffset(sensor.name, offset_K, 0.0)), "run" if zeroed else "whole"
    if tolerance.ambient_K > 0.0:
        yield with_terms(config, AmbientShift(0.0, tolerance.ambient_K)), "run"
    if tolerance.lag_s > 0.0:
        thermal = [s for s in config.sensor if s.kind == "temperature"]
        yield with_terms(config, *(Lag(s.name, tolerance.lag_s) for s in thermal)), "lag"
    lawful = [s for s in config.source if s.law not in (None, "heat_of")]  # part of another goes with that
    for source in lawful if tolerance.heat_per_log > 0.0 and runs > 1 else []:
        stronger = source.model_copy(update={"scale": source.scale * (1 + tolerance.heat_per_log)})
        changed = tuple(stronger if s is source else s for s in config.source)
        yield config.model_copy(update={"source": changed}), "run"


def _of_parts(config: Config) -> Iterator[tuple[Config, Scope]]:
    """Yield the configuration with one link, one node's capacity, or one sensor's `shows` larger.

    Fitted ones are left out.
    """
    fittable = candidates(config)
    for key, _, share in tolerances_of_parts(config):
        if share > 0.0 and key in fittable and key not in (config.calibrate.free or ()):
            yield with_values(config, {key: (1.0 + share) * get(config, key)}), "whole"


def tolerances_of_parts(config: Config) -> Iterator[tuple[str, str, float]]:
    """Yield the tolerances of links, nodes, and sensors with `shows_tolerance`.

    Yields:
        Triples: key of the parameter, key of its tolerance, and the tolerance, relative.
    """
    for link in config.link:
        yield f"{link.key}.factor", f"{link.key}.tolerance", config.tolerance.of_link(link.tolerance)
    for node in config.node:
        share = config.tolerance.of_capacity(node.tolerance)
        yield f"node.{node.name}.capacity_J_K", f"node.{node.name}.tolerance", share
    for sensor in config.sensor:
        if sensor.shows_tolerance is not None:
            key = f"sensor.{sensor.name}.shows"
            yield key, f"{key}_tolerance", sensor.shows_tolerance


def calibration_tolerances(config: Config, runs: int) -> Iterator[tuple[Config, Scope]]:
    """Yield the tolerances of a calibration, as `tolerances` does.

    Added are a loss at each end and friction that settles with use. In a search these would be missing
    effects.
    """
    yield from tolerances(config, runs)
    end_W_K = config.tolerance.end_W_K
    for end in get_args(End):
        if end_W_K > 0.0 and getattr(config.boundary, end).kind != "prescribed":
            yield with_terms(config, EndConductance(end, end_W_K)), "whole"
    for source in config.source:
        share = config.law_uncertainty(source)
        if source.law in SPEED_LAWS and share > 0.0:
            for time_s in SETTLING_S:
                part = SettlingFriction(share, time_s)
                yield with_terms(config, LawFactor(source.name, part)), "whole"


def remaining_tolerances(config: Config, sigma: Mapping[str, float]) -> dict[str, float]:
    """Return the remaining tolerances of fitted parameters; a tolerance never grows.

    Heats keep their `law_uncertainty`, because they depart from their law at each start, even with a known
    scale. The tolerance of the scale combines σ of the fit with the difference of friction between logs.

    Args:
        config: The configuration before the fit.
        sigma: Relative σ of each fitted parameter, by its key.

    Returns:
        Relative tolerances by their keys in the configuration.
    """
    left = {
        tolerance: min(sigma[key], share)
        for key, tolerance, share in tolerances_of_parts(config)
        if key in sigma
    }
    for source in config.source:
        own_keys = {f"source.{source.name}.{name}" for name in PARAMETERS["source"]} & sigma.keys()
        if own_keys:
            scale = math.hypot(*(sigma[key] for key in own_keys), config.tolerance.heat_per_log)
            tolerance = source.scale_tolerance
            before = config.law_uncertainty(source) if tolerance is None else tolerance
            left[f"source.{source.name}.scale_tolerance"] = min(scale, before)
    for name, keys in TOLERANCE_OF.items():
        sigmas = [sigma[key] for key in keys if key in sigma]
        if sigmas:
            left[f"tolerance.{name}"] = min(math.hypot(*sigmas), getattr(config.tolerance, name))
    return left


@dataclass(frozen=True)
class SettlingFriction:
    """The factor 1 + a exp(−t/τ) on a heat, which decays while it runs.

    Attributes:
        part: a, relative to the law.
        time_s: τ, s of running time.
    """

    part: float
    time_s: float

    def __call__(self, _speed_rpm: FloatArray, running_s: FloatArray, /) -> FloatArray:
        """Return the factor (K,) for running times, s, (K,)."""
        return np.asarray(1.0 + self.part * np.exp(-running_s / self.time_s))


def with_terms(config: Config, *terms: Term) -> Config:
    """Return the configuration with one more effect that consists of these terms."""
    return config.model_copy(update={"effect": (*config.effect, Unnamed(terms))})


def _moved_inward(sensor: Sensor, length_m: float, by_m: float) -> Sensor:
    """The sensor a little nearer to the middle of the screw; one beside the screw stays, and a probe."""
    if sensor.position_m is None or sensor.kind == "displacement":
        return sensor
    signed_m = by_m if sensor.position_m < length_m / 2 else -by_m
    return sensor.model_copy(update={"position_m": sensor.position_m + signed_m})


CLEAR_SIGMA = 2.0
"""An offset of this many σ is written as an effect of its own."""


class LearntChanges(NamedTuple):
    """Changes of a configuration by the parameters that an estimator has learnt.

    Attributes:
        values: New values by key.
        left: Remaining tolerances by key; those of offsets are in K.
        biases: Offsets of sensors as effects.
    """

    values: dict[str, float]
    left: dict[str, float]
    biases: tuple[EffectTable, ...]


def learnt_changes(config: Config, learnt: Mapping[str, tuple[float, float]]) -> LearntChanges:
    """Return the changes of a configuration after an estimator has learnt parameters while it ran.

    A parameter without a key, such as the ambient's offset, stays within its tolerance. An offset is written
    if it exceeds two σ and the sensor has no offset effect yet.

    Args:
        config: The configuration with which the estimator ran.
        learnt: Value and σ of each parameter by name, in the unit of the name.
    """
    values = {key: value for key, (value, _) in learnt.items() if key in candidates(config) and value > 0.0}
    left = remaining_tolerances(config, {key: learnt[key][1] / value for key, value in values.items()})
    terms = [term for effect in config.effect for term in effect.terms(config)]
    modelled = {term.sensor for term in terms if isinstance(term, SensorOffset)}
    biases = []
    for sensor in config.sensor:
        value_K, sigma_K = learnt.get(key := f"sensor.{sensor.name}.offset_K", (0.0, 0.0))
        if abs(value_K) > CLEAR_SIGMA * sigma_K and sensor.name not in modelled:
            biases.append(offset_of(sensor.name, value_K))
            left[key] = min(sigma_K, sensor.offset(config.tolerance.offset_K))
    return LearntChanges(values, left, tuple(biases))
