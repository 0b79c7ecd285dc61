"""How long recordings stay: by age, by their size in all, and by the space that is to stay free.

Only files that a service of this name has written to the end are ever removed, the oldest first, never one
that is being written.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import math
import os
import re
import shutil
import stat
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from observer.config.publishing import RecordSettings
from observer.errors import ConfigError, LogError

START_SUFFIX = ".start"
"""The checkpoint beside a recording, from which its estimates start, has the recording's name and this."""
STATE_SUFFIX = ".state"
"""Beside a file that goes on with a full one: where aligner and estimator stood, to the last bit."""
CONFIG_SUFFIX = ".config"
"""Beside every file: the document `config` of the service that wrote it, with a `checksum`."""
STEPS_SUFFIX = ".steps"
"""The published steps of the hour in progress; `.parquet` follows it once the hour is closed and packed."""
_COMPANIONS = (START_SUFFIX, STATE_SUFFIX, CONFIG_SUFFIX)
_MOST_CONFIG_BYTES = 10_000_000
CLOCK_SET_S = 1_600_000_000.0
"""A file older than this (2020) was written before the computer's clock was set; its age is not known."""
TRUSTED_AFTER_S = 3600.0
"""Ages count once the clock has run for so long without a step: a wrong one may make everything look old."""
_LEAST_FREE_GB = 1.0


@dataclass(frozen=True, slots=True)
class Retention:
    """The limits of the files to keep.

    Attributes:
        keep_s: Files whose last row is older are removed.
        keep_bytes: Largest size of all files together.
        free_bytes: Space of the disk to leave free, at most a tenth of the disk.
    """

    keep_s: float = math.inf
    keep_bytes: float = math.inf
    free_bytes: float = 0.0

    @classmethod
    def of(cls, record: RecordSettings) -> Retention:
        """Return the limits of a `[record]` table; without `keep_days` or `keep_GB` these set no limit."""
        return cls(
            math.inf if record.keep_days is None else record.keep_days * 86_400.0,
            math.inf if record.keep_GB is None else record.keep_GB * 1e9,
            record.keep_free_GB * 1e9,
        )


@dataclass(frozen=True, slots=True)
class Recording:
    """One complete file.

    Attributes:
        path: The CSV file, or the file of steps.
        size: Its size with its companion files, bytes.
        ended_s: When its last row was written, s since 1970.
    """

    path: Path
    size: int
    ended_s: float


def to_remove(
    files: Iterable[Recording], keep: Retention, total: int, free: int, now_s: float, *, by_age: bool
) -> Iterator[Recording]:
    """Yield the files to be removed, the oldest first.

    Args:
        files: The complete files.
        keep: The limits.
        total: Bytes of the disk; of a small one at most a tenth is kept free.
        free: Bytes of the disk that are free.
        now_s: Time, s since 1970.
        by_age: Whether ages count; not while the clock cannot be trusted yet.
    """
    ordered = sorted(files, key=lambda file: (file.ended_s, file.path.name))
    in_all, wanted_free = sum(file.size for file in ordered), min(keep.free_bytes, total / 10)
    for file in ordered:
        old = by_age and file.ended_s > CLOCK_SET_S and now_s - file.ended_s > keep.keep_s
        if old or in_all > keep.keep_bytes or free < wanted_free:
            in_all, free = in_all - file.size, free + file.size
            yield file


def tidy(folder: Path, name: str, keep: Retention, now_s: float, *, by_age: bool) -> tuple[Path, ...]:
    """Remove recordings and files of steps beyond the limits, with their companions.

    A file that is being written is never removed.

    Args:
        folder: The service's `record.directory`.
        name: `<machine>-<axis>`; files of other names stay.
        keep: The limits.
        now_s: Time, s since 1970.
        by_age: Whether ages count.

    Returns:
        The removed files, the oldest first.

    Raises:
        OSError: The folder cannot be read, or a file cannot be removed.
    """
    removed, disk = [], shutil.disk_usage(folder)
    files = recordings(folder, name, rf"(\.csv|{re.escape(STEPS_SUFFIX)}(\.parquet)?)")
    for file in to_remove(files, keep, disk.total, disk.free, now_s, by_age=by_age):
        if not is_being_written(file.path):
            file.path.unlink(missing_ok=True)
            for suffix in _COMPANIONS:
                file.path.with_suffix(suffix).unlink(missing_ok=True)
            removed.append(file.path)
    return tuple(removed)


def shortage(folder: Path, keep: Retention) -> str | None:
    """Return a sentence about a disk that is nearly full; None while it is not.

    Args:
        folder: A folder on the disk.
        keep: Its `free_bytes` is the limit; 1 GB if that is 0, and a tenth of the disk at most.

    Raises:
        OSError: The disk cannot be asked.
    """
    disk = shutil.disk_usage(folder)
    least = min(keep.free_bytes or _LEAST_FREE_GB * 1e9, disk.total / 10)
    if disk.free >= least:
        return None
    return (
        f"{folder}: only {disk.free / 1e9:.3g} GB are free, less than {least / 1e9:.3g} GB; "
        "free space, or move recordings elsewhere"
    )


def recordings(folder: Path, name: str, ending: str = r"\.csv") -> list[Recording]:
    """Return the files that services of this name have written; links are left out.

    Args:
        folder: The service's `record.directory`.
        name: `<machine>-<axis>`.
        ending: Regular expression of the suffix.

    Raises:
        OSError: The folder cannot be read.
    """
    file_name = re.compile(rf"{re.escape(name)}-\d{{8}}T\d{{6}}Z(-\d+)?{ending}")
    complete = []
    for path in folder.iterdir():
        try:
            status = path.lstat()
            if file_name.fullmatch(path.name) and stat.S_ISREG(status.st_mode):
                complete.append(Recording(path, status.st_size + _size(path), status.st_mtime))
        except FileNotFoundError:
            continue  # somebody else has removed it meanwhile
    return complete


def is_being_written(path: Path) -> bool:
    """Return whether a service holds the file open for writing; one that cannot be asked counts as held."""
    try:
        return _is_locked(path)
    except FileNotFoundError:
        return False
    except OSError:
        return True


def refuse_shared(folder: Path, name: str) -> None:
    """Refuse a folder into which another service of this name is recording.

    The two would write over each other's checkpoint. On a network drive locks may not show it.

    Args:
        folder: The configured `record.directory`.
        name: `<machine>-<axis>`.

    Raises:
        ConfigError: A recording of this name is locked.
    """
    files: list[Recording] = []
    with suppress(OSError):  # not there yet, or not to be listed
        files = recordings(folder, name)
    for file in files:
        with suppress(OSError):  # of another user, or on a file system without locks
            if _is_locked(file.path):
                raise ConfigError(
                    f"record.directory: another service called {name} is recording {file.path}; stop it, or "
                    "name another directory"
                )


def _is_locked(path: Path) -> bool:
    """Whether somebody has locked a file. Raises `OSError` where that cannot be asked."""
    fd = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(fd)
    return False


def _size(path: Path) -> int:
    companions = (path.with_suffix(suffix) for suffix in _COMPANIONS)
    return sum(file.lstat().st_size for file in companions if file.exists())


def sealed(document: bytes) -> bytes:
    """Return a document `config` with its checksum, in the form of the file beside a recording.

    Args:
        document: JSON.
    """
    content = json.loads(document)
    return json.dumps({**content, "checksum": _checksum(content)}).encode()


def recorded_config(path: Path) -> dict[str, Any]:
    """Return the document `config` beside a recording; empty if there is no such file.

    Raises:
        LogError: It is damaged: it would shift the estimates unnoticed.
    """
    sidecar = path.with_suffix(CONFIG_SUFFIX)
    try:
        with sidecar.open("rb") as file:
            data = file.read(_MOST_CONFIG_BYTES)
    except OSError:
        return {}
    try:
        document = json.loads(data)
        is_whole = isinstance(document["config"], dict)
        is_whole = is_whole and document.get("checksum", _checksum(document)) == _checksum(document)
    except (ValueError, KeyError, TypeError, RecursionError):
        is_whole = False
    if not is_whole:
        raise LogError(
            f"{sidecar.name} is damaged: its content does not match its checksum; restore it from a copy, or "
            "remove it to have the recording estimated by the configuration in force"
        )
    return document  # type: ignore[no-any-return]


def _checksum(document: dict[str, Any]) -> str:
    content = {key: value for key, value in document.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
