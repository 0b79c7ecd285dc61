"""A configuration's file: the machine, and the drivers that deliver its channels; all problems in words.

The file is TOML with the unit in the name of each key. `load` returns frozen objects.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from drivers import DriverSettings
from observer.config import Config, effect_problems
from observer.errors import ConfigError
from observer.files.toml import read_toml
from observer.installation.problems import as_message, problems_of
from observer.tables.keeping import Checkpoint, Record
from observer.tables.publishing import Client, Publish
from observer.tables.quantities import Name


class Installation(Config):
    """A whole configuration: the machine, its wires, and what the service keeps and tells."""

    drivers: dict[Name, DriverSettings] = Field(default_factory=dict, max_length=64)
    publish: Publish = Publish()
    record: Record = Record()
    checkpoint: Checkpoint = Checkpoint()

    def contradictions(self) -> list[str]:
        """What does not fit together, a sentence each."""
        return [*super().contradictions(), *_delivered_twice(self)]

    @property
    def sample_s(self) -> dict[str, float]:
        """How often each channel comes, by what is said of its driver."""
        return {
            channel: driver.sample_s
            for driver in self.drivers.values()
            for channel in driver.delivered or ()
            if driver.sample_s is not None
        }

    def undelivered(self) -> list[str]:
        """Say which channels the model reads and no driver delivers, as far as the drivers tell theirs."""
        offers = [driver.delivered for driver in self.drivers.values()]
        offered = {channel for offer in offers for channel in offer or ()}
        missing = [] if None in offers else [c for c in self.channels if c not in offered]
        if not missing:
            return []
        return [
            f"drivers: no driver delivers {', '.join(missing)}; add the channel to a [drivers.…] table, or "
            "remove what reads it"
        ]


def _delivered_twice(config: Installation) -> Iterator[str]:
    by: dict[str, str] = {}
    for name, settings in config.drivers.items():
        for channel in settings.delivered or ():
            if channel in by:
                yield (
                    f'drivers.{name}: "{channel}" is delivered by drivers.{by[channel]} already; give it to '
                    "one of them"
                )
            by.setdefault(channel, name)


def load(path: Path) -> Installation:
    """Read and check a configuration file.

    Raises `ConfigError`, a sentence for each problem that names the file, the key and the remedy.
    """
    return parse(read_toml(path), str(path))


def load_client(path: Path) -> Client:
    """Read and check how a command shows who it is; raises `ConfigError`."""
    table = read_toml(path, "a client's file with --client")
    try:
        return Client.model_validate(table)
    except ValidationError:
        problems = problems_of(table, Client, Client.model_validate)
        raise ConfigError(as_message(str(path), problems)) from None


def parse(table: dict[str, Any], place: str = "configuration") -> Installation:
    """Check a configuration given as a table; `place` is named in errors (`ConfigError`)."""
    try:
        config = Installation.model_validate(table)
    except ValidationError:
        raise ConfigError(
            as_message(place, problems_of(table, Installation, Installation.model_validate))
        ) from None
    if problems := effect_problems(config):
        raise ConfigError(as_message(place, problems))
    return config
