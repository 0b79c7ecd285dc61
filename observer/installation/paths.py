"""The files and folders that a configuration names."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel


def paths_in(part: BaseModel, place: str = "") -> Iterator[tuple[str, Path]]:
    """Every path that a configuration, or a table of it at `place`, names, with its key."""
    for name, value in part:
        inner = value.items() if isinstance(value, dict) else [(None, value)]
        for word, each in inner:
            key = f"{place}{name}" if word is None else f"{place}{name}.{word}"
            if isinstance(each, Path):
                yield key, each
            elif isinstance(each, BaseModel):
                yield from paths_in(each, f"{key}.")


def file_problems(config: BaseModel) -> Iterator[str]:
    """Say which files this user cannot read; drivers tell of theirs, and folders are made."""
    for key, path in paths_in(config):
        if key.startswith("drivers.") or key.endswith((".directory", ".reports")):
            continue
        if not os.path.isfile(path):
            yield f"{key}: {path} is no file; mend the path"
        elif not os.access(path, os.R_OK):
            yield f"{key}: {path} may not be read by this user; try as the service's user, or with sudo"
