"""Where compiled kernels are kept when neither the package's directory nor the user's home can be written."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"


def choose_compile_cache() -> None:
    """Give numba a private directory where it would find none by itself; call before it is imported.

    numba looks at `NUMBA_CACHE_DIR`, beside the sources and below the user's home, and refuses to compile
    when it can write nowhere, as in a read-only installation that runs as a user without a home.
    """
    if not any(_can_write(place) for place in _places_of_numba()):
        with contextlib.suppress(OSError):  # nowhere at all: numba's own message says so
            os.environ[VARIABLE] = str(_private_directory())


def _places_of_numba() -> Iterator[Path]:
    if chosen := os.environ.get(VARIABLE):
        yield Path(chosen)
    yield Path(__file__).parent / "__pycache__"
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    yield Path(home) / "numba"


def _can_write(place: Path) -> bool:
    """Whether files can be made in a directory, or in what would be made of it."""
    there = next(p for p in (place.absolute(), *place.absolute().parents) if p.exists())
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)


def _private_directory() -> Path:
    """The user's own directory for this; what is loaded from it is run, so nobody else may write there."""
    place = Path(tempfile.gettempdir()) / f"ballscrew-observer-{os.getuid()}"
    with contextlib.suppress(FileExistsError):
        place.mkdir(mode=0o700)
    found = place.lstat()
    if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077:
        return place
    return Path(tempfile.mkdtemp(prefix="ballscrew-observer-"))
