"""State files, from which a service continues after a restart.

A file is replaced whole or not at all, and contains the version of its format. A damaged file, or one of
another version, is reported in a sentence, and its owner starts cold.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import structlog

from observer.files.folders import make_folder, write_whole

_VERSION = "format"
log = structlog.get_logger()


def save_state(path: Path, data: bytes) -> str | None:
    """Replace a state file; its folder is made if it is missing.

    Returns:
        None, or a sentence why it was not done, with the remedy. Nothing is raised, since a service goes on.
    """
    try:
        make_folder(path.parent)
        write_whole(path, data)
    except OSError as error:
        return f"{path}: cannot be written ({error.strerror}); free space or repair it"
    return None


@dataclass(frozen=True, slots=True)
class StateFile:
    """A state file in JSON.

    Attributes:
        path: The file.
        content: Names what it holds, for the log of the service.
        version: The version of its format; a file of another one is not used.
    """

    path: Path
    content: str
    version: int

    def restore(self, take: Callable[[Mapping[str, Any]], None]) -> None:
        """Call `take` with the document, if there is one; a file that cannot be used is logged and left.

        Args:
            take: Adopts the document. It raises `ValueError`, `KeyError`, `TypeError` or `AttributeError` for
                one that it cannot use, before it changes anything.
        """
        try:
            document = json.loads(self.path.read_bytes())
            if document[_VERSION] != self.version:
                raise ValueError(f"format {document[_VERSION]} instead of {self.version}")
            take(document)
        except FileNotFoundError:
            return
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            reason = f"{self.path}: cannot be used ({error!r}); it starts anew"
            log.warning(f"{self.content}: no state restored", reason=reason)

    def encoded(self, document: Mapping[str, Any]) -> bytes:
        """Return a document with the version of the format, as the file holds it."""
        return json.dumps({_VERSION: self.version, **document}).encode()

    def save(self, data: bytes) -> None:
        """Replace the file by an `encoded` document; a failure is logged, and the old file stays."""
        if (reason := save_state(self.path, data)) is not None:
            log.warning(f"{self.content}: state not saved", reason=reason)
