"""Files that only their owner may read, and that are there whole or not at all."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from observer.errors import ConfigError

OWNER_ONLY = 0o600


def make_folder(folder: Path) -> None:
    """Make a folder that only its owner may look into; one that is there already stays as it is."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)


def write_whole(path: Path, data: bytes, like: Path | None = None) -> None:
    """Replace a file by one with this content, on the disk when this returns; raises `OSError`.

    It may be read and written by whoever may `like`, as far as this user can give that; else by its owner.
    """
    write_together({path: data}, like)


def write_together(files: Mapping[Path, bytes], like: Path | None = None) -> None:
    """Replace files as `write_whole` does: all are on the disk before the first takes its place.

    Where there is no room for one of them, none changes. They take their places in the order given.
    """
    parts = {path: path.with_name(f".{path.name}.part") for path in files}
    try:
        for path, data in files.items():
            _write_part(parts[path], data, like)
        for path, part in parts.items():
            part.replace(path)
    except OSError:
        for part in parts.values():
            with suppress(OSError):
                part.unlink(missing_ok=True)
        raise
    for folder in {path.parent for path in files}:
        _sync_folder(folder)


def _write_part(part: Path, data: bytes, like: Path | None) -> None:
    part.unlink(missing_ok=True)  # left behind by a power cut
    fd = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, OWNER_ONLY)
    with os.fdopen(fd, "wb") as file:
        if like is not None:
            _as_open_as(fd, like)
        file.write(data)
        file.flush()
        os.fsync(fd)


def _as_open_as(fd: int, like: Path) -> None:
    about = like.stat()
    with suppress(PermissionError):  # only root gives a file to others
        os.fchown(fd, about.st_uid, about.st_gid)
    os.fchmod(fd, stat.S_IMODE(about.st_mode))


def _sync_folder(folder: Path) -> None:
    """Have the folder's own entry on the disk, so that the new name survives a power cut."""
    fd = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def refuse_unwritable(folder: Path, key: str) -> None:
    """Raise `ConfigError` where no file can be made in a folder, which `key` named.

    A disk that fills up later is another matter.
    """
    try:
        make_folder(folder)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise ConfigError(
            f"{key}: {folder} cannot be written ({error.strerror}); name another directory"
        ) from None
