"""The configuration of a machine without its drivers: every unit and range, checked once, here.

Nothing else in the package checks ranges again. The drivers of the channels belong to the installation
(`observer.installation`), which mathematics does not import.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from observer.config import quantities
from observer.config.candidates import MOST_PLACES, SensorCandidate, candidate_problems
from observer.config.effects.catalogue import Effect, effect_class
from observer.config.estimator import EstimatorSettings, ForecastSettings, Integrity, Probing, Tolerance
from observer.config.logs import Logs
from observer.config.mounting import Compensation
from observer.config.quantities import Section
from observer.config.sections import UNSEEN_LAW_UNCERTAINTY, Description
from observer.errors import ConfigError, meant, raise_all
from observer.frames import FloatArray

LEARNT = ("convection", "offset_K", "link", "gain")
"""What is learnt where nothing else is said, beside thermocouples on the screw."""
MOST_ROWS = 1500
"""Limit of moving nuts times reported positions: the effect of each nut at each position is tabulated at the
start.
"""


class MachineName(Section):
    """Names the key space `ballscrew/<name>/<axis>/…`."""

    name: quantities.Name = "machine"  #: the machine
    axis: quantities.Name = "x"  #: its axis


class Model(Section):
    """Which modes are kept."""

    #: β: share of every source's steady field in the kept modes
    truncation: Annotated[quantities.Number, Field(gt=0, le=1 - 1e-9)] = 0.9995
    #: `"tail"`: compared with all modes. `"kim"`: the ratio of two sums, as printed in the paper
    criterion: Literal["tail", "kim"] = "tail"
    #: a fixed number of modes instead, 1 to 400
    modes: Annotated[quantities.Count, Field(ge=1, le=400)] | None = None
    #: with `"tail"`: the first dropped mode settles in this time or faster
    settle_s: quantities.Duration = 10.0
    #: adds the steady field of the dropped modes, through one lag per source
    static_correction: quantities.Flag = True


class Calibrate(Section):
    """The parameters that may be fitted."""

    #: what may be fitted, as `"surface.convection_W_m2K"` or `"source.<name>.<key>"`; – is the base film and
    #: each law's scale
    free: Annotated[tuple[Annotated[str, Field(max_length=256)], ...], Field(max_length=200)] | None = None


class Discover(Section):
    """The effects that a search considers."""

    #: kinds of [effects](effects.md) that the machine cannot have
    without: Annotated[tuple[Annotated[str, Field(max_length=256)], ...], Field(max_length=100)] = ()
    #: [effects of your own](../how-to/add-an-effect.md) that a search tries as well, each `"module:Class"`
    also: Annotated[tuple[Annotated[str, Field(max_length=256)], ...], Field(max_length=100)] = ()

    @model_validator(mode="after")
    def _kinds_exist(self) -> Discover:
        problems = []
        for key, kinds in (("without", self.without), ("also", self.also)):
            for kind in kinds:
                try:
                    effect_class(kind)
                except ValueError as error:
                    problems.append(f"{key}: {error}")
        raise_all(problems)
        return self


class Output(Section):
    """Positions at which the field is reported, and the reference of the thermal error."""

    #: where field and thermal error are reported, increasing; – is 21 equal steps
    positions_m: tuple[quantities.Position, ...] | None = Field(default=None, min_length=2, max_length=1000)
    #: temperature of zero thermal error; – is the first ambient temperature
    reference_degC: quantities.Air | None = None


class ChannelLimits(Section):
    """Limits of one channel, in its own unit; a missing limit has the default of its quantity."""

    #: smallest accepted value; – is −40 °C on screw, node and end, −20 °C of the air, 5 % of the
    #: screw before its left end, the highest speed backwards
    low: quantities.Finite | None = None
    #: largest accepted value; – is 150 °C, 60 °C of the air, 5 % beyond the right end, and 250,000 rpm·mm
    #: over the screw's diameter
    high: quantities.Finite | None = None
    #: largest rate of change, beyond ten times the noise; – is 5 K/s for thermocouples, none for others
    rate_per_s: quantities.Positive | None = None
    #: how far a thermocouple on the screw may be above the air; – is 45 K, none where a source has a
    #: `power_channel`
    above_ambient_K: quantities.Positive | None = None
    #: how far below; – is 25 K, none where a source has a `power_channel`
    below_ambient_K: quantities.Positive | None = None
    on_change: quantities.Flag = False  #: the channel sends only changes and heartbeats
    #: `on_change`: longest silence, after which the value is stale; 1.5 times the longest pause
    heartbeat_s: Annotated[quantities.Positive, Field(ge=0.1, le=86_400)] | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> ChannelLimits:
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low = {self.low} must be smaller than high = {self.high}; correct one of them")
        if self.on_change and self.heartbeat_s is None:
            raise ValueError(
                "on_change needs heartbeat_s; add it, 1.5 times the longest pause between two values in s"
            )
        if self.heartbeat_s is not None and not self.on_change:
            raise ValueError("heartbeat_s has a meaning with on_change = true only; add that, or remove it")
        return self


_BESIDE_THE_MODEL = {
    "machine", "candidate", "calibrate", "discover", "compensation", "forecast", "log", "probing",
}  # fmt: skip


class Config(Description):
    """A machine and the tasks set for it."""

    machine: MachineName = MachineName()
    effect: Annotated[tuple[Effect, ...], Field(max_length=100)] = ()
    candidate: Annotated[tuple[SensorCandidate, ...], Field(max_length=MOST_PLACES)] = ()
    model: Model = Model()
    tolerance: Tolerance = Tolerance()
    integrity: Integrity = Integrity()
    probing: Probing = Probing()
    estimator: EstimatorSettings = EstimatorSettings()
    calibrate: Calibrate = Calibrate()
    discover: Discover = Discover()
    output: Output = Output()
    compensation: Compensation = Compensation()
    forecast: ForecastSettings = ForecastSettings()
    log: Logs = Logs()
    limits: dict[quantities.Channel, ChannelLimits] = Field(default_factory=dict, max_length=256)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        raise_all(self.contradictions())
        return self

    def contradictions(self) -> list[str]:
        """Return contradictions between tables, a sentence each with the remedy; empty for a consistent
        machine.
        """
        return [
            *_beyond_the_screw(self),
            *_too_much_work(self),
            *_growth_unknown(self),
            *_displacements(self),
            *_names_twice(self),
            *_heats_unknown(self),
            *_limits_unknown(self),
            *_logs_unknown(self),
            *candidate_problems(self.candidate, self.screw.length_m, [node.name for node in self.node]),
        ]

    def remade(self, table: dict[str, Any]) -> Self:
        """Return a configuration of the same kind from another table, checked again.

        Raises:
            ConfigError: The table is not a valid configuration.
        """
        try:
            return self.model_validate(table)
        except ValidationError as error:
            raise ConfigError(f"the configuration with other values: {error}") from None

    @property
    def channels(self) -> tuple[str, ...]:
        """Every channel the model reads, each once, in the order of the configuration.

        Columns of frames are in this order.
        """
        names = [s.channel for s in self.sensor]
        names += [s.measured_channel for s in self.sensor]
        for source in self.source:
            names += [source.position_channel, source.speed_channel, *source.law_channels]  # type: ignore[list-item]
        names += [self.ambient.channel, self.boundary.left.channel, self.boundary.right.channel]  # type: ignore[list-item]
        names.append(None if self.bed is None else self.bed.channel)  # type: ignore[arg-type]
        names.append(self.surface.speed_channel)  # type: ignore[arg-type]
        names += [channel for effect in self.effect for channel in effect.channels]
        return tuple(dict.fromkeys(n for n in names if n is not None))

    @property
    def sensor_channels(self) -> frozenset[str]:
        """The channels of sensors, none of which is an input of the model."""
        return frozenset(c for s in self.sensor for c in (s.channel, s.measured_channel))

    @property
    def derived_channels(self) -> frozenset[str]:
        """The channels that no driver delivers, since they follow from others: displacements along a nut's
        way.
        """
        return frozenset(s.channel for s in self.sensor if s.along is not None)

    @property
    def learnt(self) -> tuple[str, ...]:
        """The kinds of parameters that are learnt; empty for an estimator whose gain covers heats and
        field only.
        """
        if not self.estimator.learns:
            return ()
        if self.estimator.learn is not None:
            return self.estimator.learn
        return LEARNT if self.screw_is_seen else (*LEARNT, "law")

    def resting_on_laws(self) -> Self:
        """Return the configuration for use without a thermocouple on the screw.

        The heat laws are then learnt, and have the uncertainty of laws that no sensor checks unless one is
        given.
        """
        learn = (*LEARNT, "law") if self.estimator.learn is None else self.estimator.learn
        unseen = [
            s.model_copy(update={"law_uncertainty": UNSEEN_LAW_UNCERTAINTY})
            if s.law_uncertainty is None
            else s
            for s in self.source
        ]
        estimator = self.estimator.model_copy(update={"learn": learn})
        return self.model_copy(update={"estimator": estimator, "source": tuple(unseen)})

    @property
    def gives_bounds(self) -> bool:
        """Whether estimates have bounds on the error that a faulty sensor could hide.

        They have none where heats are known by one sensor each and the laws: no sensor checks another.
        """
        learns_laws = "law" in self.learnt and any(s.law is not None and s.estimate for s in self.source)
        return self.integrity.enabled and self.estimator.screens and not learns_laws

    @property
    def needs_um(self) -> float | None:
        """The accuracy of the thermal error that the part needs, µm, at 95 %; None where nothing is said."""
        return self.probing.needs_um or self.integrity.limit_um

    @property
    def sample_s(self) -> dict[str, float]:
        """The period of each channel in s, where that is known; here of none, as a machine has no drivers."""
        return {}

    @property
    def reading_s(self) -> FloatArray:
        """How often each sensor has a reading, s, (s,): at the ticks of the estimator after its own."""
        period_s = self.estimator.period_s
        own_s = [s.probing_s or self.sample_s.get(s.channel, period_s) for s in self.sensor]
        return np.array([period_s * max(1, math.ceil(sensor_s / period_s - 1e-9)) for sensor_s in own_s])

    @property
    def heartbeats_s(self) -> dict[str, float]:
        """The longest silence in s of each channel that sends only on change."""
        return {name: one.heartbeat_s for name, one in self.limits.items() if one.heartbeat_s is not None}

    @property
    def plant_digest(self) -> str:
        """A hash of everything that gives an estimator's state its meaning, 16 hexadecimal digits.

        It leaves out the tables that do not change the model, so a checkpoint outlives a change of these.
        """
        tables = Config.model_fields.keys() - _BESIDE_THE_MODEL
        return hashlib.sha256(self.model_dump_json(include=tables).encode()).hexdigest()[:16]

    @property
    def digest(self) -> str:
        """A hash of the configuration in force, 16 hexadecimal digits.

        The order in which the code declares its values does not change it. A command to the service names it.
        """
        values = self.model_dump(mode="json", exclude={"log", "candidate"})
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def _beyond_the_screw(config: Config) -> Iterator[str]:
    length_m = config.screw.length_m
    places = [(f"sensor {s.name}: position_m", s.position_m) for s in config.sensor]
    for source in config.source:
        end_m = source.stroke_m and source.stroke_m[1]
        for key, x_m in (("position_m", source.position_m), ("to_m", source.to_m), ("stroke_m", end_m)):
            places.append((f"source {source.name}: {key}", x_m))
    places += [("output: positions_m", x_m) for x_m in config.output.positions_m or ()]
    for place, x_m in places:
        if x_m is not None and x_m > length_m:
            slip = f"; did you mean {x_m / 1000:g} ({x_m:g} mm)?" if x_m / 1000 <= length_m < x_m / 20 else ""
            yield f"{place} = {x_m} m lies beyond the screw's length_m = {length_m} m; fix one of them{slip}"
    for source in config.source:
        if source.length_m is not None and source.length_m > length_m:
            yield (
                f"source {source.name}: length_m = {source.length_m} m makes the nut longer than the screw, "
                f"length_m = {length_m} m; fix one of them"
            )


def _logs_unknown(config: Config) -> Iterator[str]:
    periods_s, sensor_names = config.log.sensor_period_s, [s.name for s in config.sensor]
    for name in periods_s if isinstance(periods_s, dict) else ():
        if name not in sensor_names:
            yield f'log: sensor_period_s: "{name}" is not a sensor; give one of {", ".join(sensor_names)}'
    for name in config.log.columns:
        if name not in config.channels:
            yield f'log: columns: the model reads no channel "{name}"; it reads {", ".join(config.channels)}'


def _limits_unknown(config: Config) -> Iterator[str]:
    for name in config.limits:
        if name not in config.channels:
            yield (
                f'limits: the model reads no channel "{name}"{meant(name, config.channels)}; it reads '
                f"{', '.join(config.channels)}"
            )
    occasional = {s.channel for s in config.sensor if s.occasional}
    for name, heartbeat_s in config.heartbeats_s.items():
        least_s = max(config.estimator.period_s, config.sample_s.get(name, 0.0))
        if heartbeat_s < least_s:
            yield (
                f"limits: {name}: heartbeat_s = {heartbeat_s:g} is shorter than the {least_s:g} s between "
                "two looks at the channel; raise it"
            )
        if name in occasional:
            yield f"limits: {name}: its sensor is occasional, never overdue; remove occasional, or on_change"


def _too_much_work(config: Config) -> Iterator[str]:
    nuts = sum(s.shape == "nut" and s.position_channel is not None for s in config.source)
    places = len(config.output.positions_m or ()) + len(config.sensor)
    if nuts * places > MOST_ROWS:
        yield (
            f"output: positions_m: {nuts} moving nuts times {places} places (sensors included) are more than "
            f"the {MOST_ROWS} that can be tabulated; report fewer places"
        )


def _growth_unknown(config: Config) -> Iterator[str]:
    moved = [s.name for s in config.sensor if s.kind == "displacement"]
    needs_growth = (
        ("supports", config.supports is not None),
        ("bed", config.bed is not None),
        ("compensation", config.compensation.enabled),
        *((f"sensor {name}: a displacement", True) for name in moved),
    )
    for name, is_configured in needs_growth:
        if is_configured and config.screw.expansion_1_K is None:
            yield f"{name} needs the screw's expansion coefficient; give screw.expansion_1_K"
    for key, x_m in (
        ("travel_m", (config.compensation.travel_m or (0.0,))[-1]),
        ("reference_m", config.compensation.reference_m or 0.0),
        ("zero_at_m", config.compensation.zero_at_m or 0.0),
    ):
        if x_m > config.screw.length_m:
            yield f"compensation: {key} reaches {x_m} m, beyond the screw's length_m; fix one of them"
    positions_m = config.output.positions_m or ()
    if any(b <= a for a, b in itertools.pairwise(positions_m)):
        yield "output: positions_m must increase; sort them"


def _displacements(config: Config) -> Iterator[str]:
    moved = [s.name for s in config.sensor if s.kind == "displacement"]
    if not moved:
        return
    if len(moved) == len(config.sensor):
        yield (
            f"sensor {moved[0]}: no sensor measures a temperature, from which an estimate starts; add a "
            "thermocouple, on a node if none fits on the screw"
        )
    if not config.estimator.screens:
        yield (
            f'sensor {moved[0]}: a displacement needs estimator.kind = "kalman" with engine = "compiled"; '
            "choose these, or remove the sensor"
        )


def _names_twice(config: Config) -> Iterator[str]:
    for kind, names in (
        ("source", [s.name for s in config.source]),
        ("sensor", [s.name for s in config.sensor]),
        ("sensor channel", [s.channel for s in config.sensor]),
    ):
        for name in dict.fromkeys(names):
            if names.count(name) > 1:
                yield f'{names.count(name)} entries of {kind} are called "{name}"; give each its own name'


def _heats_unknown(config: Config) -> Iterator[str]:
    laws = {s.name: s.law for s in config.source}
    for source in config.source:
        if source.heat_of is not None and laws.get(source.heat_of, "heat_of") in (None, "heat_of"):
            owners = ", ".join(n for n, law in laws.items() if law not in (None, "heat_of")) or "none yet"
            yield (
                f"source {source.name}: heat_of names no source with a heat law of its own; "
                f"name one of {owners}"
            )
    yield from _following_what(config)
    if not any(s.estimate for s in config.source):
        yield "every source has estimate = false; leave at least one to be estimated"


def _following_what(config: Config) -> Iterator[str]:
    """Settings incompatible with heats that follow another."""
    estimated = {s.name for s in config.source if s.estimate}
    for source in (s for s in config.source if s.follows):
        place = f"source {source.name}: follows"
        if source.name not in estimated or source.heat_of not in estimated:
            yield f"{place} an estimated heat; leave estimate = true for both, or remove follows"
        if source.position_channel is not None:
            yield f"{place}: a nut whose position is measured follows no other heat; remove follows"
        if config.node or any(s.covers_film for s in config.source):
            yield f"{place}: not with [[node]] or covers_film, which go by each source; remove one of them"


def untied(config: Config) -> Config:
    """Return the configuration with every heat independent of the others.

    Predictions by the laws alone are the same.
    """
    if not any(s.follows for s in config.source):
        return config
    apart = tuple(s.model_copy(update={"follows": False}) for s in config.source)
    return config.model_copy(update={"source": apart})


def effect_problems(config: Config) -> list[str]:
    """Return why effects cannot apply to this machine, a sentence each; empty where all can."""
    problems = []
    for effect in config.effect:
        try:
            effect.terms(config)
        except ConfigError as error:
            problems.append(str(error))
    return problems
