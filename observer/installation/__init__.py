"""The configuration file: the machine, and the drivers that deliver its channels.

The file is TOML with the unit in the name of each key. `load` returns frozen objects. All problems of a file
are reported at once, a sentence each.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import tomlkit
from pydantic import BaseModel, Field, ValidationError
from tomlkit.items import AoT, Array

from drivers import DriverSettings
from drivers.places import CanTable
from drivers.protocol import Driver
from observer.config.candidates import CandidateFile, SensorCandidate, candidate_problems
from observer.config.effects.base import EffectTable
from observer.config.machine import Config, effect_problems
from observer.config.outlets import Metrics, Mqtt, Opcua, OutletSettings, Page
from observer.config.publishing import AlarmSettings, Checkpoint, Client, Publish, RecordSettings
from observer.config.quantities import Name
from observer.errors import ConfigError
from observer.files.regular import read_toml
from observer.fit.parameters import rounded
from observer.installation.problems import as_message, problems_of

Model = TypeVar("Model", bound=BaseModel)


class Installation(Config):
    """A whole configuration: the machine, its drivers, and the service's outputs.

    It is `Config`, which mathematics reads, with the tables that only a service needs.
    """

    drivers: dict[Name, DriverSettings] = Field(default_factory=dict, max_length=64)
    publish: Publish = Publish()
    record: RecordSettings = RecordSettings()
    checkpoint: Checkpoint = Checkpoint()
    alarms: AlarmSettings = AlarmSettings()
    outlets: OutletSettings = OutletSettings()
    page: Page | None = None
    metrics: Metrics | None = None
    mqtt: Mqtt | None = None
    opcua: Opcua | None = None

    def contradictions(self) -> list[str]:
        """Return contradictions between tables, a sentence each with the remedy.

        Beside those of `Config` these are: channels that two drivers deliver, and drivers that share a wire
        with other settings. A CAN bus that is reopened while its senders are quiet is one too.
        """
        return [
            *super().contradictions(),
            *_delivered_twice(self),
            *_wires_disagree(self),
            *_reopened_too_soon(self),
        ]

    @property
    def sample_s(self) -> dict[str, float]:
        """The period of each channel in s, from the tables of its driver; a channel without a known period
        is absent.
        """
        return {
            channel: driver.sample_s
            for driver in self.drivers.values()
            for channel in driver.delivered or ()
            if driver.sample_s is not None
        }

    def open_drivers(self) -> tuple[Driver, ...]:
        """Return all drivers, opened; their devices are connected later, in the drivers' own threads.

        A CAN bus whose senders all send only on change is reopened only after their longest heartbeat.

        Raises:
            UserError: A file that a driver names, such as a DBC, cannot be used.
        """
        return tuple(
            settings.open(name)
            if (quiet_s := _quiet_s(self, settings)) is None or not isinstance(settings, CanTable)
            else settings.model_copy(update={"reopen_s": max(settings.longest_silence_s, quiet_s)}).open(name)
            for name, settings in self.drivers.items()
        )

    @property
    def checkpoint_file(self) -> Path | None:
        """The file of the service's checkpoint, `<machine>-<axis>.checkpoint`; None where it saves none."""
        place, name = self.checkpoint.place(self.record), self.machine
        return None if place is None else place / f"{name.name}-{name.axis}.checkpoint"

    @property
    def alarms_file(self) -> Path | None:
        """The file of the alarms and of their learnt limits, beside the checkpoint; None without a
        checkpoint.
        """
        file = self.checkpoint_file
        return None if file is None else file.with_suffix(".alarms.json")

    def undelivered(self) -> list[str]:
        """Return a sentence that names the channels in use that no driver delivers; empty without any.

        Empty, too, where a driver does not list its channels. Derived channels need no driver.
        """
        offers = [driver.delivered for driver in self.drivers.values()]
        offered = {channel for offer in offers for channel in offer or ()}
        read_channels = dict.fromkeys((*self.channels, self.compensation.zero_channel))
        offered |= self.derived_channels
        missing = [] if None in offers else [c for c in read_channels if c is not None and c not in offered]
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


def _wires_disagree(config: Installation) -> Iterator[str]:
    """Report drivers that share a serial port, or a host and port, with different settings of the wire."""
    first: dict[tuple[object, ...], tuple[str, str]] = {}
    for name, driver in config.drivers.items():
        wire = driver.wire()
        if wire is None:
            continue
        other, settings = first.setdefault(wire.place, (name, wire.settings))
        if settings != wire.settings:
            yield (
                f"drivers.{name}: it shares {wire.name} with drivers.{other}, but has {wire.settings} where "
                f"that has {settings}; give both the same"
            )


def _quiet_s(config: Installation, driver: DriverSettings) -> float | None:
    """Return a driver's longest heartbeat, s, if all its channels send only on change, else None."""
    heartbeats_s = [config.heartbeats_s.get(channel) for channel in driver.delivered or ()]
    known_s = [heartbeat_s for heartbeat_s in heartbeats_s if heartbeat_s is not None]
    return max(known_s) if known_s and len(known_s) == len(heartbeats_s) else None


def _reopened_too_soon(config: Installation) -> Iterator[str]:
    """Report a CAN bus that is opened again while all its senders may be quiet."""
    for name, driver in config.drivers.items():
        quiet_s = _quiet_s(config, driver)
        if (
            isinstance(driver, CanTable)
            and driver.reopen_s is not None
            and driver.reopen_s < (quiet_s or 0.0)
        ):
            yield (
                f"drivers.{name}: reopen_s = {driver.reopen_s:g} is shorter than the heartbeat_s = "
                f"{quiet_s:g} of its channels, which all send only on change; raise it, or leave it out"
            )


def load(path: Path) -> Installation:
    """Read and check a configuration file.

    Files that it names, such as a DBC, are not opened; `examine` does that.

    Raises:
        ConfigError: The file cannot be read, or is invalid; a sentence for each problem names the file, the
            key and the remedy.
    """
    return parse(read_toml(path), str(path))


def load_client(path: Path) -> Client:
    """Read and check a client's credentials.

    Raises:
        ConfigError: The file cannot be read, or is invalid.
    """
    return _checked(Client, read_toml(path, "a client's file with --client"), str(path))


def load_candidates(path: Path, config: Config) -> tuple[SensorCandidate, ...]:
    """Read and check a file of candidates for sensors on a machine.

    Args:
        path: TOML with `[[candidate]]` tables.
        config: The machine whose screw and nodes carry them.

    Raises:
        ConfigError: The file cannot be read, a key is invalid, or a place is not on the screw or on a node.
    """
    return parse_candidates(read_toml(path, "a file of [[candidate]] tables"), str(path), config)


def parse_candidates(table: dict[str, Any], place: str, config: Config) -> tuple[SensorCandidate, ...]:
    """Check candidates given as a table.

    Args:
        table: The content of a file of candidates.
        place: The file, named in errors.
        config: The machine whose screw and nodes carry them.

    Raises:
        ConfigError: A key is invalid, or a place is not on the screw or on a node.
    """
    candidates = _checked(CandidateFile, table, place).candidate
    nodes = [node.name for node in config.node]
    if problems := list(candidate_problems(candidates, config.screw.length_m, nodes)):
        raise ConfigError(as_message(place, problems))
    return candidates


def parse(table: dict[str, Any], place: str = "configuration") -> Installation:
    """Check a configuration given as a table.

    Args:
        table: The content of a file.
        place: The file, named in errors.

    Raises:
        ConfigError: Keys are unknown, missing or out of range, or contradict each other; a sentence for each.
    """
    config = _checked(Installation, table, place)
    if problems := effect_problems(config):
        raise ConfigError(as_message(place, problems))
    return config


def _checked(model: type[Model], table: dict[str, Any], place: str) -> Model:
    try:
        return model.model_validate(table)
    except ValidationError:
        raise ConfigError(as_message(place, problems_of(table, model))) from None


def write_back(text: str, values: Mapping[str, float]) -> str:
    """Return the text with the values of the given keys replaced or added.

    Comments, order and spacing stay. Values are rounded to five digits, far below any interval.

    Args:
        text: A configuration file.
        values: Values by dotted key. A source is addressed by its name, as in `source.nut.torque_Nm`, a link
            by the names of its ends.

    Raises:
        ConfigError: The text does not have such a source or link.
    """
    document = tomlkit.parse(text.removeprefix("\ufeff"))
    for key, value in values.items():
        table, last = _owner(document, key)
        table[last] = rounded(value)
    return tomlkit.dumps(document)


def with_effects(text: str, effects: Sequence[EffectTable]) -> str:
    """Return the text with an `[[effect]]` table added for each effect; unchanged without any.

    Comments, order and spacing stay. Values are rounded to five digits.
    """
    if not effects:
        return text
    document = tomlkit.parse(text.removeprefix("\ufeff"))
    tables = document.setdefault("effect", tomlkit.aot())
    for effect in effects:
        table = tomlkit.table()
        for key, value in effect.model_dump(exclude_unset=True, exclude_none=True).items():
            table[key] = rounded(value) if isinstance(value, float) else value
        tables.append(table)
    return tomlkit.dumps(document)


def _owner(document: Any, key: str) -> tuple[Any, str]:
    """Return the table that holds a key, made if missing, and the last part of the key."""
    head, *middle, last = key.split(".")
    section = document.setdefault(head, tomlkit.table())
    if isinstance(section, AoT | Array):
        name = ".".join(middle)
        for entry in section:
            if (entry["name"] if "name" in entry else "-".join(entry["between"])) == name:
                return entry, last
        raise ConfigError(
            f'{key}: the configuration has no {head} called "{name}"; search again with the one in force'
        )
    for part in middle:
        section = section.setdefault(part, tomlkit.table())
    return section, last
