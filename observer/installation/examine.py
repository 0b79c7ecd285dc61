"""Finds all problems that prevent a configuration from being used: in its tables, and with the files they
name.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from drivers import DriverSettings
from observer.config.machine import effect_problems
from observer.errors import ConfigError
from observer.files.regular import read_toml
from observer.fit.parameters import free_problems
from observer.installation import Installation
from observer.installation.problems import as_message, problems_of

_SETTINGS: TypeAdapter[DriverSettings] = TypeAdapter(DriverSettings)


def examine(path: Path) -> Installation:
    """Read a configuration and look for every file that it names, as `observer check` does.

    Raises:
        ConfigError: All problems at once: invalid keys, missing or unreadable files, undelivered channels,
            and a folder for recordings that cannot be written.
    """
    table = read_toml(path)
    problems = problems_of(table, Installation)
    config = None if problems else Installation.model_validate(table)
    settings = dict(_drivers(table)) if config is None else config.drivers
    if config is not None:
        problems += effect_problems(config) + free_problems(config)
        problems += file_problems(config)
        problems += config.undelivered() if config.drivers else []  # without any, the model is for logs
    for name, driver in settings.items():
        problems += [f"drivers.{name}.{problem}" for problem in driver.file_problems(name)]
    directory = None if config is None else config.record.directory
    if directory is not None and not _may_be_written(directory):
        problems.append(f"record.directory: {directory} cannot be written; name another directory")
    if config is None or problems:
        raise ConfigError(as_message(str(path), problems))
    return config


def _drivers(table: dict[str, Any]) -> Iterator[tuple[str, DriverSettings]]:
    """Yield the valid drivers of an invalid configuration, by name."""
    drivers = table.get("drivers")
    for name, settings in drivers.items() if isinstance(drivers, dict) else ():
        try:
            yield name, _SETTINGS.validate_python(settings)
        except ValidationError:
            continue


def _may_be_written(directory: Path) -> bool:
    """Return whether a directory exists and is writable, or could be made."""
    at = directory.absolute()
    while not os.path.lexists(at) and at != at.parent:
        at = at.parent
    return at.is_dir() and os.access(at, os.W_OK | os.X_OK)


def paths_in(part: BaseModel, place: str = "") -> Iterator[tuple[str, Path]]:
    """Yield every path in a configuration, with its dotted key.

    Args:
        part: The configuration, or a table of it.
        place: The dotted key of that table with a final point; empty for the whole.
    """
    for name, value in part:
        inner = value.items() if isinstance(value, dict) else [(None, value)]
        for word, entry in inner:
            key = f"{place}{name}" if word is None else f"{place}{name}.{word}"
            if isinstance(entry, Path):
                yield key, entry
            elif isinstance(entry, BaseModel):
                yield from paths_in(entry, f"{key}.")


def file_problems(config: BaseModel) -> Iterator[str]:
    """Yield a sentence for each file that this user cannot read; drivers report theirs, and folders are
    made.
    """
    for key, path in paths_in(config):
        if key.startswith("drivers.") or key.endswith((".directory", ".reports")):
            continue
        if not os.path.isfile(path):
            yield f"{key}: {path} is not a file; correct the path"
        elif not os.access(path, os.R_OK):
            yield f"{key}: {path} cannot be read by this user; try as the service's user, or with sudo"
