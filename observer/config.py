"""The configuration: every unit and every range, checked once, here.

The file is TOML with the unit in the name of each key. `load` returns frozen objects; nothing else in
the package checks ranges again.
"""

from __future__ import annotations

import difflib
import hashlib
import itertools
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field, ValidationError, model_validator

from drivers.settings import DRIVER_KINDS, UNION_TAGS, DriverSettings, Settings
from observer.effects.catalogue import KINDS, Effect
from observer.endpoints import checked_endpoint
from observer.errors import ConfigError
from observer.keeping import Checkpoint, Record
from observer.mounting import Compensation
from observer.quantities import Name, NonNegative, Positive, Section, Temperature
from observer.sections import Description

Endpoint = Annotated[str, AfterValidator(checked_endpoint)]


class Machine(Section):
    """Names the key space `ballscrew/<name>/<axis>/…`."""

    name: Name = "machine"
    axis: Name = "x"


class Model(Section):
    """Which modes are kept."""

    truncation: Annotated[float, Field(gt=0, lt=1)] = 0.9995
    criterion: Literal["tail", "kim"] = "tail"
    modes: Annotated[int, Field(ge=1, le=400)] | None = None
    settle_s: Positive = 10.0
    static_correction: bool = True


class EstimatorSettings(Section):
    """How heats and field are estimated."""

    kind: Literal["kalman", "luenberger"] = "kalman"
    period_s: Annotated[float, Field(ge=0.001, le=3600)] = 0.5
    # Kalman
    engine: Literal["compiled", "filterpy", "constant"] = "compiled"
    gate_sigma: Positive = 5.0
    initial_sigma_K: Positive = 2.0
    field_noise_K_sqrt_s: NonNegative = 0.002
    # Luenberger
    pole_rule: Literal["bandwidth", "kim"] = "bandwidth"
    bandwidth_1_s: Positive | None = None


class Calibrate(Section):
    """What may be fitted; by default the base film coefficient and each heat law's scale."""

    free: tuple[str, ...] | None = None


class Discover(Section):
    """What a search for missing effects considers; `without`: kinds of effects left out of the library."""

    without: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _kinds_exist(self) -> Discover:
        for kind in self.without:
            if kind not in KINDS:
                raise ValueError(f'without: "{kind}" is no effect; there are {", ".join(KINDS)}')
        return self


class Output(Section):
    """Where the field is reported, and what the thermal error is measured from."""

    positions_m: tuple[NonNegative, ...] | None = Field(default=None, min_length=2)
    reference_degC: Temperature | None = None


class Publish(Section):
    """The Zenoh session of the daemon."""

    mode: Literal["client", "peer", "router"] = "peer"
    connect: tuple[Endpoint, ...] = ()
    listen: tuple[Endpoint, ...] = ()
    field_rate_Hz: Annotated[float, Field(gt=0, le=50)] = 2.0
    history: Annotated[int, Field(ge=1, le=100_000)] = 1000


_BESIDE_THE_MODEL = {
    "machine", "calibrate", "discover", "compensation", "drivers", "publish", "record", "checkpoint"
}  # fmt: skip


class Config(Description):
    """A whole configuration."""

    machine: Machine = Machine()
    effect: tuple[Effect, ...] = ()
    model: Model = Model()
    estimator: EstimatorSettings = EstimatorSettings()
    calibrate: Calibrate = Calibrate()
    discover: Discover = Discover()
    output: Output = Output()
    compensation: Compensation = Compensation()
    drivers: dict[Name, DriverSettings] = Field(default_factory=dict)
    publish: Publish = Publish()
    record: Record = Record()
    checkpoint: Checkpoint = Checkpoint()

    @model_validator(mode="after")
    def _fits_the_screw(self) -> Config:
        length_m = self.screw.length_m
        places = [
            (f"sensor {s.name}: position_m", s.position_m) for s in self.sensor if s.position_m is not None
        ]
        for source in self.source:
            for key in ("position_m", "to_m"):
                if getattr(source, key) is not None:
                    places.append((f"source {source.name}: {key}", getattr(source, key)))
            if source.stroke_m is not None:
                places.append((f"source {source.name}: stroke_m", source.stroke_m[1]))
        places += [("output: positions_m", x) for x in self.output.positions_m or ()]
        for place, x_m in places:
            if x_m > length_m:
                raise ValueError(
                    f"{place} = {x_m} m lies beyond the screw's length_m = {length_m} m; mend one"
                )
        return self

    @model_validator(mode="after")
    def _growth_is_known(self) -> Config:
        wanted = [
            name
            for name, there in (("supports", self.supports), ("compensation", self.compensation.enabled))
            if there
        ]
        if wanted and self.screw.expansion_1_K is None:
            raise ValueError(f"{wanted[0]} needs the screw's expansion coefficient; give screw.expansion_1_K")
        for key, x_m in (
            ("travel_m", (self.compensation.travel_m or (0.0,))[-1]),
            ("reference_m", self.compensation.reference_m or 0.0),
        ):
            if x_m > self.screw.length_m:
                raise ValueError(
                    f"compensation: {key} reaches {x_m} m, beyond the screw's length_m; mend one of them"
                )
        return self

    @model_validator(mode="after")
    def _names_are_unique(self) -> Config:
        for kind, names in (
            ("source", [s.name for s in self.source]),
            ("sensor", [s.name for s in self.sensor]),
            ("sensor channel", [s.channel for s in self.sensor]),
        ):
            for name in names:
                if names.count(name) > 1:
                    raise ValueError(f'two entries of {kind} are called "{name}"; give each its own name')
        laws = {s.name: s.law for s in self.source}
        for source in self.source:
            if source.heat_of is not None and laws.get(source.heat_of, "heat_of") in (None, "heat_of"):
                raise ValueError(
                    f"source {source.name}: heat_of names no source with a heat law of its own; name one of "
                    f"{', '.join(n for n, law in laws.items() if law not in (None, 'heat_of')) or 'none yet'}"
                )
        if not any(s.estimate for s in self.source):
            raise ValueError("every source has estimate = false; leave at least one to be estimated")
        positions_m = self.output.positions_m or ()
        if any(b <= a for a, b in itertools.pairwise(positions_m)):
            raise ValueError("output: positions_m must increase")
        return self

    @property
    def channels(self) -> tuple[str, ...]:
        """Every channel the model reads, each once, in the order of the configuration."""
        names = [s.channel for s in self.sensor]
        for source in self.source:
            names += [source.position_channel, source.speed_channel, *source.law_channels]  # type: ignore[list-item]
        names += [self.ambient.channel, self.boundary.left.channel, self.boundary.right.channel]  # type: ignore[list-item]
        names.append(self.surface.speed_channel)  # type: ignore[arg-type]
        names += [channel for effect in self.effect for channel in effect.channels]
        return tuple(dict.fromkeys(n for n in names if n is not None))

    @property
    def plant_digest(self) -> str:
        """A hash of what gives an estimator's state its meaning: all but what lies beside the model."""
        return hashlib.sha256(self.model_dump_json(exclude=_BESIDE_THE_MODEL).encode()).hexdigest()[:16]

    @property
    def digest(self) -> str:
        """A hash of the configuration in force, the same for the same meaning."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]


def load(path: Path) -> Config:
    """Read and check a configuration file.

    Raises `ConfigError` with one sentence that names the file, the key and the remedy.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; give the path of a configuration with --config") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read as text ({error}); give a TOML file in UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML ({error}); mend that line") from None
    return parse(table, str(path))


def parse(table: dict[str, Any], place: str = "configuration") -> Config:
    """Check a configuration given as a table; `place` is named in errors (`ConfigError`)."""
    try:
        config = Config.model_validate(table)
        for effect in config.effect:
            effect.terms(config)
    except ValidationError as error:
        raise ConfigError(_one_sentence(error, table, place)) from None
    except ConfigError as error:
        raise ConfigError(f"{place}: {error}") from None
    return config


def _one_sentence(error: ValidationError, table: dict[str, Any], place: str) -> str:
    """The first problem of a validation error as a sentence; further ones are counted."""
    first = error.errors(include_url=False)[0]
    key = _key(first["loc"], table)
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        message = f"unknown key{_suggestion(first['loc'])}; remove it or mend its name"
    elif first["type"] == "missing":
        message = "is missing; add it"
    elif first["type"].startswith("union_tag"):
        kind = first["input"].get("kind") if isinstance(first["input"], dict) else None
        stated = "kind is missing" if kind is None else f"unknown kind {kind!r}"
        known = KINDS if first["loc"][0] == "effect" else DRIVER_KINDS
        message = f"{stated}; give one of {', '.join(known)}"
    elif first["type"] in {"model_type", "model_attributes_type", "dict_type"}:
        message = f"is to be a table, not {first['input']!r}; write [{key}] and its keys below"
    elif first["type"] != "value_error":
        shown = first.get("input")
        what = f", not {shown!r}" if isinstance(shown, int | float | str | bool) else ""
        message = f"{message[0].lower()}{message[1:]}{what}"
    more = error.error_count() - 1
    tail = f" ({more} more problem{'s' if more > 1 else ''})" if more else ""
    return f"{place}: {key}: {message}{tail}" if key else f"{place}: {message}{tail}"


def _key(location: tuple[int | str, ...], table: Any) -> str:
    """The dotted key of a place in the file; list entries go by their name where they have one."""
    parts: list[str] = []
    for part in location:
        if isinstance(part, int):
            table = table[part] if isinstance(table, list | tuple) and part < len(table) else None
            name = table.get("name") if isinstance(table, dict) else None
            parts[-1:] = (
                [f'{parts[-1]} "{name}"' if name else f"{parts[-1]}[{part}]"] if parts else [str(part)]
            )
            continue
        tags = (*UNION_TAGS, table.get("kind") if isinstance(table, dict) else None)
        if part in tags and not (isinstance(table, dict) and part in table):
            continue  # what pydantic inserts to say which kind of driver or place it took
        table = table.get(part) if isinstance(table, dict) else None
        parts.append(part)
    return ".".join(parts)


def _tables(*kinds: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for kind in kinds:
        yield kind
        yield from _tables(*kind.__subclasses__())


def _suggestion(location: tuple[int | str, ...]) -> str:
    """“ (did you mean …?)” from every key the configuration knows."""
    known = {
        field.alias or name
        for table in _tables(Section, Settings)
        for name, field in table.model_fields.items()
    }
    close = difflib.get_close_matches(str(location[-1]), sorted(known), n=1)
    return f" (did you mean {close[0]}?)" if close else ""
