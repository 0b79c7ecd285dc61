"""State files, from which a service continues after a restart.

A file is replaced whole or not at all, and contains the version of its format. A damaged file, or one of
another version, is reported in a sentence, and its owner starts cold.
"""

from __future__ import annotations

import json
import threading
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


class StateWriter:
    """Replaces a state file in a thread of its own, so that a slow disk delays no tick.

    Attributes:
        problem: Why the file could not be replaced the last time, as a sentence; None if it could.
    """

    def __init__(self, path: Path) -> None:
        self.problem: str | None = None
        self._path, self._thread = path, threading.Thread()

    def replace(self, content: Callable[[], bytes]) -> None:
        """Begin to replace the file, after what was begun before.

        Args:
            content: Makes the content, in that thread.
        """
        self._thread = threading.Thread(
            target=self._replace, args=(content, self._thread), name=self._path.name, daemon=True
        )
        self._thread.start()

    def wait(self, timeout_s: float = 0.0) -> bool:
        """Return whether the last content is on the disk, or was refused, within some seconds."""
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _replace(self, content: Callable[[], bytes], before: threading.Thread) -> None:
        if before.is_alive():
            before.join()
        failure: Exception | None = None
        try:
            problem = save_state(self._path, content())
        except Exception as error:  # noqa: BLE001 - a defect; the service continues
            failure, problem = error, f"{self._path}: cannot be written ({error!r}); report this"
        if problem is not None and self.problem is None:
            log.warning("state not saved", reason=problem, exc_info=failure)
        self.problem = problem


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

    def save(self, document: Mapping[str, Any]) -> None:
        """Replace the file by a document; a failure is logged, and the old file stays."""
        if (reason := save_state(self.path, self.encoded(document))) is not None:
            log.warning(f"{self.content}: state not saved", reason=reason)
