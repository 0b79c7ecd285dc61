"""Files and folders of results that are written completely or not at all; service files are owner-only."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from observer.errors import ConfigError, UserError

OWNER_ONLY = 0o600


def make_folder(folder: Path) -> None:
    """Make a folder that only its owner may read; an existing folder does not change.

    Missing folders above it get the usual permissions.

    Raises:
        OSError: It cannot be made.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)


def write_whole(path: Path, data: bytes) -> None:
    """Replace a file by one for its owner alone, on the disk when this returns.

    A reader sees the old content or the new one, also after a power cut.

    Raises:
        OSError: The folder is missing, or the disk refuses the data; then the old file stays.
    """
    write_together({path: data})


def write_together(files: Mapping[Path, bytes], like: Path | None = None) -> None:
    """Replace files as `write_whole` does: all are on the disk before the first takes its place.

    If the disk has no room for one of them, all stay as they were.

    Args:
        files: Content by path; they take their places in this order.
        like: A file whose owner and permissions they get, as far as this user can give them; None for the
            owner alone.

    Raises:
        OSError: The disk refuses one of them.
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
    status = like.stat()
    with suppress(PermissionError):  # only root gives a file to others
        os.fchown(fd, status.st_uid, status.st_gid)
    os.fchmod(fd, stat.S_IMODE(status.st_mode))


def _sync_folder(folder: Path) -> None:
    """Sync the folder's own entry to disk, so that the new name survives a power cut."""
    fd = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def refuse_unwritable(folder: Path, key: str) -> None:
    """Make a folder if needed, and check that a file can be made in it.

    A disk that fills up later is not noticed here.

    Args:
        folder: The folder.
        key: The key of the configuration that names it, for the error.

    Raises:
        ConfigError: No file can be made in it.
    """
    try:
        make_folder(folder)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise ConfigError(
            f"{key}: {folder} cannot be written ({error.strerror}); name another directory"
        ) from None


@contextmanager
def results_in(folder: Path) -> Iterator[Path]:
    """Give a place to write results to, whose files move into `folder` when the block ends well.

    Older files of the same names are replaced then. After an exception `folder` is as it was before; one that
    was made for the results is removed.

    Raises:
        UserError: `folder` cannot be written, which is noticed before the block where possible.
    """
    created = _missing(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=".part-", dir=folder))
    except OSError as error:
        _remove_empty(created)
        raise _unwritable(folder, error) from None
    try:
        yield part
        files = list(part.iterdir())
        for target in (folder / file.name for file in files):
            if target.is_dir():
                raise UserError(f"{target}: cannot be written, it is a folder; name another file")
        for file in files:
            file.replace(folder / file.name)
    except OSError as error:
        raise _unwritable(folder, error) from None
    finally:
        shutil.rmtree(part, ignore_errors=True)
        _remove_empty(created)


def _missing(folder: Path) -> list[Path]:
    """The folders that are still to be made, the innermost first."""
    return [place for place in (folder, *folder.parents) if not place.exists()]


def _remove_empty(folders: list[Path]) -> None:
    for place in folders:
        if place.is_dir() and not any(place.iterdir()):
            place.rmdir()


def _unwritable(folder: Path, error: OSError) -> UserError:
    return UserError(
        f"{folder}: results cannot be written there ({error.strerror}); name a folder that can be written, "
        "or free space"
    )
