"""What all effects share: how one is named, what it is part of, and the question it answers."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from observer.effects.terms import Term
from observer.errors import ConfigError
from observer.tables.quantities import Section
from observer.tables.sections import Description, Source

Target = Annotated[str, Field(min_length=1, max_length=64)]


class EffectTable(Section):
    """One physical effect: the parameters of a `[[effect]]` table, and the terms it adds to the plant.

    `parameters` are the keys that a search may fit; `excitation` is what a log must hold to tell them;
    `source` where the law comes from.
    """

    parameters: ClassVar[tuple[str, ...]]
    targets: ClassVar[Literal["end", "source", "nut", "place", "sensor"] | None] = None
    excitation: ClassVar[str]
    source: ClassVar[str]

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that the effect itself names."""
        named = (getattr(self, key, None) for key in ("speed_channel", "drive_channel"))
        return tuple(channel for channel in named if channel is not None)

    @abstractmethod
    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return what the effect adds to the plant of a machine. Raises `ConfigError` where it cannot."""


def named_source(machine: Description, name: str, kind: str) -> str:
    """Return the name of a source that exists. Raises `ConfigError`."""
    names = [s.name for s in machine.source]
    if name not in names:
        raise ConfigError(f'effect "{kind}": target "{name}" is no source; give one of {", ".join(names)}')
    return name


def named_sensor(machine: Description, name: str, kind: str) -> str:
    """Return the name of a sensor that exists. Raises `ConfigError`."""
    names = [s.name for s in machine.sensor]
    if name not in names:
        raise ConfigError(f'effect "{kind}": target "{name}" is no sensor; give one of {", ".join(names)}')
    return name


def free_end(machine: Description, end: str, kind: str) -> float:
    """Return the position of an end whose temperature is not prescribed. Raises `ConfigError`."""
    if getattr(machine.boundary, end).kind == "prescribed":
        raise ConfigError(
            f'effect "{kind}": the {end} end has a prescribed temperature, which no heat can change; '
            "remove the effect or the prescription"
        )
    return 0.0 if end == "left" else machine.screw.length_m


def source_free_to_warm(machine: Description, name: str, kind: str) -> str:
    """Return the name of a source that exists and does not stand at an end with a prescribed temperature.

    Raises `ConfigError`.
    """
    source = next(s for s in machine.source if s.name == named_source(machine, name, kind))
    heats_screw(source, kind)
    end = {0.0: "left", machine.screw.length_m: "right"}.get(source.position_m or 0.0)
    if source.shape == "point" and end is not None:
        free_end(machine, end, kind)
    return name


def heats_screw(source: Source, kind: str) -> None:
    """Raise `ConfigError` where all of a source's heat goes into nodes."""
    if source.screw_share == 0.0:
        raise ConfigError(f'effect "{kind}": "{source.name}" heats nodes only; name one that heats the screw')


def on_screw(machine: Description, key: str, position_m: float, kind: str) -> None:
    """Raise `ConfigError` where a position lies beyond the screw."""
    if position_m > machine.screw.length_m:
        raise ConfigError(
            f'effect "{kind}": {key} = {position_m} m lies beyond the screw\'s '
            f"length_m = {machine.screw.length_m} m; mend one"
        )


def speed_channel(machine: Description, given: str | None, kind: str) -> str:
    """Return the channel of the screw's speed: the one given, or the first that a source reads."""
    channels = [given, *(s.speed_channel for s in machine.source)]
    for channel in channels:
        if channel is not None:
            return channel
    raise ConfigError(f'effect "{kind}": no source has a speed_channel; name it in the effect')
