"""A folder of results: its files appear all together when they are complete, or none does."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from observer.errors import UserError


@contextmanager
def results_in(folder: Path) -> Iterator[Path]:
    """Give a place to write results to, whose files move into `folder` when the block ends well.

    Older files of the same names are replaced then; after an exception `folder` is as it was before. Raises
    `UserError`, before the block where possible, when `folder` cannot be written.
    """
    made = _missing(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=".part-", dir=folder))
    except OSError as error:
        _remove_empty(made)
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
        _remove_empty(made)


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a result for programs; raises `ValueError` on NaN, which JSON does not know."""
    path.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")


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
